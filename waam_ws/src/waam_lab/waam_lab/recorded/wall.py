"""Maps of a wall from the files of a line laser and the robot's log, whose clocks and mounting nobody wrote down.

Laser files (LaserCoordinateN.csv) hold lateral position and distance with millisecond stamps of one computer, the log
(arc_log.csv) positions with stamps truncated to 0.1 s of another. What brings them together is in the data themselves:

* when the robot was where: a scan is a straight motion at constant speed, so time is a linear function of position,
  and every truncated stamp confines it to a window 0.1 s wide; dozens of windows leave a few milliseconds;
* the lag between the clocks: at the end of a scan the robot lifts the scanner, both logs see the ramp;
* the substrate: the plane that most points lie on; heights are counted along its normal;
* where the scanner sits beside the torch: the bead that appears between first and last scan was laid at known places.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waam_process.grid import GridSpec
from waam_record.bag_writer import BagError
from waam_record.foreign import times
from waam_record.foreign.text import Form, Table, number, read_table
from waam_scan.fusion.height_map import FusedMap, Fusion
from waam_scan.fusion.limits import FusionLimits
from waam_scan.stream.poses import PoseStatus, PoseTrack
from waam_scan.stream.profiles import ProfileBlock
from waam_scan.stream.session import Session
from waam_scan.transform import Mounting, rotation_rpy

from ..twin.records import RecordError

HOUR = 3600.0
QUANTUM = 0.1  # s, to which the stamps of the log are truncated
SHORT = 0.1  # a profile with less than this share of the usual number of points is damaged
MAX_POSE_GAP_NS = 250_000_000  # at steady speed; the log leaves out a line now and then
BELOW, ABOVE = -5e-3, 60e-3  # m, heights beside the substrate that are kept
LEVEL, MIN_LENGTH = 0.2e-3, 0.05  # m: a scan keeps its height, and is at least so long
CLOCKS_APART = 15.0  # s, between laser and log, at most
# The scanner looks down: distance grows downwards, and its lateral axis lies across the travel.
# Which side is + cannot be told from one wall; + lateral is taken as + y.
ACROSS = rotation_rpy(0.0, 0.0, np.pi / 2)


@dataclass(frozen=True)
class LaserScan:
    """n profiles, NaN where one has fewer points than the longest. t: (n,) s since the full hour before the first;
    x, range: (n, m) m, lateral and away from the sensor."""

    t: np.ndarray
    x: np.ndarray
    range: np.ndarray


@dataclass(frozen=True)
class ArcLog:
    """What the robot logged, n lines; t: s since a full hour, truncated to QUANTUM; SI."""

    t: np.ndarray
    position: np.ndarray  # (n, 3)
    speed: np.ndarray
    arc: np.ndarray  # bool
    wire_feed: np.ndarray
    current: np.ndarray
    voltage: np.ndarray


@dataclass(frozen=True)
class ScanMotion:
    """A straight motion along x at constant height. rows: (n,) of the log; t: (n,) s, restored; speed: m/s, signed."""

    rows: np.ndarray
    t: np.ndarray
    speed: float


@dataclass(frozen=True)
class Bead:
    """Where the new bead lies on a map: y of its centre line, x of half height at its ends, m."""

    axis: float
    start: float
    end: float


@dataclass(frozen=True)
class RecordedScan:
    """A laser file with poses. stamps: (n,) ns of the profiles by the clock of the robot; plane: a, b, c of the
    substrate z = a + b x + c y in robot axes."""

    laser: LaserScan
    motion: ScanMotion
    track: PoseTrack
    stamps: np.ndarray
    plane: tuple[float, float, float]


@dataclass(frozen=True)
class WallMaps:
    """Everything that a folder of recordings gives, in the axes of the robot, z = 0 on the substrate. shift: (x, y) m
    of the scanner against the torch; left_out: what could not be used, in words."""

    scans: list[RecordedScan]
    shift: tuple[float, float]
    maps: list[FusedMap]
    bead: Bead
    left_out: list[str]


def read_wall(folder: Path, cell: float) -> tuple[WallMaps, ArcLog]:
    """A folder of LaserCoordinateN.csv and arc_log.csv. RecordError says why there is no wall in it."""
    files = sorted(folder.glob('LaserCoordinate*.csv'), key=lambda p: (len(p.name), p.name))
    left_out: list[str] = []
    lasers: dict[str, LaserScan] = {}
    try:
        log = read_log(folder / 'arc_log.csv', left_out)
        for path in files:
            try:
                lasers[path.name] = read_laser(path, left_out)
            except RecordError as e:
                left_out.append(str(e))
        return fuse_wall(lasers, log, cell, left_out), log
    except RecordError as e:
        more = f' (left out: {"; ".join(left_out[:3])})' if left_out else ''
        raise RecordError(f'{folder}: {e}{more}') from None


def _table(path: Path, columns: tuple[str, ...], left_out: list[str]) -> Table:
    try:
        table = read_table(path.read_bytes(), path.name, Form(',', '.', 1))
    except (OSError, BagError) as e:
        raise RecordError(str(e)) from None
    if missing := [c for c in columns if c not in table.head]:
        raise RecordError(f'{path.name}, line 1: no column {", ".join(missing)}')
    left_out += [f'{path.name}, line {n}: {why}' for n, why in table.skipped]
    return table


def read_laser(path: Path, left_out: list[str]) -> LaserScan:
    """TimeReceived,X,Z: the points of a profile separated by blanks, in mm. Profiles that cannot be read, and those of
    less than a tenth of the usual number of points, are left out. RecordError when none remains."""
    table = _table(path, ('TimeReceived', 'X', 'Z'), left_out)
    at = [table.head.index(c) for c in ('TimeReceived', 'X', 'Z')]
    date, found = times.reader('year_first'), []
    for line, cells in table.rows:
        stamp, *lists = (cells[k] for k in at)
        try:
            x, z = (np.array(text.split(), float) for text in lists)
            if not len(x) == len(z):
                raise ValueError(f'X and Z have {len(x)} and {len(z)} values, need equal numbers')
            found.append((line, date(stamp), x, z))
        except ValueError as e:
            left_out.append(f'{path.name}, line {line}: {e}')
    points = [int((np.isfinite(x) & np.isfinite(z)).sum()) for _, _, x, z in found]
    least = max(2.0, SHORT * float(np.median(points))) if points else 0.0
    good = [f for f, n in zip(found, points, strict=True) if n >= least]
    left_out += [
        f'{path.name}, line {f[0]}: only {n} points' for f, n in zip(found, points, strict=True) if n < least
    ]  # fmt: skip
    if not good:
        raise RecordError(f'{path.name}: no profile in it')
    stamps = np.array([f[1] for f in good], np.int64)
    start = stamps[0] // round(HOUR * 1e9) * round(HOUR * 1e9)
    x, z = _stack([f[2] for f in good]), _stack([f[3] for f in good])
    return LaserScan((stamps - start) * 1e-9, x * 1e-3, z * 1e-3)


def _stack(rows: list[np.ndarray]) -> np.ndarray:
    """(n, longest), NaN behind the end of shorter rows."""
    out = np.full((len(rows), max(map(len, rows))), np.nan)
    for i, row in enumerate(rows):
        out[i, : len(row)] = row
    return out


def read_log(path: Path, left_out: list[str]) -> ArcLog:
    """time as minute:second.tenth, position in mm, speed and WFS in m/min, I in A, U in V."""
    columns = ('time', 'x', 'y', 'z', 'speed', 'ArcOn', 'WFS', 'I', 'U')
    table = _table(path, columns, left_out)
    at = [table.head.index(c) for c in columns]
    clock, rows = times.reader('minute_second'), []
    for line, cells in table.rows:
        try:
            row = [clock(cells[at[0]]) * 1e-9, *(number(cells[k], '.') for k in at[1:])]
            if not np.isfinite(row).all():
                raise ValueError('a field is empty or not a number')
            rows.append(row)
        except ValueError as e:
            left_out.append(f'{path.name}, line {line}: {e}')
    if not rows:
        raise RecordError(f'{path.name}: no line with data')
    a = np.array(rows)
    t = a[:, 0] + HOUR * np.cumsum(np.diff(a[:, 0], prepend=a[0, 0]) < -HOUR / 2)
    return ArcLog(t, a[:, 1:4] * 1e-3, a[:, 4] / 60, a[:, 5] != 0, a[:, 6] / 60, a[:, 7], a[:, 8])


def restore_times(stamps: np.ndarray, x: np.ndarray, speed: float) -> np.ndarray:
    """Times (n,) s of a motion x (n,) m at constant signed speed (m/s) whose stamps were truncated to QUANTUM.

    t = c + x / speed must satisfy stamp <= t < stamp + QUANTUM in every row; c is the middle of what all rows allow.
    """
    rest = stamps - x / speed
    return 0.5 * (rest.max() + rest.min() + QUANTUM) + x / speed


def find_scans(log: ArcLog) -> list[ScanMotion]:
    """The scans in a log: arc off, one way along x, z level."""
    x, z = log.position[:, 0], log.position[:, 2]
    good = (np.abs(np.diff(x, prepend=x[0])) > 0.5e-3) & ~log.arc
    good &= np.abs(np.diff(z, prepend=z[0])) < LEVEL
    edges = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
    found = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        rows = np.arange(start, end)[1:-1]  # the robot blends into and out of the motion
        rows = rows[np.abs(z[rows] - np.median(z[rows])) < LEVEL] if len(rows) else rows
        if len(rows) < 10 or np.ptp(x[rows]) < MIN_LENGTH:
            continue
        if (np.diff(x[rows]) * np.sign(x[rows[-1]] - x[rows[0]]) > 0).all():
            found.append(rows)
    if not found:
        return []
    speed = float(np.mean(log.speed[np.concatenate(found)]))  # all scans are programmed alike
    signed = [float(np.copysign(speed, x[rows[-1]] - x[rows[0]])) for rows in found]
    return [
        ScanMotion(rows, restore_times(log.t[rows], x[rows], v), v)
        for rows, v in zip(found, signed, strict=True)
    ]


def clock_lag(laser: LaserScan, log: ArcLog, motion: ScanMotion) -> float:
    """Seconds to add to laser times so that they become times of the log, from the lift at the end of the scan; NaN
    when the profiles do not show it."""
    distance = np.nanmedian(laser.range, axis=1)
    level = np.median(distance)
    last = np.flatnonzero(np.abs(distance - level) < 0.5e-3)
    if len(last) == 0 or last[-1] > len(distance) - 4 or distance[-1] - level < 8e-3:
        return float('nan')
    ramp = np.arange(last[-1] - 1, len(distance))
    end = motion.rows[-1]
    rows = np.arange(end, min(end + 12, len(log.t)))
    t_robot = motion.t[-1] + float(np.median(np.diff(motion.t))) * np.arange(len(rows))
    rise = log.position[rows, 2] - log.position[end, 2]
    levels = np.linspace(3e-3, min(9e-3, float(rise.max())), 7)
    seen = np.interp(levels, np.maximum.accumulate(distance[ramp] - level), laser.t[ramp])
    return float(np.median(np.interp(levels, np.maximum.accumulate(rise), t_robot) - seen))


def fit_substrate(points: np.ndarray) -> tuple[float, float, float]:
    """The plane that most points (n, 3) lie on: from those near the commonest height, then clipped least squares."""
    z = points[:, 2]
    counts, edges = np.histogram(z, bins=np.arange(z.min(), z.max() + 1e-3, 0.5e-3))
    mode = edges[np.argmax(np.convolve(counts, np.ones(4), 'same'))]
    use = np.abs(z - mode) < 1.5e-3
    design = np.column_stack([np.ones(len(points)), points[:, :2]])
    for _ in range(12):
        p = np.linalg.lstsq(design[use], z[use], rcond=None)[0]
        residual = z - design @ p
        use = np.abs(residual) < 3.0 * 1.4826 * float(np.median(np.abs(residual[use])))
    return float(p[0]), float(p[1]), float(p[2])


def prepare(laser: LaserScan, log: ArcLog, motion: ScanMotion, lag: float) -> RecordedScan:
    """Poses and substrate of one scan."""
    track = PoseTrack(len(motion.rows) + 1)
    for t, p in sorted(zip(motion.t, log.position[motion.rows], strict=True), key=lambda tp: tp[0]):
        track.append(round(float(t) * 1e9), *map(float, p))
    stamps = np.round((laser.t + lag) * 1e9).astype(np.int64)
    tcp, status = track.at(stamps, MAX_POSE_GAP_NS)
    ok = status == PoseStatus.OK
    if ok.sum() < 10:
        raise RecordError(f'only {ok.sum()} profiles fall into the scanning motion of the robot')
    points = Mounting(np.zeros(3), ACROSS).points(tcp[ok], laser.x[ok], -laser.range[ok])
    plane = fit_substrate(points[np.isfinite(points).all(axis=-1)])
    return RecordedScan(laser, motion, track, stamps, plane)


def place(scan: RecordedScan, shift: tuple[float, float]) -> tuple[PoseTrack, Mounting]:
    """Poses and mounting of a scan in levelled axes: z along the normal of the substrate, zero on it."""
    a, b, c = scan.plane
    level = rotation_rpy(-np.arctan(c), np.arctan(b), 0.0)
    track = PoseTrack(len(scan.track) + 1)
    for t, p in zip(scan.track.stamps, scan.track.positions, strict=True):
        track.append(int(t), *map(float, level @ (p - np.array([0.0, 0.0, a]))))
    return track, Mounting(np.array([*shift, 0.0]), level @ ACROSS)


def fuse(scan: RecordedScan, spec: GridSpec, shift: tuple[float, float]) -> FusedMap:
    """Heights above the substrate on `spec`."""
    track, mounting = place(scan, shift)
    limits = FusionLimits(height_min=BELOW, height_max=ABOVE)
    session = Session(Fusion(spec, mounting, limits), track, MAX_POSE_GAP_NS)
    x, z = (a.astype(np.float32) for a in (scan.laser.x, -scan.laser.range))
    session.add(ProfileBlock(scan.stamps, x, z))
    return session.close()


def profile_points(scan: RecordedScan, shift: tuple[float, float]) -> np.ndarray:
    """(n, m, 3) m, the points of all profiles that have a pose, in the axes of the map."""
    track, mounting = place(scan, shift)
    tcp, status = track.at(scan.stamps, MAX_POSE_GAP_NS)
    ok = status == PoseStatus.OK
    return mounting.points(tcp[ok], scan.laser.x[ok], -scan.laser.range[ok])


def grid_of(scans: list[RecordedScan], cell: float, shift: tuple[float, float]) -> GridSpec:
    """A grid for all scans: over the motion along x, over the field of view along y."""
    x = np.concatenate([s.track.positions[:, 0] for s in scans]) + shift[0]
    y = np.concatenate([s.track.positions[:, 1] for s in scans]) + shift[1]
    lateral = scans[0].laser.x[np.isfinite(scans[0].laser.x)]
    left, right = np.percentile(lateral, [1, 99])
    x0, y0 = (float(np.floor(v / cell) * cell) for v in (x.min(), y.min() + left))
    return GridSpec.covering(x0, y0, float(x.max()), float(y.max() + right), cell)


def find_bead(before: FusedMap, after: FusedMap) -> Bead:
    """The bead that is on `after` and not on `before` (same grid): the rows around the fullest one that touch it
    without a break, not spatter elsewhere."""
    growth = np.nan_to_num(after.z - before.z, nan=0.0)
    spec = after.spec
    if (growth > 1e-3).sum() <= 20:
        raise RecordError('no bead appears between the first and the last scan')
    mask = growth > 0.5 * np.percentile(growth[growth > 1e-3], 90)
    full = mask.sum(axis=1)
    best = low = high = int(np.argmax(full))
    while low > 0 and full[low - 1] > 0.2 * full[best]:
        low -= 1
    while high < len(full) - 1 and full[high + 1] > 0.2 * full[best]:
        high += 1
    mask[:low], mask[high + 1 :] = False, False
    rows, cols = np.nonzero(mask)
    axis = float(np.average(spec.y[rows], weights=growth[rows, cols]))
    return Bead(axis, float(spec.x[cols.min()]), float(spec.x[cols.max()]))


def scanner_shift(scans: list[RecordedScan], log: ArcLog, cell: float) -> tuple[float, float]:
    """(x, y) m of the scanner against the torch: puts the middle of the bead where the arc was."""
    if not log.arc.any():
        raise RecordError('the arc was never on in the arc log')
    nowhere = (0.0, 0.0)
    spec = grid_of(scans, cell, nowhere)
    bead = find_bead(fuse(scans[0], spec, nowhere), fuse(scans[-1], spec, nowhere))
    x, y = log.position[log.arc, 0], log.position[log.arc, 1]
    middle = 0.5 * (float(x.min()) + float(x.max()))
    return middle - 0.5 * (bead.start + bead.end), float(np.median(y)) - bead.axis


def match_scans(
    lasers: dict[str, LaserScan], log: ArcLog, left_out: list[str]
) -> dict[str, tuple[ScanMotion, float]]:
    """Name of the laser file -> the motion that is nearest in time, and the lag of its clock (s; NaN: not seen)."""
    motions = find_scans(log)
    found: dict[str, tuple[ScanMotion, float]] = {}
    for name, laser in lasers.items():
        t = float(np.median(laser.t))
        near = min(motions, key=lambda m: abs(float(np.median(m.t)) - t), default=None)
        if near is None or abs(float(np.median(near.t)) - t) > CLOCKS_APART:
            left_out.append(f'{name}: no scanning motion in the arc log at {t:.1f} s of the hour')
        elif any(near is m for m, _ in found.values()):
            left_out.append(f'{name}: another laser file belongs to the same motion of the arc log')
        else:
            found[name] = near, clock_lag(laser, log, near)
    return found


def fuse_wall(
    lasers: dict[str, LaserScan], log: ArcLog, cell: float, left_out: list[str]
) -> WallMaps:
    """One map per laser file on a common grid. A scan that cannot be used is left out by name, as long as two are
    left: one before the bead and one after. RecordError."""
    matched = match_scans(lasers, log, left_out)
    _two(matched)
    lags = [lag for _, lag in matched.values()]
    if not np.isfinite(lags).any():
        raise RecordError('no scan shows the lift at its end; the clocks stay unknown')
    lag = float(np.nanmedian(lags))
    ready: dict[str, RecordedScan] = {}
    for name, (motion, _) in matched.items():
        try:
            ready[name] = prepare(lasers[name], log, motion, lag)
        except (RecordError, np.linalg.LinAlgError) as e:
            left_out.append(f'{name}: {e}')
    _two(ready)
    shift = _shift(ready, log, cell, left_out)
    scans = list(ready.values())
    spec = grid_of(scans, cell, shift)
    maps = [fuse(s, spec, shift) for s in scans]
    return WallMaps(scans, shift, maps, find_bead(maps[0], maps[-1]), left_out)


def _two(scans: dict) -> None:
    if len(scans) < 2:
        raise RecordError('at least two scans are needed: one before the bead and one after')


def _shift(
    ready: dict[str, RecordedScan], log: ArcLog, cell: float, left_out: list[str]
) -> tuple[float, float]:
    """From the last scan that shows a bead; later ones that do not leave `ready`."""
    while True:
        try:
            return scanner_shift(list(ready.values()), log, cell)
        except RecordError as e:
            if len(ready) <= 2 or not log.arc.any():
                raise
            name = list(ready)[-1]
            left_out.append(f'{name}: {e}')
            del ready[name]
