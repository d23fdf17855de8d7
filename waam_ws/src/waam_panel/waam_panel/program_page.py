"""Requests of the page "G-code": /api/programs (list, upload), /api/program (look), /api/program/layer, load, start."""

from __future__ import annotations

from typing import Any

from waam_shop.roles import Role

from . import calibrated
from .cell import Cell
from .commanding import command_routes, read_route, upload_route
from .operations import Refused
from .programs import DIALECTS, SHIFT_MM, ProgramChoice, ProgramRefused, parse_choice
from .setup_form import LOOP_MODE_LABELS, JobSetup


async def look(cell: Cell, data: dict[str, Any]) -> dict[str, Any]:
    """Checks, layers, totals; no points."""
    choice = parse_choice(data, cell.materials)
    found = await cell.programs.look(choice, cell.state.sections.get('machine'))
    return {k: v for k, v in found.items() if k != 'beads'}


async def layer(cell: Cell, data: dict[str, Any]) -> dict[str, Any]:
    """layer: from 1. The beads of it."""
    number = data.pop('layer', None)
    choice = parse_choice(data, cell.materials)
    beads = (await cell.programs.look(choice, cell.state.sections.get('machine')))['beads']
    if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= len(beads):
        raise ProgramRefused(f'layer: 1 to {len(beads)}')
    return {'layer': number, 'beads': beads[number - 1]}


async def load(cell: Cell, data: dict[str, Any]) -> str:
    """Takes the program for the next start; on the simulated cell a plate is put on the table."""
    cell.check_no_job()
    choice, programs = parse_choice(data, cell.materials), cell.programs
    await programs.load(choice, cell.state.sections.get('machine'))
    programs.loaded = None
    said = await cell.do(cell.operations.load, JobSetup(part=choice.program, mode='build'), None)
    programs.loaded, cell.setup, cell.going_on = choice, None, None
    cell.state.sections['setup'] = {'part': choice.program, 'words': choice.words}
    return f'{choice.program}: {said}; arm, then start the program'


def _ready(cell: Cell) -> ProgramChoice:
    """The loaded program, if it may start. Raises Refused."""
    cell.check_no_job()
    if cell.programs.loaded is None or cell.setup is not None or cell.going_on is not None:
        raise Refused('load the program first')
    if not (cell.state.sections.get('machine') or {}).get('armed'):
        raise Refused('press Arm first')
    return cell.programs.loaded


async def start(cell: Cell, _: dict[str, Any]) -> str:
    """The goal is that of `waam job run program.gcode`. The program is looked at again: the file may have changed."""
    await cell.programs.load(_ready(cell), cell.state.sections.get('machine'))
    choice = _ready(cell)
    await calibrated.check(cell.calibrations, cell.settings)
    program, nominal = cell.programs.paths(choice)
    return await cell.do(cell.operations.start_program, choice, program, nominal, cell.jobs_dir)


def _list(cell: Cell) -> dict[str, Any]:
    programs = cell.programs
    return {
        'programs': programs.files.listing(), 'parts': cell.parts.listing(), 'dialects': DIALECTS,
        'materials': cell.materials, 'loop_modes': list(LOOP_MODE_LABELS.items()),
        'loaded': programs.loaded.program if programs.loaded else '', 'shift_mm': SHIFT_MM,
    }  # fmt: skip


ROUTES = (
    read_route('/api/programs', _list), upload_route('programs', 'program upload', lambda cell: cell.programs.files),
    *command_routes({'program': look, 'program/layer': layer}, Role.OPERATE, asks=True),
    *command_routes({'program/load': load, 'program/start': start}, Role.OPERATE),
)  # fmt: skip
