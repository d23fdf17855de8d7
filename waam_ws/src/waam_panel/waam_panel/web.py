"""The web server of the panel: its thread, its checks in front of every request, pages and files.

aiohttp: server, WebSocket and multipart in one maintained library without a framework around it; everything runs in
one thread with one event loop, beside the thread of rclpy.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path

from aiohttp import web

from . import history
from .api import add_commands
from .cell import CELL, Cell
from .program_page import add_programs
from .security import COOKIE, Denied
from .stream import add_stream
from .worker import WorkError

STATIC = Path(__file__).parent / 'static'
FILES = {
    '.html': 'text/html', '.css': 'text/css', '.js': 'text/javascript', '.svg': 'image/svg+xml',
}  # fmt: skip
OPEN = ('/login', '/api/login', '/static/panel.css')  # may be asked for without a session
_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'; frame-src 'self' http://127.0.0.1:*"
)
_REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    'sandbox allow-popups allow-same-origin'
)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@web.middleware
async def _checks(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Host and session before anything else; headers that keep other sites out of every answer."""
    cell: Cell = request.app[CELL]
    try:
        cell.guard.check_host(request.headers)
        if request.path not in OPEN:
            cell.guard.check_read(request.headers, request.cookies.get(COOKIE, ''))
        response = await handler(request)
    except Denied as e:
        if e.status == 401 and request.method == 'GET' and request.path == '/':
            response = web.HTTPSeeOther('/login')
        else:
            response = web.json_response({'ok': False, 'message': str(e)}, status=e.status)
    except web.HTTPException as e:
        response = e
    headers = response.headers
    headers.setdefault('Content-Security-Policy', _POLICY)
    headers['X-Content-Type-Options'] = 'nosniff'
    headers['X-Frame-Options'] = 'DENY'
    headers['Referrer-Policy'] = 'same-origin'
    headers['Cross-Origin-Resource-Policy'] = 'same-origin'
    headers['Cache-Control'] = 'no-store'
    if isinstance(response, web.HTTPException):
        raise response
    return response


def _page(name: str, **values: str) -> web.Response:
    text = (STATIC / name).read_text(encoding='utf-8')
    for key, value in values.items():
        text = text.replace('{{' + key + '}}', value)
    return web.Response(text=text, content_type='text/html')


async def _index(request: web.Request) -> web.Response:
    cell: Cell = request.app[CELL]
    csrf = cell.guard.csrf(request.cookies.get(COOKIE, ''))
    return _page('index.html', csrf=csrf, boot=cell.boot)


async def _login_page(_request: web.Request) -> web.Response:
    return _page('login.html')


async def _login(request: web.Request) -> web.Response:
    """Form with the token -> session cookie. Tries are taken one by one, wrong ones cost a second."""
    cell: Cell = request.app[CELL]
    if not cell.guard.same_origin(request.headers):
        raise Denied(403, 'another origin')
    form = await request.post()
    async with cell.login_lock:
        try:
            value = cell.guard.login(str(form.get('token', '')))
        except Denied:
            await asyncio.sleep(cell.wrong_token_s)
            raise
    response = web.HTTPSeeOther('/')
    secure = request.headers.get('Origin', '').startswith('https')
    response.set_cookie(COOKIE, value, httponly=True, samesite='Strict', secure=secure, path='/')
    raise response


async def _static(request: web.Request) -> web.Response:
    file = STATIC / request.match_info['name']
    if file.parent != STATIC or file.suffix not in FILES or not file.is_file():
        raise web.HTTPNotFound
    return web.Response(body=file.read_bytes(), content_type=FILES[file.suffix], charset='utf-8')


async def _report(request: web.Request) -> web.StreamResponse:
    """report.html of a job, made when it is missing or old."""
    cell: Cell = request.app[CELL]
    name, inner = request.match_info['id'], request.match_info.get('inner', '')
    try:
        page = await cell.report_page(name, inner)
    except history.HistoryError as e:
        raise web.HTTPNotFound(text=str(e)) from None
    except WorkError as e:
        raise web.HTTPInternalServerError(text=f'the report cannot be made: {e}') from None
    headers = {'Content-Security-Policy': _REPORT_POLICY}
    return web.Response(
        body=page.read_bytes(), content_type='text/html', charset='utf-8', headers=headers
    )


def make_app(cell: Cell) -> web.Application:
    """All routes."""
    app = web.Application(middlewares=[_checks], client_max_size=cell.upload_bytes + 65536)
    app[CELL] = cell
    app.add_routes([
        web.get('/', _index), web.get('/login', _login_page), web.post('/api/login', _login),
        web.get('/static/{name}', _static), web.get('/jobs/{id}/report.html', _report),
        web.get('/jobs/{id}/{inner}/report.html', _report),
    ])  # fmt: skip
    add_programs(app)
    add_commands(app)
    add_stream(app)
    return app


class WebServer:
    """Serves in a thread of its own. `problem` says why it does not; `port` is what it got (0 = any)."""

    def __init__(self, make_cell: Callable[[int], Cell], bind: str, port: int) -> None:
        self.problem, self.port = '', port
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
        runner = web.AppRunner(make_app(cell), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        await web.SockSite(runner, listener).start()
        pump = self._loop.create_task(cell.pump())
        self._ready.set()
        stop = self._loop.create_task(self._stop.wait())
        await asyncio.wait((stop, pump), return_when=asyncio.FIRST_COMPLETED)
        failed = pump.exception() if pump.done() else None
        pump.cancel()
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
        return listener
