"""The factors on speed and wire: the operator's, multiplied by those of a process control. Pure.

The control's factors are a lease: when they are not said again within PROCESS_TIMEOUT, the operator's remain.
"""

from __future__ import annotations

import math

from waam_process.operating import PROCESS_FACTOR, SPEED_FACTOR, WIRE_FACTOR

from . import requests
from .machine import Machine
from .outbox import WARNING

Pair = tuple[float, float]  # speed and wire, or lowest and highest
NONE = (1.0, 1.0)
PROCESS_TIMEOUT = 1.0  # s: ten messages of a process control


class OverrideError(ValueError):
    """A factor that is refused; the text names it and its limits."""


def operator(machine: Machine, speed: float, wire: float, source: str, now: float) -> None:
    """Factors that act inside the running segment; NaN leaves one as it is. What is refused becomes a notice."""
    try:
        factors = _checked(machine, (speed, wire), machine.overrides, (SPEED_FACTOR, WIRE_FACTOR))
    except OverrideError as e:
        machine.notice(WARNING, 'operator', f"override of '{source}' refused: {e}")
        return
    machine.overrides = factors
    _send(machine, f"override of '{source}'", now)


def process(machine: Machine, speed: float, wire: float, source: str, now: float) -> None:
    """Factors of a process control; as `operator` otherwise."""
    try:
        factors = _checked(
            machine, (speed, wire), machine.process, (PROCESS_FACTOR, PROCESS_FACTOR)
        )
    except OverrideError as e:
        machine.notice(WARNING, 'node', f"override of '{source}' refused: {e}")
        return
    before, machine.process, machine.process_heard = product(machine), factors, now
    if _permille(product(machine)) != _permille(before):
        _send(machine, f"override of '{source}'", now)


def expire(machine: Machine, now: float) -> None:
    """Takes the control's factors away when it has fallen silent. now: s, steady clock."""
    late = now - machine.process_heard > PROCESS_TIMEOUT
    if machine.process == NONE or not late:
        return
    machine.process = NONE
    machine.notice(WARNING, 'node', 'the process control is silent: its factors are 1 again')
    if machine.connected:
        _send(machine, 'override', now)


def begin_job(machine: Machine, now: float) -> None:
    """A job begins with the operator's factors at 1: those of another job are taken back, and told."""
    if machine.overrides == NONE:
        return
    speed, wire = machine.overrides
    machine.overrides = NONE
    text = (
        f'override of speed {speed:.0%} and wire {wire:.0%} was in force: a job begins with 100 %'
    )
    machine.notice(WARNING, 'operator', text)
    _send(machine, 'override', now)


def product(machine: Machine) -> tuple[float, float]:
    """What the controller is told: both multiplied, inside the operator's ranges."""
    speed, wire = (o * p for o, p in zip(machine.overrides, machine.process, strict=True))
    return _inside(speed, SPEED_FACTOR), _inside(wire, WIRE_FACTOR)


def _send(machine: Machine, what: str, now: float) -> None:
    def done(code: int, text: str) -> None:
        if code != requests.OK:
            machine.notice(WARNING, 'operator', f'{what}: {text}')

    args = ' '.join(f'{f:.0f}' for f in _permille(product(machine)))
    machine.link.requests.supersede('V', 'a newer override came')
    machine.link.ask('V', args, done, now)


def _permille(factors: tuple[float, float]) -> tuple[int, int]:
    return round(1000 * factors[0]), round(1000 * factors[1])


def _checked(machine: Machine, asked: Pair, before: Pair, limits: tuple[Pair, Pair]) -> Pair:
    """Speed and wire factor as asked, NaN as they were before. limits: of each."""
    if not machine.connected:
        raise OverrideError('not connected')
    (speed, wire), (speed_limits, wire_limits) = asked, limits
    return (
        _factor('speed_factor', speed, before[0], speed_limits),
        _factor('wire_factor', wire, before[1], wire_limits),
    )


def _inside(value: float, limits: tuple[float, float]) -> float:
    return min(max(value, limits[0]), limits[1])


def _factor(name: str, value: float, before: float, limits: tuple[float, float]) -> float:
    low, high = limits
    if math.isnan(value):
        return before
    if not low <= value <= high:
        raise OverrideError(f'{name} is {value:g}, limits {low:g} .. {high:g}')
    return value
