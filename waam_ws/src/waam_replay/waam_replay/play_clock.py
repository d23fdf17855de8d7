"""The time of a replay: recorded time that runs with wall time, can be paused, set and made faster or slower.

Wall time enters as an argument (a steady clock, s), so that tests need not wait.
"""

from __future__ import annotations


class PlayClock:
    """One pair of recorded and steady time; everything else follows from rate and pause.

    start_ns: recorded time at the beginning; rate: recorded seconds per second, above 0.
    """

    def __init__(self, start_ns: int, rate: float, paused: bool, now: float) -> None:
        self._at_ns, self._since = start_ns, now
        self._rate, self.paused = self._checked(rate), paused

    @staticmethod
    def _checked(rate: float) -> float:
        if not 0.001 <= rate <= 1000.0:
            raise ValueError(f'rate is {rate}, must be 0.001 .. 1000')
        return rate

    @property
    def rate(self) -> float:
        """Recorded seconds per second; also the one that holds again after a pause."""
        return self._rate

    def now_ns(self, now: float) -> int:
        """Recorded time at steady time `now`."""
        if self.paused:
            return self._at_ns
        return self._at_ns + round((now - self._since) * self._rate * 1e9)

    def seek(self, at_ns: int, now: float) -> None:
        """Recorded time is `at_ns` (ns) at steady time `now` (s)."""
        self._at_ns, self._since = at_ns, now

    def set_rate(self, rate: float, now: float) -> None:
        """ValueError when the rate is outside 0.001 .. 1000."""
        checked = self._checked(rate)
        self.seek(self.now_ns(now), now)
        self._rate = checked

    def pause(self, now: float) -> None:
        """now: steady time, s."""
        self.seek(self.now_ns(now), now)
        self.paused = True

    def resume(self, now: float) -> None:
        """now: steady time, s."""
        self.seek(self.now_ns(now), now)
        self.paused = False
