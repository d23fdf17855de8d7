"""The second way for STOP of the page: a process of its own, with a port of its own. Standard library only.

It shares nothing with the panel but the rules of who may ask (`security`): neither loop nor threads, no ROS, and no
disk while it answers. POST /api/stop puts one byte into the socket of the bridge; nothing else is served. The body is
never read. From another site nothing is taken, and a session is needed where the page needs one.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import socket
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from waam_node import stop_socket

from .gate import BACKLOG, Gate
from .security import COOKIE, Denied, Guard, KnownTokens, open_tokens, tls_context

PATH = '/api/stop'
HEAD = 8192  # bytes of request line and headers
ANSWER_S = 1.0  # for the bridge
PARENT_S = 0.5  # between two looks at the parent
URGENT = -10  # nice value, where the account may have it
Head = tuple[str, str, dict[str, str]]  # method, path, headers by name in small letters


class Headers(Mapping[str, str]):
    """Headers of a request, found in any case, as the rules want them."""

    def __init__(self, found: dict[str, str]) -> None:
        self._found = found

    def __getitem__(self, name: str) -> str:
        return self._found[name.lower()]

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name.lower() in self._found


def parse(head: bytes) -> Head:
    """Method, path and headers. Raises Denied 400 for what is no request, or says a header twice."""
    lines = head.decode('latin-1').split('\r\n')
    words = lines[0].split(' ')
    if len(words) != 3 or not words[2].startswith('HTTP/1.'):
        raise Denied(400, 'no request')
    found: dict[str, str] = {}
    for line in lines[1:]:
        name, colon, value = line.partition(':')
        if not colon or not name or name != name.strip() or name.lower() in found:
            raise Denied(400, 'headers that cannot be read')
        found[name.lower()] = value.strip()
    return words[0], words[1], found


@dataclass(frozen=True)
class Rules:
    """page: as of the panel's page, whose Origin is wanted; here: names that this port may be asked by."""

    page: Guard
    here: Guard

    def check(self, method: str, path: str, headers: Mapping[str, str]) -> str:
        """The page's origin, once everything is right. Raises Denied."""
        self.here.check_host(headers)
        origin = headers.get('Origin', '')
        url = urlsplit(origin)
        if url.scheme not in ('http', 'https') or url.netloc.lower() not in self.page.hosts:
            raise Denied(403, 'another origin')
        if headers.get('Sec-Fetch-Site', 'same-site') not in ('same-site', 'same-origin'):
            raise Denied(403, 'another site')
        if path != PATH:
            raise Denied(404, 'only STOP is here')
        if method != 'POST':
            raise Denied(405, 'POST only')
        if self.page.visitor(_cookie(headers)) is None:
            raise Denied(401, 'sign in first')
        return origin


def _cookie(headers: Mapping[str, str]) -> str:
    try:
        found = SimpleCookie(headers.get('Cookie', '')).get(COOKIE)
    except CookieError:
        return ''
    return found.value if found else ''


class Visit(asyncio.Protocol):
    """One connection, one answer."""

    def __init__(self, rules: Rules, path: str) -> None:
        self._rules, self._path = rules, path
        self._head = b''
        self._answer: asyncio.Task[None] | None = None
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See asyncio."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """The head; what comes behind it is thrown away."""
        if self._answer is not None or self._transport is None:
            return
        self._head += data
        head, end, _ = self._head.partition(b'\r\n\r\n')
        if end and len(head) <= HEAD:
            self._head = b''
            self._answer = asyncio.ensure_future(self._respond(head))
        elif len(self._head) > HEAD:
            self._send(431, 'the head of the request is too long')

    async def _respond(self, head: bytes) -> None:
        origin = ''
        try:
            method, path, headers = parse(head)
            origin = self._rules.check(method, path, Headers(headers))
        except Denied as e:
            self._send(e.status, str(e))
            return
        except Exception as e:  # of a request: this one is refused, the next one is served
            self._send(400, f'{type(e).__name__}')
            return
        problem = await stop(self._path)
        self._send(503 if problem else 200, f'STOP: {problem}' if problem else 'stopped', origin)

    def _send(self, status: int, message: str, origin: str = '') -> None:
        if self._transport is None or self._transport.is_closing():
            return
        body = json.dumps({'ok': status == 200, 'message': message}).encode()
        lines = [
            f'HTTP/1.1 {status} {HTTPStatus(status).phrase}', 'Content-Type: application/json', 'Connection: close',
            f'Content-Length: {len(body)}', 'Cache-Control: no-store', 'X-Content-Type-Options: nosniff',
            'Vary: Origin',
        ]  # fmt: skip
        if origin:  # one of the page's own, compared as a whole
            lines += [f'Access-Control-Allow-Origin: {origin}']
            lines += ['Access-Control-Allow-Credentials: true']
        self._transport.write('\r\n'.join(lines).encode('latin-1') + b'\r\n\r\n' + body)
        self._transport.close()

    def connection_lost(self, error: Exception | None) -> None:
        """See asyncio. A STOP that has begun is carried out."""
        self._transport = None


async def stop(path: str) -> str:
    """One byte to the bridge; '' when it has told the controller, else why not."""
    try:
        waiting = stop_socket.post(path, stop_socket.STOP)
    except OSError as e:
        return stop_socket.reason(e)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(ANSWER_S):
            text = (await loop.sock_recv(waiting, stop_socket.MAX_ANSWER_BYTES)).decode(
                'utf-8', 'replace'
            )
    except TimeoutError:
        return f'the bridge did not answer within {ANSWER_S:g} s'
    except OSError as e:
        return stop_socket.reason(e)
    finally:
        waiting.close()
    if not text:  # its queue was full: the order went by the pipe; or it has died
        return 'the bridge gives no answer'
    return '' if text == stop_socket.OK else text


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(prog='stop_lane', description='STOP of the page by another way')
    p.add_argument('--socket', required=True, help='of the bridge: <run>/stop')
    p.add_argument('--port', type=int, required=True, help='to listen on; 0 = any free one')
    p.add_argument('--page-port', type=int, required=True, help='of the page')
    p.add_argument('--bind', default='127.0.0.1', help='as of the page')
    p.add_argument('--token-file', default='', help='as of the page')
    p.add_argument('--tls-cert', default='', help='as of the page')
    p.add_argument('--tls-key', default='', help='as of the page')
    p.add_argument('--hosts', default='', help='as allowed_hosts of the page')
    p.add_argument('--ends-with', type=int, default=0, help='parent whose end ends it, too')
    return p


def rules_of(args: argparse.Namespace) -> Rules:
    """Raises ValueError as the panel does: tokens or TLS missing, damaged."""
    tls = bool(args.tls_cert)
    file = open_tokens(args.token_file, args.bind, tls)
    known = KnownTokens(file) if file else None
    hosts = tuple(h for h in args.hosts.split(',') if h.strip())
    page = Guard.create(known, args.bind, args.page_port, hosts)
    bare = tuple(h.strip().partition(':')[0] for h in hosts)
    names = Guard.create(None, args.bind, args.port, bare).hosts
    return Rules(page, replace(page, hosts=names))


async def serve(args: argparse.Namespace) -> None:
    """Until it is cancelled. ValueError when the port is taken."""
    family = socket.AF_INET6 if ':' in args.bind else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((args.bind, args.port))
    except OSError as e:
        raise ValueError(f'cannot listen on {args.bind} port {args.port}: {e.strerror}') from None
    listener.listen(BACKLOG)
    args.port = listener.getsockname()[1]
    rules = rules_of(args)
    tls = tls_context(args.tls_cert, args.tls_key)
    print(f'STOP listens on {args.bind} port {args.port}', flush=True)
    gate = Gate(lambda: Visit(rules, args.socket), tls)
    task = asyncio.ensure_future(gate.serve(listener))
    parent = asyncio.ensure_future(_await_orphaned(args.ends_with, task))
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    with suppress(asyncio.CancelledError):
        await task
    parent.cancel()


async def _await_orphaned(parent: int, task: asyncio.Task[None]) -> None:
    while parent and os.getppid() == parent:
        await asyncio.sleep(PARENT_S)
    if parent:
        task.cancel()


def main() -> None:
    """Exit status 2 when it cannot listen."""
    args = arguments().parse_args()
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, URGENT)
    code = 0
    try:
        asyncio.run(serve(args))
    except (ValueError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        pass
    sys.stdout.flush()
    os._exit(code)  # the thread of the tokens may wait for a disk


if __name__ == '__main__':
    main()
