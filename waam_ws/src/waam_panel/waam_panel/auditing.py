"""What the panel writes into the audit log: before a command goes on; after it where the command makes the cell safe.

The log has one thread. A lock or a disk that hangs holds up commands that need an entry first, never one of those.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Mapping
from typing import Any

from aiohttp import web

from .background import AUDIT
from .cell import CELL, Cell
from .routes import visitor
from .security import COOKIE, Visitor

VIA = 'panel'
NOBODY = 'nobody'
BEFORE_S = 6.0  # that a command waits for its entry
AFTER_S = 0.5  # that the answer to what has been done waits for its entry
MAX_WAITING_ENTRIES = 200  # entries that wait


class AuditFailure(RuntimeError):
    """The log cannot be written, so the command was not carried out."""


def _begin(
    cell: Cell, who: Visitor | None, what: str, outcome: str, **more: Any
) -> asyncio.Task[str]:
    """An entry on its way; '' in the end, or why it could not be written, which is also told as a problem."""

    async def write() -> str:
        if cell.shop is None:
            return ''
        name, role = (who.who, who.role.label) if who else (NOBODY, '')
        log = cell.shop.audit

        def put() -> None:
            log.write(what, name, VIA, outcome=outcome, role=role, **more)

        try:
            if cell.entries >= MAX_WAITING_ENTRIES:
                raise OSError(0, f'{MAX_WAITING_ENTRIES} entries wait already')
            cell.entries += 1
            try:
                await cell.background.thread(AUDIT, put)
            finally:
                cell.entries -= 1
        except OSError as e:
            cell.problem = f'audit log: no entry of {what!r} by {name}: {e.strerror}'
            print(f'waam: {cell.problem}', file=sys.stderr, flush=True)
            return e.strerror or str(e)
        return ''

    task = asyncio.ensure_future(write())
    cell.writing.add(task)
    task.add_done_callback(cell.writing.discard)
    return task


async def _wait(task: asyncio.Task[str], patience: float) -> str:
    done, _ = await asyncio.wait({task}, timeout=patience)
    return task.result() if done else f'not within {patience:g} s'


async def asked(request: web.Request, what: str, data: Mapping[str, Any]) -> None:
    """A command that is about to be carried out. Raises AuditFailure."""
    cell, who = request.app[CELL], visitor(request)
    if why := await _wait(_begin(cell, who, what, 'asked', data=data), BEFORE_S):
        text = f'the audit log cannot be written ({why}); only what makes the cell safe works without it'
        _begin(cell, who, what, 'refused', note='its entry came too late')
        raise AuditFailure(text) from None


async def went_wrong(request: web.Request, what: str, answer: str) -> None:
    """A command that was refused; answer: the JSON that the page gets."""
    task = _begin(request.app[CELL], visitor(request), what, 'refused', note=_note(answer))
    await _wait(task, AFTER_S)


def _note(answer: str) -> str:
    try:
        return str(json.loads(answer).get('message', ''))
    except ValueError:
        return answer  # a page


async def done(request: web.Request, what: str, answer: web.Response) -> web.Response:
    """What makes the cell safe has been done (or was refused): its entry follows. The answer says when there is none
    yet, but waits for it only a moment."""
    good = answer.status == 200
    note = '' if good else _note(answer.text or '')
    task = _begin(request.app[CELL], visitor(request), what, 'ok' if good else 'refused', note=note)
    if why := await _wait(task, AFTER_S):
        told = json.loads(answer.text or '{}')
        told['message'] = f'{told.get("message", "")} (not in the audit log: {why})'
        return web.json_response(told, status=answer.status)
    return answer


async def denied(cell: Cell, request: web.Request, why: str) -> None:
    """A wrong token, or a role that is too low."""
    who = cell.guard.visitor(request.cookies.get(COOKIE, '')) if cell.guard.tokens else None
    await _wait(_begin(cell, who, request.path, 'denied', note=why), AFTER_S)


async def signed_in(cell: Cell, who: Visitor) -> None:
    """Somebody has signed in."""
    await _wait(_begin(cell, who, 'sign in', 'ok'), AFTER_S)
