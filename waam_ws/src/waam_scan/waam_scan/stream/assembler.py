"""Brings profiles and poses together: profiles wait until telemetry brackets them, then go into the fusion."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ..fusion.height_map import Fusion
from ..fusion.kernels import read_only, rows_seen
from .poses import PoseStatus, PoseTrack
from .profiles import ProfileBlock, ProfileCounts, StampWatch

__all__ = ['Assembler', 'ProfileBlock', 'ProfileCounts']


@dataclass
class Assembler:
    """`add` profiles, `resolve` after new telemetry, `close` at the end. Poses come from `track`.

    intensity: points outside this range count as drop-outs (None: all are good).
    """

    fusion: Fusion
    track: PoseTrack
    max_gap_ns: int = 30_000_000
    max_waiting: int = 2000
    not_before_ns: int = -(2**62)  # profiles with earlier stamps belong to another surface
    intensity: tuple[float, float] | None = None
    counts: ProfileCounts = field(default_factory=ProfileCounts)
    watch: StampWatch = field(default_factory=StampWatch)
    oldest_used_ns: int | None = None
    newest_used_ns: int | None = None
    oldest_empty_ns: int | None = None
    newest_empty_ns: int | None = None
    _waiting: deque[ProfileBlock] = field(default_factory=deque)

    @property
    def waiting(self) -> int:
        """Profiles that wait for telemetry."""
        return sum(len(b) for b in self._waiting)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest profile that was added."""
        return self.watch.newest_ns

    def add(self, block: ProfileBlock) -> None:
        """Takes profiles in any order; repeated ones, those from before the scan and those without a return are
        rejected."""
        if not len(block):
            return
        if self.intensity is not None:
            block = block.gated(*self.intensity)
        block = block.shifted(round(self.fusion.mounting.delay * 1e9))
        new = self.watch.check(block.stamps, self.counts)
        fresh = block.stamps >= self.not_before_ns
        seen = rows_seen(read_only(block.x), read_only(block.z))
        self.counts.stale += int((new & ~fresh).sum())
        self._pass_over(block.take(new & fresh & ~seen))
        self._push(block.take(new & fresh & seen))
        self.resolve()

    def _pass_over(self, empty: ProfileBlock) -> None:
        """Profiles without a return, as beside a tall part, where the table is out of range."""
        if len(empty):
            self.counts.empty += len(empty)
            self.fusion.dropouts += empty.z.size
            first, last = int(empty.stamps.min()), int(empty.stamps.max())
            self.oldest_empty_ns = min(self.oldest_empty_ns or first, first)
            self.newest_empty_ns = max(self.newest_empty_ns or last, last)

    def _push(self, block: ProfileBlock) -> None:
        if len(block):
            self._waiting.append(block)
        while self.waiting > self.max_waiting and len(self._waiting) > 1:
            self.counts.overflow += len(self._waiting.popleft())

    def resolve(self) -> None:
        """Fuses every waiting profile that telemetry brackets now; rejects those that it never will."""
        newest = self.track.newest_ns
        if newest is None:
            return
        for _ in range(len(self._waiting)):
            block = self._waiting.popleft()
            rest = self._fuse(block) if int(block.stamps.min()) <= newest else block
            if len(rest):
                self._waiting.append(rest)

    def _fuse(self, block: ProfileBlock) -> ProfileBlock:
        """Returns what must still wait."""
        tcp, status = self.track.at(block.stamps, self.max_gap_ns)
        ok = status == PoseStatus.OK
        if ok.any():
            good = block.take(ok)
            self.fusion.add(tcp[ok], good.x, good.z)
            first, last = int(good.stamps.min()), int(good.stamps.max())
            self.oldest_used_ns = min(self.oldest_used_ns or first, first)
            self.newest_used_ns = max(self.newest_used_ns or last, last)
        self.counts.used += int(ok.sum())
        self.counts.gap += int((status == PoseStatus.GAP).sum())
        self.counts.too_old += int((status == PoseStatus.TOO_OLD).sum())
        return block.take(status == PoseStatus.WAITING)

    @property
    def empty_ends(self) -> tuple[float, float]:
        """How far the scan went without seeing anything at its beginning and at its end, m; beside a tall part the
        table is out of range. The time for which the scanner stands at an end does not count. Where telemetry does not
        reach back so far, the times themselves, s."""
        if self.oldest_used_ns is None or self.oldest_empty_ns is None:
            return 0.0, 0.0
        first, last = self.oldest_used_ns, self.newest_used_ns or 0
        begin, end = min(self.oldest_empty_ns, first), max(self.newest_empty_ns or 0, last)
        tcp, status = self.track.at(np.array([begin, first, last, end]), self.max_gap_ns)
        if (status != PoseStatus.OK).any():
            return (first - begin) * 1e-9, (end - last) * 1e-9
        return float(np.linalg.norm(tcp[1] - tcp[0])), float(np.linalg.norm(tcp[3] - tcp[2]))

    def close(self) -> None:
        """Telemetry ends here: what still waits is rejected."""
        self.resolve()
        self.counts.no_pose += self.waiting
        self._waiting.clear()

    def why_empty(self) -> str:
        """The reason for a map without a single point."""
        c, f = self.counts, self.fusion
        if not (c.used or c.rejected):
            return 'no profiles arrived'
        if c.used == 0 and c.empty == c.rejected:
            return f'all {c.empty} profiles are drop-outs: the scanner saw nothing'
        if c.used == 0:
            return 'no profile has a trustworthy pose: ' + ', '.join(c.reasons())
        inside = f.points - f.outside - f.dropouts
        if f.outside and inside <= 0:
            return f'all {f.outside} points lie outside the grid or the height limits (mounting or work zero wrong?)'
        return f'{c.used} profiles gave no point that a neighbour supports'
