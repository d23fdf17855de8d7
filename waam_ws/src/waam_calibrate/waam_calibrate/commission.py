"""Commissioning of a cell: the steps, their gates, and the book of what was found. Pure: dates are arguments.

A step is passed while its last run passed, the steps that it stands on were not repeated since, and the cell file says
the same of the machine. A step that is not built here is named, and never counts as passed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from waam_process.cli_options import as_table

from .results import digest

VERSION = 1
HEAD = 'waam_commissioning'  # key of the version
NOT_DONE, PASSED, FAILED, OUT_OF_DATE, BY_HAND, NOT_THERE = (
    'not done', 'passed', 'failed', 'out of date', 'by hand', 'not there',
)  # fmt: skip
SEE = 'by hand: see docs/real_cell.md'


class CommissionError(ValueError):
    """A book that cannot be used, or a step that is not there or not due; the text says which and why."""


@dataclass(frozen=True)
class Step:
    """name: as the command line says it; title: what it shows; after: steps that must have passed before; moves: axes
    or wire move; powered: a current flows; built: `waam commission` does it; needs: what a person has at hand."""

    name: str
    title: str
    after: tuple[str, ...] = ()
    moves: bool = False
    powered: bool = False
    built: bool = True
    needs: str = ''


STEPS = (
    Step('link', 'link, firmware version, lost frames'),
    Step('settings', 'settings of the controller against the cell file', ('link',)),
    Step('estop', 'emergency stop, pressed and released', ('link',)),
    Step('limits', 'every limit switch, pressed by hand', ('estop',), needs='reach to all six switches'),
    Step('rest', 'current, voltage and wire read nothing at rest', ('link',)),
    Step('signals', 'known current and voltage at the sensors: sign and scale', ('rest',), powered=True,
         needs='a laboratory supply (5 A, 24 V) and a cable for four turns'),
    Step('temperature', "the part's temperature: plausible, and rises by warmth", ('link',),
         needs='a thermometer, something warm'),
    Step('directions', 'every axis moves the right way', ('settings', 'estop', 'limits'), moves=True),
    Step('homing', 'homing of all axes', ('directions',), moves=True),
    Step('gas', 'gas valve, flow switch and strike, with the source switched off', ('homing', 'signals'),
         moves=True, powered=True, needs='shielding gas, the source off at its mains'),
    Step('steps', 'steps per mm of X, Y and Z by measured lengths', ('homing',), moves=True,
         needs='a rule or a dial gauge'),
    Step('skew', 'squareness of X and Y by measured diagonals', ('steps',), moves=True,
         needs='a scriber, a rule over the diagonal of half the table'),
    Step('wire', 'wire wheel: length fed against counted', ('estop',), moves=True,
         needs='side cutters, a rule of 0.5 m'),
    Step('pyrometer', 'the temperature of hot metal against a contact thermometer', ('temperature',),
         needs='a gas burner, a contact thermometer'),
    Step('resonance', 'resonance of X and Y, their input shapers', ('steps',), moves=True,
         needs='an accelerometer at the controller'),
    Step('scanner', 'mounting of the scanner and delay of its clock, by an artefact', ('skew',), moves=True,
         needs='the artefact'),
    Step('scales', 'scales of the source, 0-10 V against what it shows', ('signals',), powered=True, built=False),
    Step('arc', 'first arc on scrap: current, voltage, wire, an arc that stays',
         ('gas', 'skew', 'wire', 'temperature', 'scanner'), moves=True, powered=True,
         needs='a scrap plate of 200 x 80 mm and more, screens, gloves, extraction'),
    Step('lead', 'delay and lag of the wire drive, by a bead with steps of speed', ('arc',), moves=True, powered=True,
         needs='the same plate'),
    Step('bead', 'efficiency, width and height of the beads against the table', ('arc', 'lead')),
    Step('part', 'a small part restored in closed loop', ('bead', 'pyrometer'), moves=True, powered=True,
         needs='a small worn part of steel and its nominal mesh in mm'),
)  # fmt: skip
BY_NAME = {step.name: step for step in STEPS}
BUILT = tuple(step for step in STEPS if step.built)


@dataclass(frozen=True)
class Check:
    """One figure of a step against its limits, both in the unit; what is not a number is not good."""

    name: str
    value: float
    low: float
    high: float
    unit: str = ''

    @property
    def good(self) -> bool:
        """Within its limits, ends included."""
        return self.low <= self.value <= self.high

    @property
    def text(self) -> str:
        """Value, unit, limits."""
        unit = f' {self.unit}' if self.unit else ''
        return f'{self.name} {self.value:.4g}{unit} (limits {self.low:g} .. {self.high:g}{unit})'


@dataclass(frozen=True)
class Outcome:
    """What a run of a step found. text: in a line; mend: what to do about it, '' = nothing; answers: what the operator
    said, by the id of the question; there: false = this cell has not what the step is about, which stays unknown;
    pictures: names of files beside the book; job: folder of the job that was run, '' = none."""

    passed: bool
    text: str
    checks: tuple[Check, ...] = ()
    mend: str = ''
    answers: Mapping[str, str] = field(default_factory=dict)
    there: bool = True
    pictures: tuple[str, ...] = ()
    job: str = ''


def judged(checks: Iterable[Check], text: str, mend: str) -> Outcome:
    """Passed when all checks are good, else the first one that is not is the text."""
    checks = tuple(checks)
    bad = next((c for c in checks if not c.good), None)
    if bad is None:
        return Outcome(True, text, checks)
    return Outcome(False, bad.text, checks, mend)


@dataclass(frozen=True)
class Entry:
    """The last run of a step. order: counts the runs of the book; date: ISO 8601; machine: hash of the machine's part
    of the cell file then; firmware: of the controller."""

    step: str
    order: int
    date: str
    machine: str
    firmware: str
    outcome: Outcome


@dataclass(frozen=True)
class Book:
    """Runs of a cell, the last one of each step. machine: hash of the machine's part of the cell file as it is now."""

    cell: str
    machine: str
    entries: Mapping[str, Entry] = field(default_factory=dict)

    def state(self, name: str) -> str:
        """NOT_DONE and the others; KeyError for a step that is not there."""
        step, entry = BY_NAME[name], self.entries.get(name)
        if not step.built:
            return BY_HAND
        if entry is None:
            return NOT_DONE
        if not entry.outcome.there and self.why_old(name) == '':
            return NOT_THERE
        if entry.outcome.there and not entry.outcome.passed:
            return FAILED
        return PASSED if self.why_old(name) == '' else OUT_OF_DATE

    def why_old(self, name: str) -> str:
        """Why the last run does not count any more, '' = it does."""
        entry = self.entries[name]
        if entry.machine != self.machine:
            return 'the cell file says something else of the machine'
        for gate in BY_NAME[name].after:
            before = self.entries.get(gate)
            if before is None or self.state(gate) != PASSED:
                return f'{gate} is {self.state(gate)}'
            if before.order > entry.order:
                return f'{gate} was repeated'
        return ''

    def closed(self, name: str) -> list[str]:
        """Gates that keep the step from being run: `name is state` of each."""
        states = ((gate, self.state(gate)) for gate in BY_NAME[name].after)
        return [f'{gate} is {state}' for gate, state in states if state != PASSED]

    def due(self) -> Step | None:
        """The first built step that has not passed and is there; None when the commissioning is over."""
        return next((s for s in BUILT if self.state(s.name) not in (PASSED, NOT_THERE)), None)

    def with_run(self, name: str, outcome: Outcome, date: str, firmware: str) -> Book:
        """The book after one more run."""
        order = 1 + max((e.order for e in self.entries.values()), default=0)
        entry = Entry(name, order, date, self.machine, firmware, outcome)
        return replace(self, entries={**self.entries, name: entry})

    @property
    def laid(self) -> dict[str, str]:
        """Folders of jobs by the steps that ran them."""
        return {name: e.outcome.job for name, e in self.entries.items() if e.outcome.job}

    @property
    def passed(self) -> int:
        """How many built steps have passed."""
        return sum(self.state(step.name) == PASSED for step in BUILT)


def wanted(name: str) -> Step:
    """The built step of that name. CommissionError names what there is."""
    step = BY_NAME.get(name)
    if step is None:
        raise CommissionError(
            f'there is no step {name!r}; known are {", ".join(s.name for s in BUILT)}'
        )
    if not step.built:
        raise CommissionError(f'step {name} is done {SEE}')
    return step


def table(book: Book) -> str:
    """All steps for the screen: state, date, what was found."""
    rows = [(s.name, book.state(s.name), *_last(book, s), s.title) for s in STEPS]
    by_hand = len(STEPS) - len(BUILT)
    foot = f'{book.passed} of {len(BUILT)} steps passed{without(book)}; {by_hand} more done by hand'
    return f'{as_table(("step", "state", "date", "shows"), rows)}\n{foot}'


def without(book: Book) -> str:
    """What this cell has not, in words."""
    names = [s.name for s in BUILT if book.state(s.name) == NOT_THERE]
    return f', not there: {", ".join(names)}' if names else ''


def _last(book: Book, step: Step) -> tuple[str]:
    entry = book.entries.get(step.name)
    return (entry.date[:16].replace('T', ' ') if entry else '',)


def to_data(book: Book) -> dict[str, Any]:
    """What the file says, its hash included."""
    entries = [asdict(e) for e in sorted(book.entries.values(), key=lambda e: e.order)]
    for entry in entries:
        outcome = entry['outcome']
        outcome['checks'] = [
            [c['name'], *(float(c[k]) for k in ('value', 'low', 'high')), c['unit']]
            for c in outcome['checks']
        ]
        outcome['pictures'] = list(outcome['pictures'])
    data = {HEAD: VERSION, 'cell': book.cell, 'entries': entries}
    data['sha256'] = digest(data)
    return data


def from_data(data: Any, cell: str, machine: str) -> Book:
    """The book of a cell. CommissionError when it is none, belongs to another cell or was changed."""
    if not isinstance(data, dict) or data.get(HEAD) != VERSION:
        raise CommissionError(f'not a book of a commissioning of version {VERSION}')
    if data.get('cell') != cell:
        raise CommissionError(f"belongs to the cell {data.get('cell')!r}, not {cell!r}")
    if data.get('sha256') != digest(data):
        raise CommissionError('was changed by hand (its hash does not fit): commission again')
    try:
        entries = {e['step']: _entry(e) for e in data['entries'] if e['step'] in BY_NAME}
    except (KeyError, TypeError, ValueError) as e:
        raise CommissionError(f'field missing or wrong: {e}') from None
    return Book(cell, machine, entries)


def _entry(data: dict[str, Any]) -> Entry:
    told = dict(data['outcome'])
    told['checks'] = tuple(
        Check(str(name), float(value), float(low), float(high), str(unit))
        for name, value, low, high, unit in told['checks']
    )
    told['pictures'] = tuple(map(str, told.get('pictures', ())))
    order = data['order']
    if not isinstance(order, int) or not math.isfinite(order):
        raise ValueError(f'order {order!r} is no whole number')
    return Entry(**{**data, 'outcome': Outcome(**told)})
