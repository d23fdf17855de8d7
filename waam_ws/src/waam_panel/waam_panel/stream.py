"""The live stream: one WebSocket per page, read-only. Each page gets the newest when it is ready for it.

A page that does not read holds up only its own task: nothing is queued for it, and after a while it is disconnected.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time

from aiohttp import WSMsgType, web

from waam_shop.roles import Role

from .cell import CELL, Cell
from .routes import Route
from .security import COOKIE, Denied

FRAME_S = 0.2
PATIENCE_S = 10.0  # a page that takes no frame for so long is disconnected
MOST_PAGES = 16


async def _stream(request: web.Request) -> web.WebSocketResponse:
    cell: Cell = request.app[CELL]
    cell.guard.check_stream(request.headers, request.cookies.get(COOKIE, ''))
    if cell.pages >= MOST_PAGES:
        raise Denied(503, f'{MOST_PAGES} pages are open already')
    socket = web.WebSocketResponse(heartbeat=5.0, max_msg_size=1024, compress=False)
    await socket.prepare(request)
    cell.pages += 1
    sender = asyncio.create_task(_send(cell, socket, request))
    try:
        async for message in socket:  # pages send nothing; reading notices when they close
            if message.type not in (WSMsgType.PING, WSMsgType.PONG):
                break
    finally:
        sender.cancel()
        cell.pages -= 1
        with contextlib.suppress(asyncio.CancelledError, ConnectionError):
            await sender
    return socket


async def _send(cell: Cell, socket: web.WebSocketResponse, request: web.Request) -> None:
    taken, alarms = 0, -1
    while not socket.closed and cell.guard.visitor(request.cookies.get(COOKIE, '')):
        frame = cell.state.frame(time.monotonic(), taken, alarms)
        taken, alarms = cell.state.taken, cell.state.alarms.version
        text = json.dumps({'boot': cell.boot, 'utc': time.time(), **frame}, separators=(',', ':'))
        try:
            await asyncio.wait_for(socket.send_str(text), PATIENCE_S)
        except (TimeoutError, ConnectionError):
            if request.transport is not None:
                request.transport.abort()  # closing politely would wait for the page again
            return
        await asyncio.sleep(FRAME_S)
    await socket.close()  # signed out: the session has run out, or its token was revoked


ROUTES = (Route('GET', '/stream', Role.VIEW, _stream),)
