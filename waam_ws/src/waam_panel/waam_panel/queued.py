"""What may wait in the queue: a part with the form of "Set up", or a program with that of "G-code". No ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .cell import Cell
from .operations import Refused
from .parts import PartFolders
from .programs import ProgramChoice, Programs, parse_choice
from .setup_form import FormError, JobSetup, parse
from .worker import WorkError

PROGRAM = 'program'  # a setup with this field is that of a program


def fields_of(data: Mapping[str, Any], materials: tuple[str, ...]) -> dict[str, Any]:
    """All fields of an item, from JSON. Raises FormError or ProgramRefused."""
    if PROGRAM not in data:
        setup = parse(data, materials)
        if setup.wire_left_m:
            raise FormError(
                'wire_left_m: what will be on the spool then is not known; leave it out for the queue'
            )
        return setup.as_dict()
    choice = parse_choice(data, materials)
    return asdict(choice) | {'shift_mm': list(choice.shift_mm)}


def file_of(fields: Mapping[str, Any], parts: PartFolders) -> Path:
    """The file that an item means; the others that it names must be there, too. Raises PartsError."""
    if PROGRAM in fields:
        if fields['nominal']:
            parts.find(fields['nominal'])
        return Programs(parts).files.find(fields[PROGRAM])
    if fields['as_found']:
        parts.find(fields['as_found'])
    return parts.find(fields['part'])


class Start:
    """An item on its way: `load` puts it on the table of a simulated cell, `run` starts it."""

    def __init__(self, cell: Cell, fields: Mapping[str, Any]) -> None:
        """Raises FormError, ProgramRefused or PartsError."""
        self.cell, self.file = cell, file_of(fields, cell.parts)
        self.choice: ProgramChoice | None = None
        if PROGRAM in fields:
            self.choice = parse_choice(fields, cell.materials)
            self.setup = JobSetup(part=self.file.name, mode='build')
        else:
            self.setup = parse(fields, cell.materials)

    async def load(self) -> None:
        """A program is looked at first. Raises ProgramRefused and Refused."""
        cell, as_found = self.cell, None
        if self.choice:
            try:
                await Programs(cell.parts).load(self.choice, cell.state.sections.get('machine'))
            except WorkError as e:
                raise Refused(str(e)) from None
        elif self.setup.as_found:
            try:
                as_found = await cell.on_table(self.setup, cell.parts.find(self.setup.as_found))
            except WorkError as e:
                raise Refused(str(e)) from None
        await cell.do(cell.operations.load, self.setup, as_found)

    async def run(self) -> None:
        """Raises Refused."""
        cell = self.cell
        cell.setup, cell.going_on = self.setup, None  # what a page has loaded before does not start
        words = self.choice.words if self.choice else self.setup.words
        cell.state.sections['setup'] = self.setup.as_dict() | {'words': words}
        if self.choice:
            _, nominal = Programs(cell.parts).paths(self.choice)
            start = cell.operations.start_program
            await cell.do(start, self.choice, self.file, nominal, cell.jobs_dir)
        else:
            await cell.do(cell.operations.start, self.setup, self.file, cell.jobs_dir)
