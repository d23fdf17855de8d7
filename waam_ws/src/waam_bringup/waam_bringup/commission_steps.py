"""What `waam commission` does in each step: asks, waits, measures, judges. One function a step."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from waam_bridge.gantry import ENVELOPE, STEPS
from waam_calibrate import commission_checks as checks
from waam_calibrate import measures, outcome, report, store, wire
from waam_calibrate.cli import UNDERFEED
from waam_calibrate.commission import Check, CommissionError, Outcome, Step
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.results import Result, missing, newest
from waam_msgs.srv import Command
from waam_process.cell_file import CellFile
from waam_process.cell_keys import AXES

from .client import ClientError
from .commission_cell import END_MM, CommissionedCell

ESTOP, LIMIT, INPUTS = 300, 301, 303  # faults of the controller
HAND_S = 120.0
TURNED = 3.0  # K: what shows that a person has done it
COUNTS_PER_MM = 40.0  # of the wire wheel, as the controller is built
WHEEL_MM = 35.0
WIRE_MM = 340.0
LENGTHS = {'x': (0.2, 0.5, 0.8), 'y': (0.2, 0.5, 0.8), 'z': (-0.15, -0.4, -0.65)}  # of the travel
MARGIN = 0.05  # of the travel, before the first length
FRAME = 0.5  # side of the frame over the travel
LONGEST_MM = 1000.0  # that is measured
RELEASED = 20  # frames in which a switch has opened
SWITCHES = tuple(f'{axis}_{end}' for axis in 'xyz' for end in ('low', 'high'))


@dataclass(frozen=True)
class Question:
    """id: as an answer file has it; words: that are taken, () = a number between low and high, in the unit."""

    id: str
    text: str
    words: tuple[str, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    unit: str = ''

    def wrong(self, answer: str) -> str:
        """Why it is no answer, '' = it is one."""
        if self.words:
            return '' if answer in self.words else f'one of {", ".join(self.words)}'
        try:
            value = float(answer)
        except ValueError:
            return 'a number'
        between = f'{self.low:g} to {self.high:g} {self.unit}'
        return '' if self.low <= value <= self.high else f'a number from {between}'


class Operator(Protocol):
    """Who answers. `ask` gives an answer that the question takes. `do` says what is to be done by hand; wait: and
    returns when it is done, else at once, because whether it is done is measured."""

    def ask(self, question: Question) -> str: ...

    def do(self, action: str, text: str, wait: bool) -> None: ...


@dataclass
class Visit:
    """One run of a step. kept: folder of calibrations; sure: yes to questions of steps without motion and current;
    patience: s that a person has for what he is told to do."""

    step: Step
    cell: CommissionedCell
    operator: Operator
    file: CellFile
    kept: Path
    sure: bool = False
    patience: float = HAND_S
    answers: dict[str, str] = field(default_factory=dict)

    def ask(self, name: str, text: str, words: Sequence[str] = (), **limits: Any) -> str:
        """The answer, noted."""
        question = Question(f'{self.step.name}.{name}', text, tuple(words), **limits)
        harmless = not (self.step.moves or self.step.powered)
        known = self.sure and harmless and question.words == YES
        answer = 'yes' if known else self.operator.ask(question)
        self.answers[question.id] = answer
        return answer

    def number(self, name: str, text: str, low: float, high: float, unit: str) -> float:
        """A number that the operator reads."""
        return float(self.ask(name, text, low=low, high=high, unit=unit))

    def by_hand(self, name: str, text: str, seen: Callable[[], object]) -> bool:
        """Says what is to be done, and waits until it shows; False when it does not."""
        self.operator.do(f'{self.step.name}.{name}', text, False)
        return self.cell.until(seen, self.patience)

    def say(self, name: str, text: str) -> None:
        """What is to be done and shows nowhere; returns when it is done."""
        self.operator.do(f'{self.step.name}.{name}', text, True)

    def ready(self, text: str) -> None:
        """CommissionError unless the operator says yes."""
        if self.ask('ready', text, YES) != 'yes':
            raise CommissionError(f'step {self.step.name}: the operator is not ready')


YES = ('yes', 'no')
STAND_CLEAR = 'Nobody is near the axes, and a hand is at the emergency stop?'


def run(visit: Visit) -> Outcome:
    """One step. What the machine refuses in the midst of it is a failure of the step; the machine is stopped then."""
    try:
        found = STEPS_BY_NAME[visit.step.name](visit)
    except EvidenceError as e:
        found = Outcome(False, str(e), (), 'measure again')
    except ClientError as e:
        _stop(visit)
        found = Outcome(False, str(e), (), 'waam status')
    except BaseException:
        _stop(visit)
        raise
    return replace(found, answers=dict(visit.answers))


def _stop(visit: Visit) -> None:
    if visit.step.moves:
        with contextlib.suppress(ClientError):
            visit.cell.order(Command.Request.STOP)


# ---- nothing moves


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
    if visit.ask('released', 'Is the emergency stop released (pulled out)?', YES) != 'yes':
        raise CommissionError('step estop: release the emergency stop first')
    if refused := cell.reset():
        text = f'released, the controller says: {refused}'
        return Outcome(
            False,
            text,
            (),
            'its contact is reversed (it must open when pressed) or a wire is broken',
        )
    if not visit.by_hand('press', 'Press the emergency stop.', lambda: cell.alarmed(ESTOP)):
        return Outcome(
            False, 'pressed, and the controller did not see it', (), 'wire it to its input'
        )
    if not cell.reset():
        return Outcome(False, 'pressed, and a reset was taken', (), 'the contact must stay open')
    text = 'Release the emergency stop (pull it out).'
    if not visit.by_hand('out', text, lambda: not cell.reset()):
        return Outcome(
            False, 'released, and no reset is taken', (), 'the contact does not close any more'
        )
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


# ---- axes move


def directions(visit: Visit) -> Outcome:
    """Z first, upwards; every axis moves by a little and back. The first wrong one ends the step."""
    cell = visit.cell
    if refused := cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop and limits')
    visit.ready(
        f'Every axis stands 20 mm from its ends at least, and moves by {checks.JOG_MM:g} mm. {STAND_CLEAR}'
    )
    text = 'which way did the torch go over the table? x: to the right, y: to the back, z: up, seen from the front'
    for axis in 'zxy':
        visit.say(f'{axis}_look', f'Look at the torch: {axis.upper()} moves next.')
        up = not cell.at_top(axis)
        cell.jog(axis, checks.JOG_MM if up else -checks.JOG_MM)
        way = visit.ask(axis, f'{axis.upper()} was moved: {text}', checks.WAYS)
        found = checks.direction(axis, f'{"+" if up else "-"}{axis}', way)
        if not found.passed:
            return found
        cell.jog(axis, -checks.JOG_MM if up else checks.JOG_MM)
    return Outcome(True, 'x, y and z move as they are told')


def homing(visit: Visit) -> Outcome:
    """Homes; where the axes then stand the operator sees."""
    cell = visit.cell
    if refused := cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop and limits')
    visit.ready(f'The machine homes: Z up, then X and Y to their switches. {STAND_CLEAR}')
    cell.home()
    seen = visit.ask(
        'ends', 'Is Z at its upper end, and do X and Y stand at their home switches?', YES
    )
    if seen != 'yes':
        text = 'the axes do not stand at their home switches'
        return Outcome(
            False, text, (), 'axes.x.home, axes.y.home of the cell file, or swapped switches'
        )
    return Outcome(True, 'homed; the axes stand at their switches')


def gas(visit: Visit) -> Outcome:
    """A strike in the air with the source off shows valve and flow switch before there is an arc."""
    cell = visit.cell
    visit.ready(
        'The source is switched off at its mains, the gas bottle is open, the torch is up and its wire touches '
        f'nothing. Wire is fed and the gas valve opens for some seconds. {STAND_CLEAR}'
    )
    _at_home(visit)
    cell.go('z', cell.travel()[2] - END_MM)
    before = visit.ask('at_rest', 'Does gas flow at the nozzle now?', YES)
    visit.say('listen', 'Listen at the nozzle: the valve is told to open.')
    fault, burnt = cell.strike()
    flowed = 'no' if burnt else visit.ask('flowed', 'Did gas flow at the nozzle?', YES)
    return checks.gas(fault, burnt, before == 'yes', flowed == 'yes')


def steps(visit: Visit) -> Outcome:
    """Three lengths an axis, all in one direction; the controller is told what follows, and homes again."""
    cell = visit.cell
    visit.ready(
        'X, Y and Z travel along most of their way, Z downwards to two thirds of it: the table is free. '
        f'A rule or dial gauge stands ready. {STAND_CLEAR}'
    )
    _at_home(visit)
    now = cell.told()
    found = []
    for axis, size in zip('xyz', cell.travel(), strict=True):
        told, read = _lengths(visit, axis, min(size, LONGEST_MM), size)
        result = measures.steps(axis, told, read, now[STEPS + axis])
        _keep(visit, result)
        found.append(result)
    cell.configure([setting for result in found for setting in result.settings])
    cell.home()
    shown = tuple(
        Check(f'{r.axis}, real over commanded', r.values['scale'], 1 - measures.SCALE_MOST, 1 + measures.SCALE_MOST)
        for r in found
    )  # fmt: skip
    return Outcome(True, '; '.join(f'{r.axis} {r.text}' for r in found), shown)


def _lengths(visit: Visit, axis: str, most: float, size: float) -> tuple[list[float], list[float]]:
    """Commanded and measured lengths, mm; every one from the same place."""
    told = [round(share * most) for share in LENGTHS[axis]]
    start = size * (1 - MARGIN) if told[0] < 0 else size * MARGIN
    read = []
    for length in told:
        visit.cell.go(axis, start)
        visit.say(f'{axis}_zero', f'Set the gauge of {axis.upper()} to zero.')
        visit.cell.go(axis, start + length)
        text = f'{axis.upper()} was told to travel {abs(length)} mm. How far did it go?'
        name = f'{axis}_{abs(length)}'
        read.append(visit.number(name, text, 0.5 * abs(length), 1.5 * abs(length), 'mm'))
    return [float(abs(v)) for v in told], read


def skew(visit: Visit) -> Outcome:
    """A frame of four marks, one side and both diagonals."""
    cell = visit.cell
    visit.ready(
        f'The torch goes to the four corners of a square, where you mark its place. {STAND_CLEAR}'
    )
    _at_home(visit)
    x, y, _ = cell.travel()
    side = round(FRAME * min(x, y, LONGEST_MM))
    low = {'x': 0.5 * (x - side), 'y': 0.5 * (y - side)}
    for number, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1)), 1):
        cell.go('x', low['x'] + u * side)
        cell.go('y', low['y'] + v * side)
        visit.say(f'mark_{number}', f'Mark the place of the torch on the table: {number}.')
    told = {
        name: visit.number(
            name, f'How far is it from mark {a} to mark {b}?', 0.5 * side, 2.0 * side, 'mm'
        )
        for name, a, b in (('side', 1, 2), ('rising', 1, 3), ('falling', 2, 4))
    }
    result = measures.skew(told['side'], told['rising'], told['falling'])
    _keep(visit, result)
    leans, most = result.values['y_to_x_deg'], measures.LARGEST_SKEW
    shown = Check('y leans towards x', leans, -most, most, 'deg')
    if result.refuses:
        mend = 'square the rails of Y; what is left is corrected by waam correct --y-to-x'
        return Outcome(False, result.refuses, (shown,), mend)
    return Outcome(True, result.text, (shown,))


def wheel(visit: Visit) -> Outcome:
    """Three lengths of wire against its wheel."""
    visit.ready(
        'The source is off. Three lengths of wire are fed into the air; cut it flush with the tip first.'
    )
    if refused := visit.cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop')
    counts, lengths = [], []
    for number in (1, 2, 3):
        counted = visit.cell.feed_wire(WIRE_MM)
        text = f'Cut the wire flush with the tip. How long is piece {number}?'
        lengths.append(visit.number(f'piece_{number}', text, 0.5 * WIRE_MM, 1.5 * WIRE_MM, 'mm'))
        counts.append(counted * COUNTS_PER_MM)
    per_turn = round(math.pi * WHEEL_MM * COUNTS_PER_MM)
    found = wire.calibrate(wire.Wheel(WHEEL_MM, per_turn), lengths, counts, slowest=33.0)
    result = outcome.of_wire(found, COUNTS_PER_MM, UNDERFEED)
    _keep(visit, result)
    off = 100 * (found.per_mm / COUNTS_PER_MM - 1)
    shown = Check('counted over fed, off', off, -5.0, 5.0, '%')
    if result.refuses:
        return Outcome(
            False,
            result.refuses,
            (shown,),
            'wheel: diameter, slip, pressure; or another ENCODER_PER_MM',
        )
    visit.cell.configure(result.settings)
    return Outcome(True, result.text, (shown,))


def _at_home(visit: Visit) -> None:
    """Out of ALARM, with the settings that were found, which a controller forgets with its power, and homed.
    ClientError."""
    cell = visit.cell
    if refused := cell.reset():
        raise ClientError(f'the controller says: {refused}')
    kept = store.load_all(visit.kept).results
    if missing(kept, cell.told()):
        cell.configure([s for r in newest(kept).values() for s in r.settings])
    if not cell.known().homed:
        cell.home()


def _keep(visit: Visit, result: Result) -> None:
    """As waam calibrate keeps it, so that a job looks at it."""
    dated = result.of(datetime.now(UTC))
    store.save(visit.kept, dated, report.page(dated, (), ['found by waam commission']))


STEPS_BY_NAME: dict[str, Callable[[Visit], Outcome]] = {
    'link': link, 'settings': settings, 'estop': estop, 'limits': limits, 'rest': rest, 'signals': signals,
    'temperature': temperature, 'directions': directions, 'homing': homing, 'gas': gas, 'steps': steps,
    'skew': skew, 'wire': wheel,
}  # fmt: skip
