"""The live stream: one WebSocket per page, read-only. A page gets what is now first: the state, and then what has
changed of it. What was (alarms, curves) follows in pieces, the newest first, between the frames that are live.

Every message is followed by a ping, and the next one waits for its pong: nothing piles up on a slow network, and a page
that takes nothing for a while is disconnected.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from typing import Any

from aiohttp import WSMsgType, web

from waam_shop.roles import Role

from .cell import CELL, Cell
from .routes import Route
from .security import COOKIE, Denied

FRAME_S = 0.2
PATIENCE_S = 10.0  # a page that takes no frame for so long is disconnected
MAX_PAGES = 16
ALARMS = 4  # in a frame
PIECE = 40  # samples of the past in a message


class Page:
    """What one page has been sent. Call `frame` for what it lacks now, `piece` for what it lacks of the past."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._taken = self._back = cell.state.taken
        self._sections: dict[str, str] = {}
        self._alarms: dict[int, int] = {}

    def frame(self) -> str:
        """JSON. sections: those that have changed; alarms: at most ALARMS that have; top: that of the banner."""
        state = self._cell.state
        frame = state.frame(time.monotonic(), self._taken)
        self._taken = state.taken
        now = {n: _json(value) for n, value in frame['sections'].items()}
        new = [n for n, text in now.items() if self._sections.get(n) != text]
        self._sections = now
        frame['sections'] = {n: frame['sections'][n] for n in new}
        top = state.alarms.top()
        frame |= {
            'top': top.id if top else None,
            'alarms': state.alarms.changed(self._alarms, ALARMS),
        }
        return _json({'boot': self._cell.boot, 'utc': time.time(), **frame})

    def piece(self) -> str:
        """JSON of the samples before those that it has, '' when it has all."""
        first, samples = self._cell.state.history(self._back, PIECE)
        self._back = first
        return _json({'boot': self._cell.boot, 'history': samples}) if samples else ''


def _json(value: Any) -> str:
    return json.dumps(value, separators=(',', ':'))


class _Line:
    """The socket of a page; `send` returns when the page has taken the message."""

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self.socket = socket
        self._taken = asyncio.Event()

    async def send(self, text: str) -> None:
        """TimeoutError when it is not taken within PATIENCE_S."""
        self._taken.clear()
        async with asyncio.timeout(PATIENCE_S):
            await self.socket.send_str(text)
            await self.socket.ping()
            await self._taken.wait()

    async def listen(self) -> None:
        """Until the page closes; it sends nothing but pongs."""
        async for message in self.socket:
            if message.type is WSMsgType.PING:
                await self.socket.pong(message.data)
            elif message.type is WSMsgType.PONG:
                self._taken.set()
            else:
                return


async def _stream(request: web.Request) -> web.WebSocketResponse:
    cell: Cell = request.app[CELL]
    cell.guard.check_stream(request.headers, request.cookies.get(COOKIE, ''))
    if cell.pages >= MAX_PAGES:
        raise Denied(503, f'{MAX_PAGES} pages are open already')
    socket = web.WebSocketResponse(autoping=False, max_msg_size=1024, compress=False)
    await socket.prepare(request)
    cell.pages += 1
    line = _Line(socket)
    sender = asyncio.create_task(_send(cell, line, request))
    try:
        await line.listen()
    finally:
        sender.cancel()
        cell.pages -= 1
        with contextlib.suppress(asyncio.CancelledError, ConnectionError):
            await sender
    return socket


async def _send(cell: Cell, line: _Line, request: web.Request) -> None:
    page = Page(cell)
    try:
        while not line.socket.closed and cell.guard.visitor(request.cookies.get(COOKIE, '')):
            due = time.monotonic() + FRAME_S
            await line.send(page.frame())
            while piece := page.piece():
                await line.send(piece)
                if time.monotonic() > due:
                    break
            await asyncio.sleep(max(0.0, due - time.monotonic()))
    except (TimeoutError, ConnectionError):
        if request.transport is not None:
            request.transport.abort()  # closing politely would wait for the page again
        return
    await line.socket.close()  # signed out: the session has run out, or its token was revoked


ROUTES = (Route('GET', '/stream', Role.VIEW, _stream),)
