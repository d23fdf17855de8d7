"""What the readings of a commissioning mean: figures against limits. Pure. Units in the names; mm, A, V, degrees
Celsius."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from .commission import Check, Outcome, judged

IDENTITY, OLDEST = 'WAAM_CONTROLLER_V1', (0, 3, 0)
LOST_PCT = 1.0  # frames of telemetry
STEPS_PCT = 5.0  # of the controller against the nominal ones, as the bridge has it
ZERO_A, ZERO_V, ZERO_MM_S = 5.0, 1.0, 1.0  # at rest
SCALE = (0.9, 1.1)  # read over true, of a sensor
PLAUSIBLE_C = (-10.0, 60.0)  # of a part that nobody has heated
AGREES_K = 5.0  # with a hand thermometer
WARMER_K = 3.0  # by a warm hand, at least
WARMEST_K = 60.0
HEAT_C, HOT_C = 200.0, 120.0  # what a part is heated to, at least, where a pyrometer is compared
HOT_K, HOT_SHARE = 5.0, 0.03  # with a contact thermometer, the larger one
JOG_MM = 5.0
WAYS = ('+x', '-x', '+y', '-y', '+z', '-z', 'none')
GAS, NO_ARC = 207, 205  # faults of the controller


def link(identity: str, firmware: str, frames: int, lost: int) -> Outcome:
    """frames, lost: of telemetry."""
    if identity != IDENTITY:
        return Outcome(
            False, f'the controller calls itself {identity!r}, wanted is {IDENTITY}', (),
            'another program is on the board, or another device at the port: waam ports',
        )  # fmt: skip
    try:
        version = tuple(int(v) for v in firmware.split('.'))
    except ValueError:
        version = ()
    oldest = '.'.join(map(str, OLDEST))
    if version < OLDEST:
        text = f'firmware {firmware or "unknown"}, {oldest} at least is needed'
        return Outcome(False, text, (), 'flash the firmware of this version')
    share = 100 * lost / max(frames + lost, 1)
    checks = (
        Check('telemetry frames', frames, 50, 1e6),
        Check('frames lost', share, 0, LOST_PCT, '%'),
    )
    mend = 'cable, adapter or rate of the link: docs/real_cell.md'
    return judged(checks, f'{identity}, firmware {firmware}, {frames} frames, {lost} lost', mend)


def settings(
    wanted: Mapping[str, float], told: Mapping[str, float], travel_mm: Sequence[float]
) -> Outcome:
    """wanted: of the cell file, by the names of the controller, steps per mm and envelope_x in mm; told: what the
    controller says; travel_mm: (3,) between its soft limits."""
    has = {**told, **{f'envelope_{a}': v for a, v in zip('xyz', travel_mm, strict=True)}}
    checks = []
    for name, value in wanted.items():
        off = STEPS_PCT / 100 * value if name.startswith('steps_') else 1e-3
        checks.append(Check(name, has.get(name, math.nan), value - off, value + off))
    if not checks:
        text = 'the cell file says neither envelope nor steps per mm of an axis'
        return Outcome(False, text, (), 'measure the machine and fill in axes of the cell file')
    mend = 'waam stop, then waam up --cell NAME: the bridge tells the controller'
    return judged(checks, f'{len(checks)} settings are those of the cell file', mend)


def rest(current_a: np.ndarray, voltage_v: np.ndarray, wire_mm_s: np.ndarray) -> Outcome:
    """Each (n,) of telemetry with the source off and nothing moving."""
    checks = (
        Check('current', float(np.mean(current_a)), -ZERO_A, ZERO_A, 'A'),
        Check('voltage', float(np.mean(voltage_v)), -ZERO_V, ZERO_V, 'V'),
        Check('wire', float(np.abs(wire_mm_s).max()), 0.0, ZERO_MM_S, 'mm/s'),
    )
    mend = 'an offset: supply, ground or zero of that sensor; a wheel that turns by itself'
    return judged(checks, 'current, voltage and wire read nothing at rest', mend)


def signal(name: str, told: float, read: np.ndarray, unit: str) -> Outcome:
    """A sensor at a known value. told: by the supply; read (n,)."""
    found = float(np.mean(read)) / told
    checks = (Check(f'{name}, read over true', found, *SCALE),)
    if found < -0.2:
        text = f'{name} reads {np.mean(read):.1f} {unit} of {told:g} {unit}: upside down'
        return Outcome(False, text, checks, f'turn the {name} sensor round, or swap its leads')
    mend = f'{name} sensor: range, wiring, divider; its scale is compiled into the board'
    text = f'{name} reads {100 * (found - 1):+.1f} % at {told:g} {unit}'
    return judged(checks, text, mend)


def temperature(read_c: float, told_c: float, rise_k: float) -> Outcome:
    """read_c: mean at rest; told_c: of a hand thermometer; rise_k: change by a warm hand."""
    checks = (
        Check('at rest', read_c, *PLAUSIBLE_C, 'degC'),
        Check('less the hand thermometer', read_c - told_c, -AGREES_K, AGREES_K, 'K'),
        Check('by a warm hand', rise_k, WARMER_K, WARMEST_K, 'K'),
    )
    mend = 'input and scale of sensors.pyrometer, emissivity at the instrument, or its wiring'
    if rise_k <= -WARMER_K:
        mend = 'its two wires are swapped: warmth reads as cold'
    return judged(checks, f'{read_c:.1f} degC, {rise_k:+.1f} K by a warm hand', mend)


def hot(read_c: float, told_c: float) -> Outcome:
    """read_c: mean while a contact thermometer says told_c."""
    most = max(HOT_K, HOT_SHARE * told_c)
    checks = (
        Check('contact thermometer', told_c, HOT_C, 1200.0, 'degC'),
        Check('read less the contact thermometer', read_c - told_c, -most, most, 'K'),
    )
    mend = (
        'heat it more; emissivity at the instrument, its aim; input and scale of sensors.pyrometer'
    )
    text = f'reads {read_c:.0f} degC at {told_c:.0f}; what it reads of hotter metal is not known'
    return judged(checks, text, mend)


def direction(axis: str, told: str, way: str) -> Outcome:
    """told: the way that the axis was told to go, as '+x'; way: of WAYS, that the torch went over the table."""
    if way == told:
        return Outcome(True, f'{axis} moves {way}')
    name = axis.upper()
    if way == 'none':
        mend = f'{name} does not move: motor, drive, enable, supply'
    elif way[1] == axis:
        mend = f'{name} runs the other way: swap the two wires of one coil of its motor'
    else:
        mend = f'the cables of {name} and {way[1].upper()} are swapped at the drives'
    return Outcome(
        False, f'{axis} was told to go {told} and went {way}', (), f'{mend}; power off first'
    )


def gas(fault: int, burnt: bool, flowed_at_rest: bool, flowed: bool) -> Outcome:
    """A strike with the source off. fault: of the controller at its end; burnt: an arc was there; flowed: at the
    nozzle, before and while the valve was open."""
    if burnt:
        return Outcome(
            False, 'an arc burnt', (), 'the source was on: switch it off, step by step again'
        )
    if flowed_at_rest:
        text = 'gas flows with the valve off'
        return Outcome(False, text, (), 'the valve is stuck open, or bypassed')
    if fault == GAS:
        text = 'no gas flow (207) with the valve told to open'
        return Outcome(
            False, text, (), 'bottle, valve stuck closed, its output, or the flow switch'
        )
    if not flowed:
        text = 'the flow switch says gas and none flows'
        return Outcome(False, text, (), 'flow switch stuck or bridged')
    if fault != NO_ARC:
        text = f'the strike ended with {fault}, wanted is {NO_ARC}: no arc'
        return Outcome(False, text, (), 'docs/link_protocol.md has the codes')
    return Outcome(True, 'the valve opens, the flow switch answers, no arc with the source off')
