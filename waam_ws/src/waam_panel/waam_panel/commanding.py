"""Requests that change something: sender checked, JSON read, audit log written, then carried out; and their routes.

What makes the cell safe (SAFE) is carried out first and written down afterwards.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web

from waam_shop.job_queue import QueueError
from waam_shop.roles import Role

from . import bodies, history
from .auditing import AuditFailure, asked, done, went_wrong
from .bodies import BadBody, json_of
from .cell import CELL, Cell
from .operations import Refused
from .parts import PartFolders, PartsError
from .programs import ProgramRefused
from .routes import UPLOAD, Handler, Route
from .security import COOKIE, CSRF_HEADER
from .setup_form import FormError
from .worker import WorkError

SAFE = ('pause', 'disarm')  # beside STOP, which has a handler of its own
KNOWN = (
    Refused, FormError, ProgramRefused, PartsError, WorkError, history.HistoryError, QueueError,
)  # fmt: skip
Run = Callable[[Cell, dict[str, Any]], Awaitable[Any]]


FORMS = ('load', 'queue_add', 'program/load')  # they check their fields themselves
FIELDS = {  # of every other command that takes any
    'jog': ('axis', 'direction', 'step', 'held'), 'jog_wire': ('mm',), 'override': ('speed', 'wire'),
    'gain': ('value',), 'acknowledge': ('id',), 'load_job': ('id',), 'queue_release': ('id',),
    'queue_move': ('id', 'place'), 'queue_remove': ('id',), 'queue_hold': ('id',),
    'commission/start': ('step',), 'commission/answer': ('number', 'answer'),
    'standoff': ('source', 'law', 'set_mm', 'up_mm', 'down_mm', 'wander_mm'),
}  # fmt: skip


class BadRequest(ValueError):
    """A request with invalid values."""


async def answered(run: Run, cell: Cell, data: dict[str, Any]) -> web.Response:
    """200 done; 409 refused by the cell; 400 invalid request. The text is for the operator."""
    try:
        said = await run(cell, data)
    except KNOWN as e:
        return web.json_response({'ok': False, 'message': str(e)}, status=409)
    except BadRequest as e:
        return web.json_response({'ok': False, 'message': str(e)}, status=400)
    more = said if isinstance(said, dict) else {'message': said}
    return web.json_response({'ok': True, 'message': 'done'} | more)


def check_fields(name: str, data: dict[str, Any]) -> None:
    """What a command does not know may have been meant to limit it. BadRequest names it and what there is."""
    known = FIELDS.get(name, ())
    if name in FORMS or not (unknown := [n for n in data if n not in known]):
        return
    takes = f'it takes {", ".join(known)}' if known else 'it takes none'
    raise BadRequest(f'{name}: unknown field {", ".join(map(repr, unknown))}; {takes}')


def session_of(request: web.Request) -> str:
    """The session cookie, '' without one."""
    return request.cookies.get(COOKIE, '')


def check_command(request: web.Request) -> Cell:
    """The cell, once the sender of a command is our own page. Raises Denied."""
    cell: Cell = request.app[CELL]
    csrf = request.headers.get(CSRF_HEADER, '')
    cell.guard.check_command(request.headers, session_of(request), csrf)
    return cell


def command(name: str, run: Run, asks: bool = False) -> Handler:
    """The handler of POST /api/<name>: checks, reads the JSON, writes the audit log, runs. asks: it changes nothing, so
    it is in no log."""
    told = name.replace('/', ' ')

    async def handler(request: web.Request) -> web.StreamResponse:
        cell = check_command(request)
        try:
            data = await json_of(request)
            if asks:
                return await answered(run, cell, data)
            if name in SAFE:
                return await done(request, name, await answered(run, cell, data))
            check_fields(name, data)
            return await audited(request, told, data, lambda: answered(run, cell, data))
        except (BadBody, BadRequest, AuditFailure) as e:
            status = 503 if isinstance(e, AuditFailure) else 400
            return web.json_response({'ok': False, 'message': str(e)}, status=status)

    return handler


async def audited(
    request: web.Request,
    name: str,
    data: dict[str, Any],
    run: Callable[[], Awaitable[web.StreamResponse]],
) -> web.StreamResponse:
    """Runs a command whose entry is in the log before; what went wrong follows. Raises AuditFailure: nothing ran."""
    await asked(request, name, data)
    answer = await run()
    if answer.status >= 400:
        await went_wrong(request, name, getattr(answer, 'text', '') or '{}')
    return answer


def listing(read: Callable[[Cell], Any]) -> Handler:
    """The handler of a GET that reads files, in a thread of its own."""

    async def handler(request: web.Request) -> web.Response:
        cell = request.app[CELL]
        return web.json_response(await cell.background.thread('files', read, cell))

    return handler


def command_routes(commands: dict[str, Run], role: Role, asks: bool = False) -> tuple[Route, ...]:
    """POST /api/<name> for every command of a table."""
    return tuple(
        Route('POST', f'/api/{n}', role, command(n, run, asks)) for n, run in commands.items()
    )


def upload_route(path: str, name: str, folders: Callable[[Cell], PartFolders]) -> Route:
    """POST /api/<path>: the file is the body, its name a query parameter. name: in the audit log."""

    async def handler(request: web.Request) -> web.StreamResponse:
        cell = check_command(request)
        data, file = await bodies.read(request), request.query.get('name', '')

        async def save(cell: Cell, _: dict[str, Any]) -> dict[str, Any]:
            stored = await cell.background.thread('uploads', folders(cell).save, file, data)
            return {'message': f'{stored} is stored', 'name': stored}

        try:
            told = {'name': file, 'bytes': len(data)}
            return await audited(request, name, told, lambda: answered(save, cell, {}))
        except AuditFailure as e:
            return web.json_response({'ok': False, 'message': str(e)}, status=503)

    return Route('POST', f'/api/{path}', Role.OPERATE, handler, UPLOAD)


def read_route(path: str, read: Callable[[Cell], Any]) -> Route:
    """GET of something that everybody who is in may see, as JSON."""
    return Route('GET', path, Role.VIEW, listing(read))
