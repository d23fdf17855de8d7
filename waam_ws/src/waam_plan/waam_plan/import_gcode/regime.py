"""What the process can do, against what a program asks for."""

from __future__ import annotations

import math
from collections.abc import Callable

from waam_plan.import_gcode.motion import Motion, Program
from waam_process.materials import Material
from waam_process.units import to_m_min

SLOWEST, FASTEST = 1e-3, 0.1  # m/s, of an arc that welds; beyond, a feed has lost or won a digit
IDLE_SLOWEST = 0.5e-3  # m/s, of a move without arc
THINNEST, MOST = 5e-3, 0.6  # m/s of wire
SLACK = 1e-3  # share of a limit that rounding may cost


def regime_problems(program: Program, material: Material) -> list[str]:
    """The first line beyond each limit of the material: speed, wire, voltage. Empty when there is none."""
    m, ratio = material, 1.0
    if program.wire_diameter:
        ratio = (program.wire_diameter / material.wire_diameter) ** 2
    found = (
        _first(program, m.name, 'travel speed', lambda s: s.speed, (m.speed_min, m.speed_max), 1e3, 'mm/s'),
        _first(program, m.name, 'wire', lambda s: s.wire * ratio, (m.feed_min, m.feed_max), to_m_min(1.0), 'm/min'),
        _first(program, m.name, 'voltage', _volts, (m.voltage_min, m.voltage_max), 1.0, 'V'),
    )  # fmt: skip
    return [text for text in found if text]


def _volts(motion: Motion) -> float:
    return motion.voltage or math.nan


def _first(
    program: Program,
    name: str,
    what: str,
    value: Callable[[Motion], float],
    limits: tuple[float, float],
    factor: float,
    unit: str,
) -> str:
    low, high = limits
    for m in program.burning:
        v = value(m)
        if v < low * (1 - SLACK) or v > high * (1 + SLACK):
            return (
                f'line {m.line}: {what} {v * factor:.3g} {unit}, {name} takes {low * factor:g} to '
                f'{high * factor:g} {unit}'
            )
    return ''


def doubts(program: Program) -> list[str]:
    """The first line of each speed that no process has, with the time that it costs. Empty when there is none."""
    idle = [m for m in program.motions if not m.arc and not m.dwell and math.isfinite(m.speed)]
    travel = _doubt(program.burning, 'travel with the arc on', SLOWEST, FASTEST, lambda m: m.speed)
    wire = _doubt(program.burning, 'wire', THINNEST, MOST, lambda m: m.wire)
    way = _doubt(idle, 'travel without arc', IDLE_SLOWEST, math.inf, lambda m: m.speed)
    return [*(travel or wire), *way]  # wire by E follows the travel


def _doubt(
    moves: list[Motion], what: str, low: float, high: float, value: Callable[[Motion], float]
) -> list[str]:
    for kind, odd in (
        ('low', [m for m in moves if value(m) < low]),
        ('high', [m for m in moves if value(m) > high]),
    ):
        if odd:
            seconds = sum(m.length / m.speed for m in odd if m.length > 0)
            return [
                f'line {odd[0].line}: {what} at {value(odd[0]) * 6e4:.4g} mm/min is implausibly {kind} '
                f'({len(odd)} moves, {seconds:.0f} s); is a digit missing or too many, or another unit meant?'
            ]
    return []
