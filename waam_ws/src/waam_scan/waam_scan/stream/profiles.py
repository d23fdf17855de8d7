"""Batches of profiles on their way to the fusion: what they hold, in which order they come, and what became of them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from waam_node import cdr

BREAK = 3.0  # profile periods: a longer pause between two profiles is counted


@dataclass(frozen=True)
class ProfileBlock:
    """n profiles of one scanner with m points each; m may be one."""

    stamps: np.ndarray  # (n,) int64 ns of the pose clock, in any order
    x: np.ndarray  # (n, m) float32 m, scanner frame, NaN = no return
    z: np.ndarray  # (n, m) float32 m

    def __post_init__(self) -> None:
        shape = (len(self.stamps), *self.x.shape[1:])
        if self.x.ndim != 2 or self.x.shape != shape or self.z.shape != shape:
            raise ValueError(
                f'{len(self.stamps)} stamps, x {self.x.shape} and z {self.z.shape} do not fit together'
            )

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, which: np.ndarray) -> ProfileBlock:
        """The profiles of a mask; all of them cost nothing."""
        if which.all():
            return self
        return ProfileBlock(self.stamps[which], self.x[which], self.z[which])

    def shifted(self, delay_ns: int) -> ProfileBlock:
        """With stamps on another clock."""
        return ProfileBlock(self.stamps + delay_ns, self.x, self.z)


def block_of(
    sequence: int, n: int, m: int, start_ns: int, offsets: np.ndarray, x: np.ndarray, z: np.ndarray
) -> ProfileBlock:
    """n profiles of m points from the flat arrays of batch `sequence`; offsets (n,) ns from start_ns. ValueError names
    the array whose length does not fit."""
    for name, values, want in (('stamp_offsets_ns', offsets, n), ('x', x, n * m), ('z', z, n * m)):
        if len(values) != want:
            raise ValueError(
                f'batch {sequence}: {name} has {len(values)} values, '
                f'{n} profiles of {m} points need {want}'
            )
    if n == 0 or m == 0:
        raise ValueError(f'batch {sequence}: {n} profiles of {m} points is an empty batch')
    return ProfileBlock(start_ns + offsets, x.reshape(n, m), z.reshape(n, m))


def read_batch(data: bytes) -> tuple[int, ProfileBlock]:
    """Sequence number and profiles of a serialised waam_msgs/ProfileBatch. ValueError says what is wrong with it."""
    b = cdr.read_batch(data)
    n, m = b.profile_count, b.points_per_profile
    return b.sequence, block_of(b.sequence, n, m, b.stamp_ns, b.stamp_offsets_ns, b.x, b.z)


REASONS = {
    'empty': 'without a single return',
    'gap': 'in a gap of the telemetry',
    'too_old': 'before the oldest telemetry',
    'no_pose': 'without telemetry around them',
    'overflow': 'dropped while waiting for telemetry',
    'repeated': 'that were there already (same time stamp)',
    'forgotten': 'too late to tell whether they were there already',
    'stale': 'from before the scan began',
}


@dataclass
class ProfileCounts:
    """How many profiles were used, and why the others were not (`REASONS`). out_of_order and breaks are no rejections:
    profiles that came after younger ones, and pauses of more than three profile periods; longest_break in s."""

    used: int = 0
    empty: int = 0
    gap: int = 0
    too_old: int = 0
    no_pose: int = 0
    overflow: int = 0
    repeated: int = 0
    forgotten: int = 0
    stale: int = 0
    out_of_order: int = 0
    breaks: int = 0
    longest_break: float = 0.0

    @property
    def rejected(self) -> int:
        """Profiles of all `REASONS` together."""
        return sum(getattr(self, name) for name in REASONS)

    @property
    def untrusted(self) -> int:
        """Profiles that saw the part but could not be placed. Empty ones (scanner lifted, beside the part) and those
        from before the scan are no sign of trouble."""
        return self.rejected - self.empty - self.stale

    def reasons(self) -> list[str]:
        """What was rejected, in words; empty when nothing was."""
        return [f'{getattr(self, k)} profiles {v}' for k, v in REASONS.items() if getattr(self, k)]

    def remarks(self) -> list[str]:
        """What was noticed without rejecting anything."""
        words = []
        if self.out_of_order:
            words.append(f'{self.out_of_order} profiles came out of order')
        if self.breaks:
            words.append(
                f'{self.breaks} pauses between profiles, the longest {self.longest_break:.3f} s'
            )
        return words


@dataclass
class StampWatch:
    """Tells new profiles from repeated ones by their stamps, of which it remembers the last `keep`."""

    keep: int = 200_000
    newest_ns: int | None = None
    period_ns: int | None = None  # typical distance of consecutive profiles
    _recent: deque[np.ndarray] = field(default_factory=deque)
    _kept: int = 0
    _forgot_ns: int = -(2**62)  # stamps up to here are no longer remembered

    def check(self, stamps: np.ndarray, counts: ProfileCounts) -> np.ndarray:
        """Mask (n,) of the profiles that are new; the others, order and pauses are counted."""
        newest = self.newest_ns
        steps = np.diff(stamps, prepend=stamps[0] - 1 if newest is None else newest)
        new = np.ones(len(stamps), bool)
        if (steps > 0).all():
            self._measure(steps if newest is not None else steps[1:], counts)
        else:
            new = self._sort_out(stamps, counts)
        if new.any():
            self._remember(stamps[new])
        return new

    def _measure(self, steps: np.ndarray, counts: ProfileCounts) -> None:
        """Profile period and pauses from rising stamps."""
        if not len(steps):
            return
        typical = float(np.median(steps))
        if self.period_ns is None or len(steps) > 2:
            self.period_ns = max(1, round(typical))
        elif typical < BREAK * self.period_ns:
            self.period_ns = max(1, round(0.9 * self.period_ns + 0.1 * typical))
        long = steps[steps > BREAK * self.period_ns]
        if len(long):
            counts.breaks += len(long)
            counts.longest_break = max(counts.longest_break, float(long.max()) * 1e-9)

    def _sort_out(self, stamps: np.ndarray, counts: ProfileCounts) -> np.ndarray:
        forgotten = stamps <= self._forgot_ns
        first = np.zeros(len(stamps), bool)
        first[np.unique(stamps, return_index=True)[1]] = True
        for known in self._recent:
            first &= ~np.isin(stamps, known)
        new = first & ~forgotten
        counts.forgotten += int(forgotten.sum())
        counts.repeated += int((~first & ~forgotten).sum())
        before = np.maximum.accumulate(
            np.r_[-(2**62) if self.newest_ns is None else self.newest_ns, stamps]
        )
        counts.out_of_order += int((new & (stamps < before[:-1])).sum())
        return new

    def _remember(self, stamps: np.ndarray) -> None:
        self._recent.append(stamps)
        self._kept += len(stamps)
        while self._kept - len(self._recent[0]) >= self.keep:
            old = self._recent.popleft()
            self._kept -= len(old)
            self._forgot_ns = max(self._forgot_ns, int(old.max()))
        last = int(stamps.max())
        self.newest_ns = last if self.newest_ns is None else max(self.newest_ns, last)


@dataclass
class SequenceWatch:
    """Counts the batches that are missing by their numbers; late ones are taken off again."""

    keep: int = 10_000
    newest: int | None = None
    _given_up: int = 0  # missing ones of a scanner that was restarted, or more than are remembered
    _missing: set[int] = field(default_factory=set)

    @property
    def lost(self) -> int:
        """Batches that did not come, or not yet."""
        return self._given_up + len(self._missing)

    def follow(self, sequence: int, newer: bool) -> None:
        """newer: the batch holds profiles younger than all before it; a falling number then is a restarted scanner."""
        if self.newest is None or sequence > self.newest:
            first = sequence if self.newest is None else self.newest + 1
            room = self.keep - len(self._missing)
            self._missing.update(range(first, min(sequence, first + room)))
            self._given_up += max(0, sequence - first - room)
            self.newest = sequence
        elif sequence in self._missing:
            self._missing.discard(sequence)
        elif newer:
            self._given_up += len(self._missing)
            self._missing.clear()
            self.newest = sequence
