"""PID in velocity form with conditional anti-windup at both limits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Gains:
    """Of an output that acts on the error one to one: kp (-), ki (1/s), kd (s)."""

    kp: float
    ki: float
    kd: float = 0.0


class VelocityPid:
    """u[k] = u[k-1] + kp (e[k] - e[k-1]) + ki Ts e[k] + kd/Ts (e[k] - 2 e[k-1] + e[k-2]): eqs 2.29 and 2.30 of source
    000. At a limit the integral does not grow towards it, and the output never leaves its limits."""

    def __init__(self, gains: Gains, output: float = 1.0) -> None:
        self.gains, self.output = gains, output
        self._before: tuple[float, float] | None = None  # e[k-1], e[k-2]

    def freeze(self) -> None:
        """The output stays; the next step has no error before it, so nothing jumps."""
        self._before = None

    def step(self, error: float, dt: float, low: float, high: float) -> float:
        """The output after `dt` s with this error, inside low .. high."""
        g = self.gains
        last, older = self._before or (error, error)
        integral = g.ki * dt * error
        outwards = (self.output >= high and integral > 0) or (self.output <= low and integral < 0)
        change = g.kp * (error - last) + g.kd / dt * (error - 2 * last + older)
        change += 0.0 if outwards else integral
        self.output = min(max(self.output + change, low), high)
        self._before = error, last
        return self.output
