"""Brings profiles and poses together: profiles wait until telemetry brackets them, then go into the fusion."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from .fusion import Fusion
from .poses import PoseStatus, PoseTrack


@dataclass(frozen=True)
class ProfileBlock:
    """Consecutive profiles. stamps: (n,) int64 ns of the pose clock; x, z: (n, m) float32 m, scanner frame, NaN = no
    return."""

    stamps: np.ndarray
    x: np.ndarray
    z: np.ndarray

    def __post_init__(self) -> None:
        shape = (len(self.stamps), *self.x.shape[1:])
        if self.x.ndim != 2 or self.x.shape != shape or self.z.shape != shape:
            raise ValueError(
                f'{len(self.stamps)} stamps, x {self.x.shape} and z {self.z.shape} do not fit together'
            )

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, which: np.ndarray) -> ProfileBlock:
        return ProfileBlock(self.stamps[which], self.x[which], self.z[which])


@dataclass
class ProfileCounts:
    """How many profiles were used, and why the others were not."""

    used: int = 0
    empty: int = 0  # not one return
    gap: int = 0  # telemetry around it too far apart
    too_old: int = 0  # before the telemetry that is kept
    no_pose: int = 0  # telemetry never came
    overflow: int = 0  # too many were waiting
    repeated: int = 0  # stamp not after the one before
    stale: int = 0  # taken before the scan began

    @property
    def rejected(self) -> int:
        return sum(vars(self).values()) - self.used

    @property
    def untrusted(self) -> int:
        """Profiles that saw the part but could not be placed. Empty ones (scanner lifted, beside the part) and those
        from before the scan are no sign of trouble."""
        return self.rejected - self.empty - self.stale

    def reasons(self) -> list[str]:
        """What was rejected, in words; empty when nothing was."""
        words = {
            'empty': 'without a single return',
            'gap': 'in a gap of the telemetry',
            'too_old': 'before the oldest telemetry',
            'no_pose': 'without telemetry around them',
            'overflow': 'dropped while waiting for telemetry',
            'repeated': 'with a repeated or earlier time stamp',
            'stale': 'from before the scan began',
        }
        return [f'{getattr(self, k)} profiles {v}' for k, v in words.items() if getattr(self, k)]


@dataclass
class Assembler:
    """`add` profiles, `resolve` after new telemetry, `close` at the end. Poses come from `track`."""

    fusion: Fusion
    track: PoseTrack
    max_gap_ns: int = 30_000_000
    max_waiting: int = 2000
    not_before_ns: int = -(2**62)  # profiles with earlier stamps belong to another surface
    counts: ProfileCounts = field(default_factory=ProfileCounts)
    newest_ns: int | None = None  # stamp of the newest profile that was added
    newest_used_ns: int | None = None
    _waiting: deque[ProfileBlock] = field(default_factory=deque)

    @property
    def waiting(self) -> int:
        """Profiles that wait for telemetry."""
        return sum(len(b) for b in self._waiting)

    def add(self, block: ProfileBlock) -> None:
        """Takes profiles whose stamps rise; those that do not are rejected, as are profiles without a return."""
        stamps = block.stamps + round(self.fusion.mounting.delay * 1e9)
        before = np.concatenate([[self._last_ns()], stamps[:-1]])
        rising = stamps > np.maximum.accumulate(before)
        fresh = stamps >= self.not_before_ns
        seen = np.isfinite(block.z).any(axis=1)
        self.counts.repeated += int((~rising).sum())
        self.counts.stale += int((rising & ~fresh).sum())
        empty = int((rising & fresh & ~seen).sum())
        self.counts.empty += empty
        self.fusion.dropouts += empty * block.z.shape[1]
        if rising.any():
            self.newest_ns = int(stamps[rising][-1])
        self._push(ProfileBlock(stamps, block.x, block.z).take(rising & fresh & seen))
        self.resolve()

    def _last_ns(self) -> int:
        return -(2**62) if self.newest_ns is None else self.newest_ns

    def _push(self, block: ProfileBlock) -> None:
        if len(block):
            self._waiting.append(block)
        while self.waiting > self.max_waiting:
            self.counts.overflow += len(self._waiting.popleft())

    def resolve(self) -> None:
        """Fuses every waiting profile that telemetry brackets now; rejects those that it never will."""
        newest = self.track.newest_ns
        while self._waiting and newest is not None and self._waiting[0].stamps[0] <= newest:
            rest = self._fuse(self._waiting.popleft())
            if len(rest):
                self._waiting.appendleft(rest)
                return

    def _fuse(self, block: ProfileBlock) -> ProfileBlock:
        """Returns what must still wait."""
        tcp, status = self.track.at(block.stamps, self.max_gap_ns)
        ok = status == PoseStatus.OK
        if ok.any():
            good = block if ok.all() else block.take(ok)
            self.fusion.add(tcp[ok], good.x, good.z)
            last = int(good.stamps[-1])
            self.newest_used_ns = max(self.newest_used_ns or last, last)
        self.counts.used += int(ok.sum())
        self.counts.gap += int((status == PoseStatus.GAP).sum())
        self.counts.too_old += int((status == PoseStatus.TOO_OLD).sum())
        return block.take(status == PoseStatus.WAITING)

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
