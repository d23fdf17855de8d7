"""From the controller's clock to ROS time. Pure: every time is an argument."""

from __future__ import annotations

from collections import deque

import numpy as np

WINDOW = 600  # round trips kept: 30 s at 20 Hz
REFIT = 10  # round trips between two fits
BEST = 0.3  # share of round trips, the fastest, that a fit uses
SPAN = 2.0  # s of controller time before the drift is estimated
JUMP = 0.1  # s by which ROS time must be off, JUMPS times in a row, to start afresh
JUMPS = 5


class ClockMap:
    """ROS time as a line over controller time, fitted through the middles of the fastest round trips.

    A round trip sent at s and answered at r (ROS time) brackets the controller's stamp; its middle is wrong by at most
    half its duration, so the fastest ones carry the information. `synchronised`: the controller's clock *is* ROS time.
    """

    def __init__(self) -> None:
        self.reset(False)

    def reset(self, synchronised: bool) -> None:
        """Forgets everything: another clock."""
        self.synchronised = synchronised
        self.drift = self.residual = 0.0  # s/s; s, p99 of the fit
        self._t0 = self._ros0 = 0  # us, ns: the line goes through here
        self._samples: deque[tuple[int, int, int]] = deque(maxlen=WINDOW)  # t us, middle ns, rtt ns
        self._count = self._jumps = 0

    @property
    def ready(self) -> bool:
        return self.synchronised or self._count > 0

    @property
    def offset(self) -> float:
        """ROS time minus controller clock, s, at the last fit."""
        return 0.0 if self.synchronised else self._ros0 * 1e-9 - self._t0 * 1e-6

    def to_ros_ns(self, t_us: int) -> int:
        """ROS time in ns of the controller's time in us."""
        if self.synchronised:
            return t_us * 1000
        elapsed = t_us - self._t0
        return self._ros0 + elapsed * 1000 + round(elapsed * 1e3 * self.drift)

    def add(self, sent_ns: int, received_ns: int, t_us: int) -> None:
        """One round trip: ROS times of sending and receiving, and the controller's time in between."""
        rtt = received_ns - sent_ns
        if self.synchronised or rtt < 0:
            return
        middle = (sent_ns + received_ns) // 2
        if self._jumped(t_us, middle, rtt):
            self.reset(False)
        self._samples.append((t_us, middle, rtt))
        self._count += 1
        if self._count <= REFIT or self._count % REFIT == 0:
            self._fit()

    def _jumped(self, t_us: int, middle: int, rtt: int) -> bool:
        """True when ROS time was set anew."""
        if not self._count:
            return False
        off = abs(self.to_ros_ns(t_us) - middle) > JUMP * 1e9 + rtt
        self._jumps = self._jumps + 1 if off else 0
        return self._jumps >= JUMPS

    def _fit(self) -> None:
        data = np.array(self._samples, np.int64)
        fastest = np.argsort(data[:, 2], kind='stable')[: max(1, int(BEST * len(data)))]
        t0, ros0 = (int(v) for v in data[fastest[0], :2])
        t = (data[fastest, 0] - t0) * 1e-6
        excess = (data[fastest, 1] - ros0) * 1e-9 - t
        slope = float(np.polyfit(t, excess, 1)[0]) if np.ptp(t) > SPAN else 0.0
        level = float(np.median(excess - slope * t))
        self.residual = float(np.quantile(np.abs(excess - slope * t - level), 0.99))
        self.drift, self._t0, self._ros0 = slope, t0, ros0 + round(level * 1e9)
