"""Where the wire tip was when a profile was taken: a bounded track of telemetry, interpolated at profile stamps.

Stamps are integer nanoseconds of one clock (a float of seconds since 1970 resolves only 0.2 us), positions metres in
the work frame. Nothing is extrapolated: a stamp without telemetry close on both sides gets no pose.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

MAX_GAP_NS = (
    30_000_000  # between two frames; a profile between telemetry frames further apart is rejected
)


class PoseStatus(IntEnum):
    """What `PoseTrack.at` knows about a stamp."""

    OK = 0
    WAITING = 1  # newer than the newest telemetry: may still come
    GAP = 2  # between two telemetry frames that are further apart than the limit
    TOO_OLD = 3  # before the oldest frame of the track


class PoseTrack:
    """The last `capacity` telemetry positions. Appending costs the same at any length.

    Frames with the stamp of the newest one are dropped and counted as `repeated`, older ones as `out_of_order`.
    A step back by more than `restart_ns` is a clock that was set anew (the simulation was restarted): the track starts
    afresh and counts `restarts`.
    """

    def __init__(self, capacity: int, restart_ns: int = 1_000_000_000) -> None:
        if capacity < 2:
            raise ValueError(f'a pose track needs a capacity of at least 2 frames, not {capacity}')
        self._capacity = capacity
        self._restart_ns = restart_ns
        self._t = np.empty(2 * capacity, np.int64)
        self._p = np.empty((2 * capacity, 3))
        self._n = 0
        self._newest = -(2**63)
        self.accepted = self.repeated = self.out_of_order = self.restarts = self.not_finite = 0

    def __len__(self) -> int:
        return min(self._n, self._capacity)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest position, ns; None while there is none."""
        return self._newest if self._n else None

    @property
    def stamps(self) -> np.ndarray:
        """(n,) ns, strictly rising; a view."""
        return self._t[max(0, self._n - self._capacity) : self._n]

    @property
    def positions(self) -> np.ndarray:
        """(n, 3) m, work frame; a view."""
        return self._p[max(0, self._n - self._capacity) : self._n]

    def clear(self) -> None:
        """Forgets the frames; the counters stay."""
        self._n = 0
        self._newest = -(2**63)

    def append(self, t_ns: int, x: float, y: float, z: float) -> bool:
        """True when the frame was taken; otherwise one of the counters says why not."""
        if not (x - x == 0.0 and y - y == 0.0 and z - z == 0.0):  # NaN or infinite
            self.not_finite += 1
            return False
        if t_ns <= self._newest and not self._restarted(t_ns):
            return False
        n = self._n
        if n == len(self._t):
            n = self._compact()
        self._t[n] = t_ns
        p = self._p
        p[n, 0], p[n, 1], p[n, 2] = x, y, z  # a third of the time that a tuple takes
        self._n, self._newest = n + 1, t_ns
        self.accepted += 1
        return True

    def _restarted(self, t_ns: int) -> bool:
        if t_ns == self._newest:
            self.repeated += 1
        elif t_ns >= self._newest - self._restart_ns:
            self.out_of_order += 1
        else:
            self.restarts += 1
            self.clear()
            return True
        return False

    def _compact(self) -> int:
        keep = self._capacity
        self._t[:keep] = self._t[-keep:]
        self._p[:keep] = self._p[-keep:]
        return keep

    def at(self, stamps_ns: np.ndarray, max_gap_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) in m and PoseStatus (n,) at stamps (n,); NaN where the status is not OK.

        Linear between the two frames around a stamp, which may be `max_gap_ns` apart at most. A stamp that equals a
        frame's needs no partner.
        """
        stamps = np.asarray(stamps_ns, np.int64)
        t, p = self.stamps, self.positions
        if len(t) == 0:
            return np.full((len(stamps), 3), np.nan), np.full(len(stamps), int(PoseStatus.WAITING))
        after = np.searchsorted(t, stamps, side='left')
        status = np.where(after == len(t), int(PoseStatus.WAITING), int(PoseStatus.OK))
        hi = np.minimum(after, len(t) - 1)
        exact = t[hi] == stamps
        status[(after == 0) & ~exact] = PoseStatus.TOO_OLD
        lo = np.where(exact, hi, np.maximum(hi - 1, 0))
        span = t[hi] - t[lo]
        status[(status == PoseStatus.OK) & (span > max_gap_ns)] = PoseStatus.GAP
        share = np.where(span > 0, (stamps - t[lo]) / np.maximum(span, 1), 0.0)
        out = p[lo] + share[:, None] * (p[hi] - p[lo])
        out[status != PoseStatus.OK] = np.nan
        return out, status
