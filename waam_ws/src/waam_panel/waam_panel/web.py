"""The web server of the panel: its thread, its checks in front of every request, pages and files.

aiohttp: server, WebSocket and multipart in one maintained library without a framework around it; everything runs in
one thread with one event loop, beside the thread of rclpy.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import socket
import ssl
import threading
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from waam_process.safe_files import FileError
from waam_shop.roles import Role

from . import (
    api,
    bodies,
    commission_page,
    history,
    program_page,
    routes,
    shop_api,
    standoff_page,
    stream,
)
from .auditing import denied, signed_in
from .cell import CELL, Cell
from .gate import BACKLOG, IDLE_S, Gate, source_of
from .routes import VISITOR, WHO, Handler, Route
from .security import COOKIE, REPORT_POLICY, Denied
from .worker import WorkError

LINGER_S = (
    2.0  # that the rest of a refused body is read and thrown away, so that the answer arrives
)
STATIC = Path(__file__).parent / 'static'
FILES = {
    '.html': 'text/html', '.css': 'text/css', '.js': 'text/javascript', '.svg': 'image/svg+xml',
}  # fmt: skip
_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'{stop}; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'; frame-src 'self' http://127.0.0.1:*"
)


async def _admit(cell: Cell, request: web.Request) -> None:
    """Host, origin, session, role and the length of the body, from the head alone. Raises Denied; a role that is too
    low goes into the audit log."""
    cell.guard.check_host(request.headers)
    cell.guard.check_site(request.headers)
    if request.method not in ('GET', 'HEAD'):
        cell.guard.check_origin(request.headers)
    role = routes.role_of(request)
    if role is not None:
        await _check_role(cell, request, role)
        if cell.gate:
            cell.gate.busy(request.protocol)
    bodies.check_announced(request, routes.limit_of(request, cell.upload_bytes))


async def _check_role(cell: Cell, request: web.Request, role: Role) -> None:
    cookie = request.cookies.get(COOKIE, '')
    try:
        visitor = cell.guard.check_read(request.headers, cookie, role)
    except Denied as e:
        if e.status == 403:
            await denied(cell, request, str(e))
        raise
    request[VISITOR] = visitor
    WHO.set(visitor.who)


@web.middleware
async def _checks(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Host and session before anything else; headers that keep other sites out of every answer."""
    cell: Cell = request.app[CELL]
    try:
        await _admit(cell, request)
        response = await handler(request)
    except Denied as e:
        if e.status == 401 and request.method == 'GET' and request.path == '/':
            response = web.HTTPSeeOther('/login')
        else:
            response = web.json_response({'ok': False, 'message': str(e)}, status=e.status)
        if request.body_exists and not request.content.at_eof():
            response.force_close()  # nobody wants the rest
    except web.HTTPException as e:
        response = e
    finally:
        if cell.gate:
            cell.gate.idle(request.protocol)
    headers = response.headers
    headers.setdefault('Content-Security-Policy', _policy(cell, request))
    headers['X-Content-Type-Options'] = 'nosniff'
    headers['X-Frame-Options'] = 'DENY'
    headers['Referrer-Policy'] = 'same-origin'
    headers['Cross-Origin-Resource-Policy'] = 'same-origin'
    headers['Cache-Control'] = 'no-store'
    if isinstance(response, web.HTTPException):
        raise response
    return response


def _policy(cell: Cell, request: web.Request) -> str:
    """The page may ask itself and, for STOP, the second way; its name is that of the page."""
    name = request.host.rpartition(':')[0] or request.host
    named = cell.stop_port and request.host.lower() in cell.guard.hosts
    return _POLICY.format(stop=f' {name}:{cell.stop_port}' if named else '')


@functools.cache
def _file(name: str) -> bytes:
    """A file of the page; read once."""
    return (STATIC / name).read_bytes()


def _page(name: str, **values: str) -> web.Response:
    text = _file(name).decode()
    for key, value in values.items():
        text = text.replace('{{' + key + '}}', value)
    return web.Response(text=text, content_type='text/html')


async def _index(request: web.Request) -> web.Response:
    cell: Cell = request.app[CELL]
    csrf = cell.guard.csrf(request.cookies.get(COOKIE, ''))
    return _page('index.html', csrf=csrf, boot=cell.boot, stop_port=str(cell.stop_port))


async def _login_page(_request: web.Request) -> web.Response:
    return _page('login.html')


async def _login(request: web.Request) -> web.Response:
    """Form with the token -> session cookie. A wrong one makes the next try from the same address wait."""
    cell: Cell = request.app[CELL]
    if not cell.guard.same_origin(request.headers):
        raise Denied(403, 'another origin')
    token = (await bodies.form(request)).get('token', '')
    loop, source = asyncio.get_running_loop(), source_of((request.remote,))
    await asyncio.sleep(cell.throttle.wait(source, loop.time()))
    if request.transport is None or request.transport.is_closing():
        raise Denied(408, 'nobody waits for the answer')
    try:
        value, visitor = cell.guard.login(token)
    except Denied as e:
        cell.throttle.wrong(source, loop.time())
        await denied(cell, request, str(e))
        raise
    cell.throttle.right(source)
    await signed_in(cell, visitor)
    response = web.HTTPSeeOther('/')
    secure = request.secure or request.headers.get('Origin', '').startswith('https')
    response.set_cookie(COOKIE, value, httponly=True, samesite='Strict', secure=secure, path='/')
    raise response


async def _style(_request: web.Request) -> web.Response:
    """What the door looks like; all else needs a session."""
    return web.Response(body=_file('panel.css'), content_type='text/css', charset='utf-8')


async def _static(request: web.Request) -> web.Response:
    file = STATIC / request.match_info['name']
    if file.parent != STATIC or file.suffix not in FILES or not file.is_file():
        raise web.HTTPNotFound
    body = _file(file.name)
    return web.Response(body=body, content_type=FILES[file.suffix], charset='utf-8')


async def _report(request: web.Request) -> web.StreamResponse:
    """report.html of a job, made when it is missing or old."""
    cell: Cell = request.app[CELL]
    name, inner = request.match_info['id'], request.match_info.get('inner', '')
    try:
        page = await cell.report_page(name, inner)
    except (history.HistoryError, FileError) as e:
        raise web.HTTPNotFound(text=str(e)) from None
    except WorkError as e:
        raise web.HTTPInternalServerError(text=f'the report cannot be made: {e}') from None
    headers = {'Content-Security-Policy': REPORT_POLICY}
    return web.Response(body=page, content_type='text/html', charset='utf-8', headers=headers)


async def _cells(request: web.Request) -> web.Response:
    cell: Cell = request.app[CELL]
    csrf = cell.guard.csrf(request.cookies.get(COOKIE, ''))
    return _page('cells.html', csrf=csrf, stop_port=str(cell.stop_port))


ROUTES = (
    Route('GET', '/', Role.VIEW, _index), Route('GET', '/cells', Role.VIEW, _cells),
    Route('GET', '/login', None, _login_page), Route('POST', '/api/login', None, _login, bodies.FORM),
    Route('GET', '/static/panel.css', None, _style), Route('GET', '/static/{name}', Role.VIEW, _static),
    Route('GET', '/jobs/{id}/report.html', Role.VIEW, _report),
    Route('GET', '/jobs/{id}/{inner}/report.html', Role.VIEW, _report),
)  # fmt: skip
ALL_ROUTES = (
    *ROUTES, *api.ROUTES, *commission_page.ROUTES, *program_page.ROUTES, *shop_api.ROUTES, *standoff_page.ROUTES,
    *stream.ROUTES,
)  # fmt: skip


def make_app(cell: Cell) -> web.Application:
    """All routes."""
    app = web.Application(middlewares=[_checks])
    app[CELL] = cell
    routes.add(app, ALL_ROUTES)
    return app


class WebServer:
    """Serves in a thread of its own. `problem` says why it does not; `port` is what it got (0 = any)."""

    def __init__(
        self,
        make_cell: Callable[[int], Cell],
        bind: str,
        port: int,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self.problem, self.port = '', port
        self._tls = tls
        self._make_cell, self._bind = make_cell, bind
        self._loop = asyncio.new_event_loop()
        self._ready, self._stop = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=self._run, name='web', daemon=True)
        self._thread.start()
        self._ready.wait(20.0)

    def close(self, timeout: float = 5.0) -> None:
        """Stops serving; waits at most `timeout` s for the thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(timeout)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as e:  # whatever it is, the node goes on and reports it
            self.problem = f'{type(e).__name__}: {e}'
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        listener = await self._listen()
        if listener is None:
            return
        cell = self._make_cell(self.port)
        runner = web.AppRunner(
            make_app(cell), access_log=None, shutdown_timeout=1.0, auto_decompress=False,
            keepalive_timeout=IDLE_S, lingering_time=LINGER_S,
        )  # fmt: skip
        await runner.setup()
        assert runner.server
        cell.gate = Gate(runner.server, self._tls)
        doors = self._loop.create_task(cell.gate.serve(listener))
        pump = self._loop.create_task(cell.pump())
        self._ready.set()
        stop = self._loop.create_task(self._stop.wait())
        await asyncio.wait((stop, pump, doors), return_when=asyncio.FIRST_COMPLETED)
        failed = next((t.exception() for t in (pump, doors) if t.done()), None)
        pump.cancel()
        doors.cancel()
        cell.close()
        await runner.cleanup()
        if failed:
            raise failed

    async def _listen(self) -> socket.socket | None:
        family = socket.AF_INET6 if ':' in self._bind else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((self._bind, self.port))
        except OSError as e:
            listener.close()
            self.problem = f'cannot listen on {self._bind} port {self.port}: {e.strerror}'
            return None
        self.port = listener.getsockname()[1]
        listener.listen(BACKLOG)
        return listener
