"""All scans of a wall into maps on one grid; a scan that is bad is an error, or left out by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fusion.height_map import FusedMap
from ..stream.assembler import Assembler
from .bead import Bead, BeadTop, WallError, bead_top, find_bead
from .files import ArcLog, LaserScan
from .left_out import LeftOut, leave_out
from .wall import (
    RecordedScan,
    ScanMotion,
    clock_lag,
    find_scans,
    fuse,
    grid_of,
    hour_seconds,
    prepare,
    profile_points,
    scanner_shift,
)  # fmt: skip


@dataclass
class Careful:
    """What happens with a bad scan: an error, or with left_out its name goes there and the rest goes on."""

    names: list[str]  # of the laser files
    left_out: LeftOut | None = None

    def bad(self, k: int, error: Exception, kind: str = 'scan') -> None:
        """Scan k cannot be used."""
        leave_out(self.left_out, kind, self.names[k], '', error)


def match_scans(
    lasers: list[LaserScan], log: ArcLog, careful: Careful
) -> dict[int, tuple[ScanMotion, float]]:
    """Number of the laser file -> its motion and the lag of its clock (s; NaN: not seen): the nearest in time, clocks
    less than 15 s apart."""
    motions = find_scans(log)
    found: dict[int, tuple[ScanMotion, float]] = {}
    for k, laser in enumerate(lasers):
        try:
            motion = _nearest(k, laser, motions)
            if any(motion is m for m, _ in found.values()):
                raise WallError('two laser files belong to the same motion of the arc log')
        except WallError as e:
            careful.bad(k, e)
            continue
        try:
            found[k] = motion, clock_lag(laser, log, motion)
        except WallError as e:
            careful.bad(k, WallError(f'{e}; the clock of the other scans is used'), 'clock')
            found[k] = motion, np.nan
    return found


def _nearest(k: int, laser: LaserScan, motions: list[ScanMotion]) -> ScanMotion:
    t = float(np.median(hour_seconds(laser.stamps)))
    near = min(motions, key=lambda m: abs(float(np.median(m.t)) - t), default=None)
    if near is None or abs(float(np.median(near.t)) - t) > 15.0:
        raise WallError(
            f'scan {k + 1} at {t // 60:.0f} min {t % 60:.1f} s: no scanning motion in the arc log then'
        )
    return near


@dataclass(frozen=True)
class WallMaps:
    """Everything that a folder of recordings gives."""

    scans: list[RecordedScan]
    lags: list[float]  # s, of the clock of every laser file; NaN: not seen
    shift: tuple[float, float]  # (x, y) m of the scanner against the torch
    maps: list[FusedMap]  # one per scan
    assemblers: list[Assembler]  # one per scan
    bead: Bead  # the new bead
    tops: list[BeadTop]  # one per scan but the first
    kept: list[int]  # which of the laser files the scans are


def fuse_wall(
    lasers: list[LaserScan],
    log: ArcLog,
    cell: float = 1e-3,
    names: list[str] | None = None,
    left_out: LeftOut | None = None,
) -> WallMaps:
    """One map per laser file on a common grid (work axes = robot axes, z = 0 on the substrate), and the bead's top.

    A scan that cannot be used is an error; with left_out it is left out by its name, as long as two are left.
    """
    careful = Careful(names or [f'scan {k + 1}' for k in range(len(lasers))], left_out)
    _two(lasers)
    matched = match_scans(lasers, log, careful)
    lags = [lag for _, lag in matched.values()]
    if not np.isfinite(lags).any():
        raise WallError('the profiles of no scan show the lift at its end; the clocks stay unknown')
    lag = float(np.nanmedian(lags))
    ready: dict[int, RecordedScan] = {}
    for k, (motion, _) in matched.items():
        try:
            ready[k] = prepare(lasers[k], log, motion, lag)
        except (WallError, np.linalg.LinAlgError) as e:
            careful.bad(k, e)
    _two(list(ready))
    shift = _shift(ready, log, cell, careful)
    spec = grid_of(list(ready.values()), cell, shift)
    fused = {k: fuse(s, spec, shift) for k, s in ready.items()}
    first, last = min(ready), max(ready)
    bead = find_bead(fused[first][0], fused[last][0])
    tops = {}
    for k in [k for k in ready if k != first]:
        try:
            tops[k] = bead_top(profile_points(ready[k], shift), bead)
        except WallError as e:
            careful.bad(k, e)
    _two([first, *tops])
    kept = [first, *tops]
    return WallMaps(
        scans=[ready[k] for k in kept],
        lags=[matched[k][1] for k in kept],
        shift=shift,
        maps=[fused[k][0] for k in kept],
        assemblers=[fused[k][1] for k in kept],
        bead=bead,
        tops=list(tops.values()),
        kept=kept,
    )


def _two(scans: list) -> None:
    if len(scans) < 2:
        raise WallError('at least two scans are needed: one before the bead and one after')


def _shift(
    ready: dict[int, RecordedScan], log: ArcLog, cell: float, careful: Careful
) -> tuple[float, float]:
    """From the last scan that shows a bead; later ones that do not leave `ready`."""
    while True:
        try:
            return scanner_shift(list(ready.values()), log, cell)
        except WallError as e:
            if careful.left_out is None or len(ready) <= 2 or not log.arc.any():
                raise
            k = max(ready)
            careful.bad(k, e)
            del ready[k]
