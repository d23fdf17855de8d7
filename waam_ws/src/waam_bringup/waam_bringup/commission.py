"""`waam commission`: the book on disk, who answers, and the run from step to step."""

from __future__ import annotations

import argparse
import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from waam_calibrate.commission import (
    BUILT,
    Book,
    CommissionError,
    Outcome,
    Step,
    from_data,
    table,
    to_data,
    wanted,
    without,
)
from waam_calibrate.commission_page import page, rows
from waam_node.files import write_atomically
from waam_node.locks import locked
from waam_process.cell_file import CellFile
from waam_process.cell_keys import CHUCK
from waam_process.safe_files import FileError, Missing, read_yaml
from waam_shop.cells import check_name

from . import cell_check, paths
from .cli_common import run_and_domain
from .commission_cell import CommissionedCell
from .commission_lines import Lines
from .commission_steps import run
from .commission_visit import FOLDER, HAND_S, Operator, Question, Visit
from .operate import graph_watch, require_up

BOOK, PAGE, LOCK = 'book.yaml', 'page.html', '.lock'
HEAD = '# Made by `waam commission`; the hash tells whether it was changed.\n'


@dataclass
class Shelf:
    """The book of a cell in the folder of its calibrations."""

    file: CellFile
    kept: Path

    def __post_init__(self) -> None:
        self.folder = self.kept / FOLDER
        self.book = self._read()

    def _read(self) -> Book:
        path, machine = self.folder / BOOK, self.file.machine_sha256
        name = paths.cell_name()
        try:
            return from_data(read_yaml(path), name, machine)
        except Missing:
            return Book(name, machine)
        except FileError as e:
            raise CommissionError(str(e)) from None
        except CommissionError as e:
            raise CommissionError(f'{path}: {e}') from None

    def add(self, step: Step, outcome: Outcome, firmware: str) -> None:
        """One more run, on disk before anything else is done."""
        self.book = self.book.with_run(step.name, outcome, _now(), firmware)
        self.folder.mkdir(parents=True, exist_ok=True)
        text = yaml.safe_dump(to_data(self.book), sort_keys=False, allow_unicode=True)
        write_atomically(self.folder / BOOK, HEAD + text)
        self.print_page()

    def print_page(self) -> Path:
        """Writes the page; its path."""
        self.folder.mkdir(parents=True, exist_ok=True)
        named = {n for e in self.book.entries.values() for n in e.outcome.pictures}
        drawn = {n: f.read_bytes() for n in named if (f := self.folder / Path(n).name).is_file()}
        write_atomically(self.folder / PAGE, page(self.book, _now(), drawn))
        return self.folder / PAGE

    def told(self, only: Step | None = None) -> dict[str, Any]:
        """For a program that shows it: steps, the one that is or would be run, and where cell file and page lie."""
        book, at = self.book, only or self.book.due()
        return {
            'cell': book.cell, 'file': str(cell_check.path_of(book.cell)), 'page': str(self.folder / PAGE),
            'passed': book.passed, 'of': len(BUILT), 'at': at.name if at else '', 'steps': rows(book),
        }  # fmt: skip

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Nobody else commissions this cell meanwhile. CommissionError names who does."""
        try:
            with locked(self.folder / LOCK, 0.0):
                self.book = self._read()
                yield
        except OSError as e:
            if e.errno != errno.EBUSY:
                raise
            who = str(e.strerror).rpartition(' by ')[2]
            raise CommissionError(
                f'the cell {self.book.cell} is being commissioned already by {who}'
            ) from None


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec='seconds')


class Terminal:
    """A person at the keyboard. Questions are numbered."""

    def __init__(self) -> None:
        self.count = 0

    def ask(self, question: Question) -> str:
        """Asks again until it is an answer. CommissionError at the end of the input."""
        self.count += 1
        while True:
            line = _line(f'{self.count:3}. {question.text} [{question.wanted}] ')
            answer = question.cleaned(line)
            if not (wrong := question.wrong(answer)):
                return answer
            print(f'     wanted is {wrong}')

    def do(self, action: str, text: str, wait: bool) -> None:
        """Prints it; wait: until Enter."""
        if wait:
            _line(f'     {text} Then Enter. ')
        else:
            print(f'     {text} (waiting for it)', flush=True)


def _line(text: str) -> str:
    try:
        return input(text)
    except EOFError:
        raise CommissionError(
            'nobody answers: give --answers FILE where there is no keyboard'
        ) from None


class AnswerFile:
    """Answers by the id of the question; what is to be done by hand is printed."""

    def __init__(self, file: Path) -> None:
        self._file = file
        try:
            told = read_yaml(file)
        except FileError as e:
            raise CommissionError(str(e)) from None
        if not isinstance(told, dict):
            raise CommissionError(f'{file}: must hold lines `step.question: answer`')
        self._told = {str(k): _word(v) for k, v in told.items()}

    def ask(self, question: Question) -> str:
        """CommissionError names the question that has no answer, or a wrong one."""
        told = self._told.get(question.id)
        if told is None:
            raise CommissionError(f'{self._file}: no answer to {question.id}: {question.text}')
        answer = question.cleaned(told)
        if wrong := question.wrong(answer):
            raise CommissionError(f'{self._file}: {question.id} is {answer!r}, wanted is {wrong}')
        print(f'     {question.text} {answer}')
        return answer

    def do(self, action: str, text: str, wait: bool) -> None:
        """Somebody else does it."""
        print(f'     {text}', flush=True)


def _word(value: object) -> str:
    """YAML makes a truth of yes and no, and a list of several numbers."""
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    return ' '.join(map(str, value)) if isinstance(value, list) else str(value)


def commission(args: argparse.Namespace) -> int:
    """The verb. Exit status 1 when a step fails. CommissionError, ClientError when nothing can be done."""
    os.environ[paths.CELL] = check_name(args.name or paths.cell_name())
    shelf = Shelf(_cell_file(), paths.calibrations_dir())
    if args.page or args.list and args.json:
        written = shelf.print_page()
        print(json.dumps(shelf.told()) if args.json else written)
        return 0
    if args.list:
        print(table(shelf.book))
        return 0
    step = wanted(args.step) if args.step else None
    operator, say = _operator(args, lambda: shelf.told(step))
    run_folder, domain = run_and_domain(args)
    board = not require_up(run_folder).simulated
    with shelf.alone(), CommissionedCell(domain, board, graph_watch(run_folder)) as cell:
        if not board:
            cell.meet_cell()
        return go_on(shelf, cell, operator, args.yes, step, say)


def _operator(
    args: argparse.Namespace, told: Callable[[], dict[str, Any]]
) -> tuple[Operator, Callable[[str], None]]:
    """Who answers, and who is told how it goes."""
    if args.json and args.answers:
        raise CommissionError('--json asks the program that reads it: leave out --answers')
    if args.json:
        lines = Lines(told)
        return lines, lines.say
    return AnswerFile(args.answers) if args.answers else Terminal(), print


def _cell_file() -> CellFile:
    path = cell_check.path_of(paths.cell_name())
    try:
        file = cell_check.load(path)
    except Missing:
        name = path.stem
        raise CommissionError(
            f'{cell_check.shown(path)}: no such file: waam cell new {name}, edit it, waam up --cell {name}'
        ) from None
    if CHUCK in file.values:
        raise CommissionError(
            f'{file.where(CHUCK)}: the commissioning of a chuck is not built (docs/real_cell.md); commission the '
            'machine with its straight X axis, under a cell file of its own'
        )
    return file


def go_on(
    shelf: Shelf, cell: CommissionedCell, operator: Operator, sure: bool = False, only: Step | None = None,
    say: Callable[[str], None] = print, patience: float = HAND_S,
) -> int:  # fmt: skip
    """Runs `only`, or every step that is due until one fails. Exit status. patience: s for what is done by hand.
    CommissionError for a closed gate."""
    if job := cell.running_job():
        raise CommissionError(f'a job is running: {job.job_id} (waam status, waam job abort)')
    while (step := only or shelf.book.due()) is not None:
        if closed := shelf.book.closed(step.name):
            raise CommissionError(f'step {step.name} is not due: {"; ".join(closed)}')
        at_hand = f' (at hand: {step.needs})' if step.needs else ''
        say(f'{step.name}: {step.title}{at_hand}')
        visit = Visit(step, cell, operator, shelf.file, shelf.kept, sure, patience, shelf.book.laid)
        outcome = run(visit)
        shelf.add(step, outcome, cell.machine.firmware_version if cell.machine else '')
        state = 'passed' if outcome.passed else 'FAILED' if outcome.there else 'not there'
        say(f'     {state}: {outcome.text}')
        if outcome.there and not outcome.passed:
            say(f'     to mend: {outcome.mend}, then waam commission {shelf.book.cell}')
            return 1
        if only:
            return 0
    book = shelf.book
    say(
        f'{book.passed} steps passed{without(book)}; the others are done by hand (docs/real_cell.md)'
    )
    return _checked(shelf, say)


def _checked(shelf: Shelf, say: Callable[[str], None]) -> int:
    """The cell file against the calibrations that were found."""
    kept, damaged = cell_check.certificates()
    wrong = [*cell_check.stale(shelf.file, kept), *damaged]
    for text in wrong or [
        f'{shelf.file.name}: nothing is wrong; page: {cell_check.shown(shelf.folder / PAGE)}'
    ]:
        say(text)
    return 1 if wrong else 0
