"""Queue, cells, roles, audit log and messages on the page: /api/queue, /api/cells and the like."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from typing import Any

from aiohttp import web

from waam_shop.audit import Verdict
from waam_shop.job_queue import ENDED, Queue
from waam_shop.notifier import load, send
from waam_shop.notify_settings import NotifyError
from waam_shop.roles import Role

from .cell import CELL, Cell
from .commanding import BadRequest, command_routes
from .operations import InShop, Refused
from .parts import sha256_of
from .queued import fields_of, file_of
from .routes import WHO, Handler, Route, visitor
from .security import Visitor

SHOWN = 100  # items of the queue that a page gets
ENTRIES = 60  # of the audit log
Steer = Callable[[Queue, dict[str, Any], str], Queue]


def shop_of(cell: Cell) -> InShop:
    """Raises Refused for a panel without a shop."""
    if cell.shop is None:
        raise Refused('this panel belongs to no shop (parameter shop_dir)')
    return cell.shop


def whole(data: dict[str, Any], name: str) -> int:
    """A whole number. Raises BadRequest."""
    value = data.get(name)
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    raise BadRequest(f'{name}: {value!r}, must be a whole number')


# ---- the queue


async def queue_add(cell: Cell, data: dict[str, Any]) -> dict[str, Any]:
    """The fields of a form, as for `load`: of a part, or with `program` of a program; the files must be there."""
    by = WHO.get()
    fields = fields_of(data, cell.materials)
    file = file_of(fields, cell.parts)
    digest = await cell.background.thread('files', sha256_of, file)
    now = time.time()
    queue = await _change(cell, lambda q: q.add(fields, by, now, digest))
    return {'message': f'item {queue.last} waits', 'id': queue.last}


async def _change(cell: Cell, change: Callable[[Queue], Queue]) -> Queue:
    try:
        return await cell.background.thread('queue', shop_of(cell).queue.change, change)
    except OSError as e:
        raise Refused(f'the queue cannot be written: {e.strerror}') from None


def steer(how: Steer) -> Callable[[Cell, dict[str, Any]], Awaitable[str]]:
    """A change of one item, by its id."""

    async def run(cell: Cell, data: dict[str, Any]) -> str:
        id, by = whole(data, 'id'), WHO.get()
        queue = await _change(cell, lambda q: how(q, data, by))
        found = [i for i in queue.items if i.id == id]
        return f'item {id}: {found[0].state}' if found else f'item {id} is out of the queue'

    return run


def _release(queue: Queue, data: dict[str, Any], by: str) -> Queue:
    return queue.release(whole(data, 'id'), by)


def _move(queue: Queue, data: dict[str, Any], _by: str) -> Queue:
    return queue.move(whole(data, 'id'), whole(data, 'place'))


async def queue_release(cell: Cell, data: dict[str, Any]) -> str:
    """Its part lies on the table: it starts as soon as the cell is ready. Refused while a job runs."""
    if cell.state.job_running:  # or its node does not answer
        raise Refused('a job is running; release the next one when its part lies on the table')
    cell.check_no_job()
    return await steer(_release)(cell, data)


QUEUE = {
    'queue_add': queue_add, 'queue_release': queue_release, 'queue_move': steer(_move),
    'queue_remove': steer(lambda q, data, _: q.remove(whole(data, 'id'))),
    'queue_hold': steer(lambda q, data, _: q.hold(whole(data, 'id'))),
}  # fmt: skip


def _queue(cell: Cell) -> dict[str, Any]:
    queue = shop_of(cell).queue.read()
    items = queue.unfinished()
    ended = [i for i in queue.items if i.state in ENDED][-8:]
    shown = [asdict(i) | {'setup': None, 'part': i.part, 'material': i.setup.get('material', '')}
             for i in (*ended, *items[:SHOWN])]  # fmt: skip
    return {'count': len(items), 'items': shown}


# ---- cells, who, log, messages


def _cells(cell: Cell) -> dict[str, Any]:
    now, shop = time.time(), shop_of(cell)
    return {
        'here': shop.place.name, 'cells': [s.row(now) for s in shop.shop.cells()], 'queue': _queue(cell),
    }  # fmt: skip


def _audit(cell: Cell) -> dict[str, Any]:
    log = shop_of(cell).audit
    found: Verdict = log.verify()
    told = {'entries': found.entries, 'problems': found.problems[:10], 'last': found.last}
    return told | {'newest': [asdict(e) for e in log.last(ENTRIES)]}


async def notify_test(cell: Cell, _: dict[str, Any]) -> str:
    """A test message to every target. Refused when one did not take it: by name, never by address."""
    try:
        targets = load(shop_of(cell).shop.path).targets
    except NotifyError as e:
        raise Refused(str(e)) from None
    title = f'{shop_of(cell).place.name}: test'
    failed = [
        t.name
        for t in targets
        if not await cell.background.thread('test message', send, t, title, 'A test message.')
    ]
    if not targets:
        raise Refused('there are no targets (waam notify init)')
    if failed:
        raise Refused(f'not taken by {", ".join(failed)}')
    return f'taken by {len(targets)} targets'


def answers(read: Callable[[Cell], Any]) -> Handler:
    """The handler of a GET that reads files of the shop, in a thread of its own."""
    name = f'shop {read.__name__}'

    async def handler(request: web.Request) -> web.Response:
        try:
            cell = request.app[CELL]
            return web.json_response(await cell.background.thread(name, read, cell))
        except (Refused, ValueError, OSError) as e:
            return web.json_response({'ok': False, 'message': str(e)}, status=409)

    return handler


async def _me(request: web.Request) -> web.Response:
    who: Visitor = visitor(request)
    return web.json_response({'who': who.who, 'role': who.role.label})


ROUTES = (
    Route('GET', '/api/cells', Role.VIEW, answers(_cells)), Route('GET', '/api/queue', Role.VIEW, answers(_queue)),
    Route('GET', '/api/me', Role.VIEW, _me), Route('GET', '/api/audit', Role.MAINTAIN, answers(_audit)),
    *command_routes(QUEUE, Role.OPERATE), *command_routes({'notify_test': notify_test}, Role.MAINTAIN),
)  # fmt: skip
