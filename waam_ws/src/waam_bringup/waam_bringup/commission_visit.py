"""A run of a step of `waam commission`: questions, what is done by hand, and what all steps do in the same way."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, TypeVar

from waam_calibrate import report, store
from waam_calibrate.commission import CommissionError, Step
from waam_calibrate.results import Result, missing, newest, refusals
from waam_process.cell_file import CellFile

from .client import ClientError
from .commission_cell import CommissionedCell

HAND_S = 120.0
MEANWHILE_S = 0.5  # that a person takes at least: a wizard that waits hears nothing
FOLDER = 'commission'  # in the folder of the calibrations of a cell
YES = ('yes', 'no')
Answer = TypeVar('Answer')
STAND_CLEAR = 'Nobody is near the axes, and a hand is at the emergency stop?'


@dataclass(frozen=True)
class Question:
    """id: as an answer file has it; words: that are taken; file: or the name of a file; where neither is said `count`
    numbers between low and high, in the unit."""

    id: str
    text: str
    words: tuple[str, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    unit: str = ''
    count: int = 1
    file: bool = False

    @property
    def wanted(self) -> str:
        """What is taken, in short."""
        words = '/'.join((*self.words, *(['FILE'] if self.file else [])))
        return words or (f'{self.count} x {self.unit}' if self.count > 1 else self.unit)

    def cleaned(self, answer: str) -> str:
        """As it is kept: words in lower case, commas after numbers left out."""
        answer = answer.strip()
        if self.file and answer.lower() not in self.words:
            return answer
        return ' '.join(word.strip(',;') for word in answer.lower().split())

    def wrong(self, answer: str) -> str:
        """Why a cleaned answer is none, '' = it is one."""
        if answer in self.words:
            return ''
        if self.file:
            there = Path(answer).expanduser().is_file()
            return '' if there else f'a file that is there, or {", ".join(self.words)}'
        if self.words:
            return f'one of {", ".join(self.words)}'
        number = 'a number' if self.count == 1 else f'{self.count} numbers'
        try:
            values = [float(word) for word in answer.split()]
        except ValueError:
            return number
        between = f'{number} from {self.low:g} to {self.high:g} {self.unit}'
        good = len(values) == self.count and all(self.low <= v <= self.high for v in values)
        return '' if good else between


class Operator(Protocol):
    """Who answers. `ask` gives an answer that the question takes. `do` says what is to be done by hand; wait: and
    returns when it is done, else at once, because whether it is done is measured."""

    def ask(self, question: Question) -> str: ...

    def do(self, action: str, text: str, wait: bool) -> None: ...


@dataclass
class Visit:
    """One run of a step. kept: folder of calibrations; sure: yes to questions of steps without motion and current;
    patience: s that a person has for what he is told to do; laid: folders of the jobs of steps before, by their names;
    job: folder of the job of this one. Whatever is asked and drawn is noted."""

    step: Step
    cell: CommissionedCell
    operator: Operator
    file: CellFile
    kept: Path
    sure: bool = False
    patience: float = HAND_S
    laid: Mapping[str, str] = field(default_factory=dict)
    answers: dict[str, str] = field(default_factory=dict)
    pictures: list[str] = field(default_factory=list)
    job: str = ''

    @property
    def folder(self) -> Path:
        """Of what a commissioning keeps, made."""
        where = self.kept / FOLDER
        where.mkdir(parents=True, exist_ok=True)
        return where

    def ask(self, name: str, text: str, words: Sequence[str] = (), **more: Any) -> str:
        """The answer, noted."""
        question = Question(f'{self.step.name}.{name}', text, tuple(words), **more)
        harmless = not (self.step.moves or self.step.powered)
        known = self.sure and harmless and question.words == YES
        answer = 'yes' if known else self._by_operator(lambda: self.operator.ask(question))
        self.answers[question.id] = answer
        return answer

    def _by_operator(self, act: Callable[[], Answer]) -> Answer:
        """What a person gives. When that takes a while, all that the cell has said meanwhile is taken in: the torch may
        have been jogged, the machine may have lost its home."""
        begun = time.monotonic()
        given = act()
        if time.monotonic() - begun > MEANWHILE_S:
            self.cell.fresh(1)
        return given

    def number(self, name: str, text: str, low: float, high: float, unit: str) -> float:
        """A number that the operator reads."""
        return float(self.ask(name, text, low=low, high=high, unit=unit))

    def numbers(
        self, name: str, text: str, count: int, low: float, high: float, unit: str
    ) -> list[float]:
        """So many numbers that the operator has read."""
        said = self.ask(name, text, low=low, high=high, unit=unit, count=count)
        return [float(word) for word in said.split()]

    def by_hand(self, name: str, text: str, seen: Callable[[], object]) -> bool:
        """Says what is to be done, and waits until it shows; False when it does not."""
        self.operator.do(f'{self.step.name}.{name}', text, False)
        return self.cell.until(seen, self.patience)

    def say(self, name: str, text: str) -> None:
        """What is to be done and shows nowhere; returns when it is done."""
        self._by_operator(lambda: self.operator.do(f'{self.step.name}.{name}', text, True))

    def ready(self, text: str) -> None:
        """CommissionError unless the operator says yes."""
        if self.ask('ready', text, YES) != 'yes':
            raise CommissionError(f'step {self.step.name}: the operator is not ready')

    def draw(self, name: str, png: bytes) -> None:
        """A picture of this run, for the page."""
        (self.folder / f'{name}.png').write_bytes(png)
        self.pictures.append(f'{name}.png')


def at_home(visit: Visit) -> None:
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


def may_burn(visit: Visit) -> None:
    """CommissionError with every reason of the calibrations why no job may run."""
    kept = store.load_all(visit.kept)
    if reasons := refusals(kept.results, kept.damaged, visit.cell.told()):
        raise CommissionError(f'step {visit.step.name}: {"; ".join(reasons)}')


def keep(visit: Visit, result: Result, pictures: Sequence[bytes] = ()) -> Path:
    """As waam calibrate keeps it, so that a job looks at it; its file."""
    dated = result.of(datetime.now(UTC))
    page = report.page(dated, pictures, ['found by waam commission'])
    return store.save(visit.kept, dated, page)
