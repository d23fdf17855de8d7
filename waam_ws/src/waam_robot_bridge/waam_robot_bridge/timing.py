"""How late goals reach the robot's driver, and how far its clock is from this computer's.

Measured, told, and refused beyond a limit before the arc. All times in s; no ROS."""

from __future__ import annotations

from collections import deque
from statistics import median

KEPT = 50  # measurements
MIN_SAMPLES = 5  # of them, to say anything
LATE = 0.05  # s by which goals may take longer than `delay` to the driver
APART = 0.1  # s that the clocks may differ by: goals reach `goals.MIN_GOAL_DURATION` s ahead
WORTH_TELLING = 0.02  # s


class Timing:
    """delay: s, between command and goal (parameter `delay`)."""

    def __init__(self, delay: float) -> None:
        self._delay = delay
        self._answers: deque[float] = deque(maxlen=KEPT)
        self._ages: deque[float] = deque(maxlen=KEPT)

    def answered(self, seconds: float) -> None:
        """A goal was answered so long after it was sent."""
        self._answers.append(seconds)

    def stamped(self, age: float) -> None:
        """A joint state came that was so old by its stamp; negative = it lies in the future of this clock."""
        self._ages.append(age)

    @property
    def answer(self) -> float:
        """s from sending a goal to its answer, median; 0 = too few are known."""
        return median(self._answers) if len(self._answers) >= MIN_SAMPLES else 0.0

    @property
    def age(self) -> float:
        """s of joint states by their stamps, median; 0 = too few are known."""
        return median(self._ages) if len(self._ages) >= MIN_SAMPLES else 0.0

    def problem(self) -> str:
        """Why no arc should be struck, '' = nothing."""
        if self.answer > self._delay + LATE:
            return (
                f'goals take {self.answer * 1e3:.0f} ms to the driver, delay is {self._delay * 1e3:.0f} ms: raise '
                'delay and weld_delay, or see to the network'
            )
        if -self.age > APART:
            return (
                f'joint states are stamped {-self.age * 1e3:.0f} ms in the future: the clocks of robot and bridge '
                'differ, synchronise them'
            )
        if self.age > APART:
            return (
                f'joint states are {self.age * 1e3:.0f} ms old when they come: the network is slow, or the clocks of '
                'robot and bridge differ'
            )
        return ''

    def told(self) -> str:
        """What a person should know although it works, '' = nothing."""
        if abs(self.age) <= WORTH_TELLING:
            return ''
        when = 'in the future' if self.age < 0 else 'ago'
        return (
            f"the robot's joint states are stamped {abs(self.age) * 1e3:.0f} ms {when}: slow network, or clocks that "
            'differ'
        )

    def summary(self) -> str:
        """Both figures in words."""
        return (
            f'goals are answered after {self.answer * 1e3:.0f} ms, joint states are {self.age * 1e3:.0f} ms old by '
            'their stamps'
        )
