"""Requests of the page "G-code": /api/programs (list, upload), /api/program (look), /api/program/layer, load, start."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web

from waam_shop.roles import Role

from . import bodies, calibrated
from .bodies import BadBody, json_of
from .cell import CELL, Cell
from .commanding import check_command, logged
from .operations import Refused
from .programs import (
    DIALECTS,
    SHIFT_MM,
    PartsError,
    ProgramChoice,
    ProgramRefused,
    Programs,
    WorkError,
    parse_choice,
)
from .routes import UPLOAD, Handler, Route
from .setup_form import LOOP_MODE_LABELS, JobSetup

PROGRAMS: web.AppKey[Programs] = web.AppKey('programs', Programs)
Run = Callable[[Cell, Programs, dict[str, Any]], Awaitable[dict[str, Any]]]


async def look(cell: Cell, programs: Programs, data: dict[str, Any]) -> dict[str, Any]:
    """Checks, layers, totals; no points."""
    choice = parse_choice(data, cell.materials)
    found = await programs.look(choice, cell.state.sections.get('machine'))
    return {k: v for k, v in found.items() if k != 'beads'}


async def layer(cell: Cell, programs: Programs, data: dict[str, Any]) -> dict[str, Any]:
    """layer: from 1. The beads of it."""
    number = data.pop('layer', None)
    choice = parse_choice(data, cell.materials)
    beads = (await programs.look(choice, cell.state.sections.get('machine')))['beads']
    if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= len(beads):
        raise ProgramRefused(f'layer: 1 to {len(beads)}')
    return {'layer': number, 'beads': beads[number - 1]}


async def load(cell: Cell, programs: Programs, data: dict[str, Any]) -> dict[str, Any]:
    """Takes the program for the next start; on the simulated cell a plate is put on the table."""
    cell.check_no_job()
    choice = parse_choice(data, cell.materials)
    await programs.load(choice, cell.state.sections.get('machine'))
    programs.loaded = None
    said = await cell.do(cell.operations.load, JobSetup(part=choice.program, mode='build'), None)
    programs.loaded, cell.setup, cell.going_on = choice, None, None
    cell.state.sections['setup'] = {'part': choice.program, 'words': choice.words}
    return {'message': f'{choice.program}: {said}; arm, then start the program'}


def _ready(cell: Cell, programs: Programs) -> ProgramChoice:
    """The loaded program, if it may start. Raises Refused."""
    cell.check_no_job()
    if programs.loaded is None or cell.setup is not None or cell.going_on is not None:
        raise Refused('load the program first')
    if not (cell.state.sections.get('machine') or {}).get('armed'):
        raise Refused('press Arm first')
    return programs.loaded


async def start(cell: Cell, programs: Programs, data: dict[str, Any]) -> dict[str, Any]:
    """The goal is that of `waam job run program.gcode`. The program is looked at again: the file may have changed."""
    if data:
        raise ProgramRefused(f'unknown field {next(iter(data))!r}')
    choice = _ready(cell, programs)
    await programs.load(choice, cell.state.sections.get('machine'))
    choice = _ready(cell, programs)
    await calibrated.check(cell.calibrations, cell.settings)
    program, nominal = programs.paths(choice)
    said = await cell.do(cell.operations.start_program, choice, program, nominal, cell.jobs_dir)
    return {'message': said}


# ---- requests


async def _answer(doing: Awaitable[dict[str, Any]]) -> web.Response:
    """200 done; 400 a field or the program is wrong; 409 the cell refuses."""
    try:
        said = await doing
    except (BadBody, ProgramRefused, PartsError) as e:
        return web.json_response({'ok': False, 'message': str(e)}, status=400)
    except (Refused, WorkError) as e:
        return web.json_response({'ok': False, 'message': str(e)}, status=409)
    return web.json_response({'ok': True, 'message': 'done'} | said)


def _asked(run: Run) -> Handler:
    """The sender is checked by `logged`, or here where nothing is changed."""

    async def handler(request: web.Request) -> web.StreamResponse:
        cell = check_command(request)

        async def do() -> dict[str, Any]:
            return await run(cell, request.app[PROGRAMS], await json_of(request))

        return await _answer(do())

    return handler


async def _upload(request: web.Request) -> web.StreamResponse:
    """The file is the body, its name a query parameter."""
    cell, programs = request.app[CELL], request.app[PROGRAMS]
    name, data = request.query.get('name', ''), await bodies.read(request)

    async def save() -> dict[str, Any]:
        stored = await cell.beside.thread('uploads', programs.files.save, name, data)
        return {'message': f'{stored} is stored', 'name': stored}

    return await _answer(save())


async def _list(request: web.Request) -> web.Response:
    cell, programs = request.app[CELL], request.app[PROGRAMS]
    files, parts = programs.files, cell.parts
    found = await cell.beside.thread('files', lambda: (files.listing(), parts.listing()))
    return web.json_response(
        {
            'programs': found[0], 'parts': found[1], 'dialects': DIALECTS,
            'materials': cell.materials, 'loop_modes': list(LOOP_MODE_LABELS.items()),
            'loaded': programs.loaded.program if programs.loaded else '', 'shift_mm': SHIFT_MM,
        }
    )  # fmt: skip


def programs_of(cell: Cell) -> Programs:
    """What the page knows, for `app[PROGRAMS]`."""
    return Programs(cell.parts)


ROUTES = (
    Route('GET', '/api/programs', Role.VIEW, _list),
    Route('POST', '/api/programs', Role.OPERATE, logged('program upload', _upload), UPLOAD),
    Route('POST', '/api/program', Role.OPERATE, _asked(look)),
    Route('POST', '/api/program/layer', Role.OPERATE, _asked(layer)),
    Route('POST', '/api/program/load', Role.OPERATE, logged('program load', _asked(load))),
    Route('POST', '/api/program/start', Role.OPERATE, logged('program start', _asked(start))),
)  # fmt: skip
