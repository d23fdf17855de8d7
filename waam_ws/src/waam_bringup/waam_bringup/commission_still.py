"""Steps of `waam commission` in which nothing moves: link, settings, buttons, sensors. One function a step."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from waam_bridge.gantry import ENVELOPE, STEPS
from waam_calibrate import commission_checks as checks
from waam_calibrate.commission import Check, Outcome
from waam_process.cell_keys import AXES

from .commission_visit import Visit

ESTOP, LIMIT, INPUTS = 300, 301, 303  # faults of the controller
TURNED = 3.0  # K: what shows that a person has done it
RELEASED = 20  # frames in which a switch has opened
SWITCHES = tuple(f'{axis}_{end}' for axis in 'xyz' for end in ('low', 'high'))


def link(visit: Visit) -> Outcome:
    """Who is there, and whether frames get lost."""
    m = visit.cell.known()
    frames = visit.cell.fresh()
    span = frames[-1].sequence - frames[0].sequence + 1
    return checks.link(m.identity, m.firmware_version, len(frames), span - len(frames))


def settings(visit: Visit) -> Outcome:
    """The cell file against the controller."""
    wanted = {}
    for axis in 'xyz':
        for key, name in (('envelope_mm', ENVELOPE), ('steps_per_mm', STEPS)):
            value = visit.file.values.get(f'{AXES}{axis}.{key}')
            if value is not None:
                wanted[name + axis] = float(value)
    return checks.settings(wanted, visit.cell.told(), visit.cell.travel())


def estop(visit: Visit) -> Outcome:
    """Pressed is an ALARM, released can be reset. A button that reads pressed at rest is found first."""
    cell = visit.cell
    if cell.reset():
        visit.say('release', 'Release the emergency stop (pull it out).')
    if refused := cell.reset():
        text = f'released, the controller says: {refused}'
        mend = 'its contact is reversed (it must open when pressed) or a wire is broken'
        return Outcome(False, text, (), mend)
    if not visit.by_hand('press', 'Press the emergency stop.', lambda: cell.alarmed(ESTOP)):
        text = 'pressed, and the controller did not see it'
        return Outcome(False, text, (), 'wire it to its input')
    if not cell.reset():
        return Outcome(False, 'pressed, and a reset was taken', (), 'the contact must stay open')
    text = 'Release the emergency stop (pull it out).'
    if not visit.by_hand('out', text, lambda: not cell.reset()):
        text = 'released, and no reset is taken'
        return Outcome(False, text, (), 'the contact does not close any more')
    return Outcome(True, 'pressed: ALARM 300, reset refused; released: reset taken')


def limits(visit: Visit) -> Outcome:
    """Every switch ends in ALARM 301 when it is pressed by hand."""
    cell = visit.cell
    if refused := cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop')
    for name in SWITCHES:
        axis, end = name.split('_')
        text = f'Press the limit switch of {axis.upper()} at its {end} end, and hold it.'
        if not visit.by_hand(name, text, lambda: cell.alarmed(LIMIT)):
            what = f'the switch of {axis} at its {end} end was pressed, and the controller saw no change'
            mend = (
                'it is bridged or not in the chain, or the chain is broken and always reads pressed'
            )
            return Outcome(False, what, (), mend)
        visit.say(f'{name}_off', 'Let it go.')
        cell.fresh(RELEASED)
        if refused := cell.reset():
            return Outcome(
                False, f'the controller says: {refused}', (), 'see to it, then limits again'
            )
    return Outcome(True, f'{len(SWITCHES)} switches seen')


def rest(visit: Visit) -> Outcome:
    """Sensors of the arc without an arc."""
    frames = visit.cell.fresh()
    return checks.rest(
        *(_values(frames, n) for n in ('arc_current', 'arc_voltage', 'wire_feed_speed'))
    )


def _values(frames: list[Any], name: str) -> np.ndarray:
    """(n,) SI, but mm/s for the wire."""
    factor = 1e3 if name == 'wire_feed_speed' else 1.0
    return factor * np.array([getattr(f, name) for f in frames], float)


def signals(visit: Visit) -> Outcome:
    """A known current through the sensor and a known voltage at the input, by a laboratory supply."""
    if refused := visit.cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop')
    found = []
    for name, field_name, unit, how, low, high in (
        ('current', 'arc_current', 'A', 'four turns of a cable through the current sensor, in the direction of its '
         'arrow, and about 5 A from a laboratory supply', 10.0, 25.0),
        ('voltage', 'arc_voltage', 'V', 'about 24 V from a laboratory supply or two batteries, plus at the contact '
         'tip, minus at the table; the source off', 10.0, 60.0),
    ):  # fmt: skip
        visit.say(name, f'Put on {how}.')
        what = 'A times turns' if unit == 'A' else unit
        told = visit.number(
            f'{name}_told', f'What does the supply say, in {what}?', low, high, unit
        )
        judged = _signal(visit, name, field_name, told, unit)
        visit.say(f'{name}_off', 'Take it off again.')
        found.append(judged)
        if not judged.passed:
            return replace(judged, checks=tuple(c for f in found for c in f.checks))
    return Outcome(
        True, '; '.join(f.text for f in found), tuple(c for f in found for c in f.checks)
    )


def _signal(visit: Visit, name: str, field_name: str, told: float, unit: str) -> Outcome:
    frames = visit.cell.fresh()
    if visit.cell.alarmed(INPUTS):
        text = f'with {told:g} {unit} at the sensor of the {name}: {visit.cell.known().fault_text} (303)'
        mend = f'the {name} sensor is upside down, torn off or of another range, or {told:g} {unit} is not what flows'
        return Outcome(False, text, (), mend)
    return checks.signal(name, told, _values(frames, field_name), unit)


def temperature(visit: Visit) -> Outcome:
    """At rest like a hand thermometer, and warmer by warmth."""
    cell = visit.cell
    read = cell.warmth()
    if math.isnan(read):
        text = 'no temperature comes, or it is unknown'
        mend = 'sensors.pyrometer of the cell file; a broken wire reads as unknown'
        return Outcome(False, text, (Check('at rest', read, *checks.PLAUSIBLE_C, 'degC'),), mend)
    if not checks.PLAUSIBLE_C[0] <= read <= checks.PLAUSIBLE_C[1]:
        return checks.temperature(read, read, math.nan)
    told = visit.number(
        'told', 'What does a hand thermometer say where it measures?', -40.0, 100.0, 'degC'
    )

    def turned() -> bool:
        return len(cell.celsius) >= 5 and bool(abs(np.mean(cell.celsius[-5:]) - read) > TURNED)

    cell.celsius.clear()
    text = 'Warm that place: a hand on the thermocouple, a cup of hot water before the pyrometer.'
    visit.by_hand('warm', text, turned)
    rise = cell.warmth() - read
    visit.say('cool', 'Take it away.')
    return checks.temperature(read, told, rise)


def pyrometer(visit: Visit) -> Outcome:
    """Where the part is hot, against a contact thermometer; the emissivity is set at the instrument."""
    visit.say(
        'heat',
        f'Heat the place where the temperature is measured to about {checks.HEAT_C:g} degC, by a gas burner; it may be '
        'the bare metal of a scrap plate, as it will be welded on.',
    )
    visit.say(
        'set',
        'Hold a contact thermometer there. Where the two differ, set the emissivity at the instrument until they '
        'agree. A thermocouple at the controller has none: then only compare.',
    )
    told = visit.number('told', 'What does the contact thermometer say now?', -40.0, 1200.0, 'degC')
    found = checks.hot(visit.cell.warmth(), told)
    visit.say('cool', 'Take burner and thermometer away.')
    return found
