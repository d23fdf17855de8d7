"""What the panel writes into the audit log: in worker threads, before a command goes on, after STOP has."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from typing import Any

from aiohttp import web

from .cell import CELL, Cell
from .routes import visitor
from .security import COOKIE, Visitor

VIA = 'panel'
NOBODY = 'nobody'


class AuditFailure(RuntimeError):
    """The log cannot be written, so the command was not carried out."""


async def _write(cell: Cell, who: Visitor | None, what: str, outcome: str, **more: Any) -> None:
    if cell.shop:
        name, role = (who.who, who.role.label) if who else (NOBODY, '')
        await asyncio.to_thread(
            cell.shop.audit.write, what, name, VIA, outcome=outcome, role=role, **more
        )


async def _try(cell: Cell, who: Visitor | None, what: str, outcome: str, **more: Any) -> None:
    """One that cannot be written is reported, no more: what it is about has happened."""
    try:
        await _write(cell, who, what, outcome, **more)
    except OSError as e:
        cell.problem = f'audit log: {e.strerror}'


async def asked(request: web.Request, what: str, data: Mapping[str, Any]) -> None:
    """A command that is about to be carried out. Raises AuditFailure."""
    try:
        await _write(request.app[CELL], visitor(request), what, 'asked', data=data)
    except OSError as e:
        text = f'the audit log cannot be written ({e.strerror}); only STOP works without it'
        raise AuditFailure(text) from None


async def went_wrong(request: web.Request, what: str, answer: str) -> None:
    """A command that was refused; answer: the JSON that the page gets."""
    try:
        note = str(json.loads(answer).get('message', ''))
    except ValueError:
        note = answer  # a page
    await _try(request.app[CELL], visitor(request), what, 'refused', note=note)


async def stopped(request: web.Request, good: bool) -> None:
    """STOP was pressed."""
    outcome = 'ok' if good else 'refused'
    await _try(request.app[CELL], visitor(request), 'stop', outcome)


async def denied(cell: Cell, request: web.Request, why: str) -> None:
    """A wrong token, or a role that is too low."""
    who = cell.guard.visitor(request.cookies.get(COOKIE, '')) if cell.guard.tokens else None
    await _try(cell, who, request.path, 'denied', note=why)


async def signed_in(cell: Cell, who: Visitor) -> None:
    """Somebody has signed in."""
    await _try(cell, who, 'sign in', 'ok')
