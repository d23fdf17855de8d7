"""The output of source 004: pulses of a handwheel on two lines A and B that turn a machine's override.

The period of the pulses grows as the error falls, their order is that of the sign (A before B: up), and inside the dead
band there are none. A pulse is one turn through the four states of the lines and moves the override by one step.
"""

from __future__ import annotations

from dataclasses import dataclass

STATES = ((0, 0), (1, 0), (1, 1), (0, 1))  # of A and B, in the order of turning up


@dataclass(frozen=True)
class PulseSettings:
    """period = error_period / |error|, never shorter than `shortest` (s). error and dead_band: relative."""

    error_period: float = 0.01  # s at an error of 1
    shortest: float = 0.02  # s, of one pulse
    dead_band: float = 0.005
    step: float = 0.01  # of the override, per pulse


class PulseTrain:
    """Makes the states of both lines. Time is an argument."""

    def __init__(self, settings: PulseSettings) -> None:
        self.settings = settings
        self._phase = 0.0  # of a pulse, towards the next edge
        self._state = 0

    def period(self, error: float) -> float:
        """s of one pulse; infinite inside the dead band."""
        s = self.settings
        if abs(error) <= s.dead_band:
            return float('inf')
        return max(s.error_period / abs(error), s.shortest)

    def step(self, error: float, dt: float) -> list[tuple[int, int]]:
        """States (A, B) that follow one another within `dt` s, oldest first; a quarter of the period between them."""
        period = self.period(error)
        if period == float('inf'):
            self._phase = 0.0
            return []
        self._phase += 4 * dt / period
        edges = int(self._phase)
        self._phase -= edges
        turn = 1 if error > 0 else -1
        found = []
        for _ in range(edges):
            self._state = (self._state + turn) % 4
            found.append(STATES[self._state])
        return found


class Decoder:
    """The machine's end: counts quarter steps. `lost`: transitions of both lines at once, whose sense nobody knows."""

    def __init__(self) -> None:
        self.quarters, self.lost = 0, 0
        self._state = 0

    def see(self, state: tuple[int, int]) -> None:
        """The lines (A, B) are so from now on."""
        new = STATES.index(state)
        moved = (new - self._state) % 4
        self._state = new
        if moved == 2:
            self.lost += 1
        else:
            self.quarters += -1 if moved == 3 else moved


class Handwheel:
    """The same interface as VelocityPid: error in, output out, by way of the pulses."""

    def __init__(self, settings: PulseSettings, output: float = 1.0) -> None:
        self.settings, self.output = settings, output
        self.train, self.decoder = PulseTrain(settings), Decoder()

    def freeze(self) -> None:
        """No pulses: the override stays."""

    def step(self, error: float, dt: float, low: float, high: float) -> float:
        """The override after `dt` s with this error. At a limit the wheel turns on, the override does not."""
        before = self.decoder.quarters
        for state in self.train.step(error, dt):
            self.decoder.see(state)
        moved = 0.25 * self.settings.step * (self.decoder.quarters - before)
        self.output = min(max(self.output + moved, low), high)
        return self.output
