"""From the controller's clock to ROS time. Pure: every time is an argument."""

from __future__ import annotations

from collections import deque

import numpy as np

BIN_US = 2_000_000  # us of controller time; of each such stretch the fastest round trip is kept
BINS = 40  # stretches that a fit uses
SLOWEST = 2.0  # times the median of their round trips beyond which a stretch does not count
SPAN = 3.0  # s of controller time before the drift is estimated
SLACK = 2e-3  # s by which the line may leave the bracket of a round trip: 200 ppm for 10 s
JUMPS = 8  # brackets missed in a row that mean that a clock was reset
ERRORS = 300  # predictions of which the residual is the 99th percentile


class ClockMap:
    """ROS time as a line over controller time, fitted through the middles of the fastest round trips.

    A round trip sent at s and answered at r (ROS time) brackets the controller's stamp; its middle is wrong by at most
    half its duration. Delays are one-sided (a busy host, a full cable), so the fastest of each two seconds carries the
    information and the others none. `synchronised`: the controller's clock *is* ROS time.
    `residual`: how far off the line was at the next fastest round trip, before the fit was repeated.
    """

    def __init__(self) -> None:
        self.reset(False)

    def reset(self, synchronised: bool) -> None:
        """Forgets everything: another clock."""
        self.synchronised = synchronised
        self.residual = 0.0  # s, p99
        self._errors: deque[float] = deque(maxlen=ERRORS)
        self._start()

    def _start(self) -> None:
        """Starts a new line, because one of the clocks was reset."""
        self.drift = 0.0  # s/s
        self._t0 = self._ros0 = 0  # us, ns: the line goes through here
        self._best: deque[tuple[int, int, int]] = deque(maxlen=BINS)  # t us, middle ns, rtt ns
        self._now: tuple[int, int, int] | None = None  # fastest of the stretch that is not over
        self._jumps = 0

    @property
    def ready(self) -> bool:
        """Whether `to_ros_ns` gives a time that may be published."""
        return self.synchronised or self._now is not None

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
        if self.synchronised or received_ns < sent_ns:
            return
        if self._jumped(sent_ns, received_ns, t_us):
            self._start()
        sample = (t_us, (sent_ns + received_ns) // 2, received_ns - sent_ns)
        fastest = self._now
        if fastest is None:
            self._now = sample
            self._fit()
        elif t_us // BIN_US != fastest[0] // BIN_US:
            self._close_bin(fastest, sample)
        elif sample[2] < fastest[2]:
            self._now = sample
            if not self._best:
                self._fit()

    def _jumped(self, sent_ns: int, received_ns: int, t_us: int) -> bool:
        """True when one of the clocks was reset: the line keeps missing the brackets."""
        if self._now is None:
            return False
        ros, slack = self.to_ros_ns(t_us), round(SLACK * 1e9)
        outside = not sent_ns - slack <= ros <= received_ns + slack
        self._jumps = self._jumps + 1 if outside else 0
        return self._jumps >= JUMPS

    def _close_bin(self, fastest: tuple[int, int, int], sample: tuple[int, int, int]) -> None:
        t_us, middle, _ = fastest
        if self.drift:
            self._errors.append(abs(self.to_ros_ns(t_us) - middle) * 1e-9)
            self.residual = float(np.quantile(self._errors, 0.99))
        self._best.append(fastest)
        self._now = sample
        self._fit()

    def _fit(self) -> None:
        data = np.array(self._best or [self._now], np.int64)
        data = data[data[:, 2] <= SLOWEST * np.median(data[:, 2])]
        t0, ros0 = (int(v) for v in data[np.argmin(data[:, 2]), :2])
        t = (data[:, 0] - t0) * 1e-6
        excess = (data[:, 1] - ros0) * 1e-9 - t
        weight = 1.0 / (data[:, 2] * 1e-9 + 1e-5)
        slope = float(np.polyfit(t, excess, 1, w=weight)[0]) if np.ptp(t) > SPAN else 0.0
        level = float(np.average(excess - slope * t, weights=weight))
        self.drift, self._t0, self._ros0 = slope, t0, ros0 + round(level * 1e9)
