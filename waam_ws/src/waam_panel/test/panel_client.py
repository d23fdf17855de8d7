"""One connection to a served panel, byte by byte, and STOP from another one; and what stands for the bridge."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from pathlib import Path

from waam_node.stop_socket import OK, Listener


class Client:
    """One connection; reads answers as they come."""

    def __init__(self, panel) -> None:
        self.panel = panel
        self.socket = socket.create_connection(('127.0.0.1', panel.server.port), timeout=20)
        self.rest = b''

    def head(self, method: str, path: str, **headers: str) -> Client:
        given = {'Host': self.host, **headers}
        lines = [f'{method} {path} HTTP/1.1']
        lines += [f'{k.replace("_", "-")}: {v}' for k, v in given.items() if v]
        self.socket.sendall(('\r\n'.join(lines) + '\r\n\r\n').encode())
        return self

    def post(self, name: str, body: bytes = b'{}', **headers: str) -> Client:
        """A command of our own page."""
        given = {
            'Origin': self.panel.url, 'X_Waam_Csrf': self.panel.csrf, 'Content_Type': 'application/json',
            'Content_Length': str(len(body)), **headers,
        }  # fmt: skip
        self.head('POST', f'/api/{name}', **given)
        self.socket.sendall(body)
        return self

    @property
    def host(self) -> str:
        return f'127.0.0.1:{self.socket.getpeername()[1]}'

    def answer(self) -> tuple[int, bytes]:
        """Status and body of the next answer; (0, b'') when the connection ends without one."""
        while b'\r\n\r\n' not in self.rest:
            data = self.read()
            if not data:
                return 0, b''
            self.rest += data
        head, _, body = self.rest.partition(b'\r\n\r\n')
        lines = dict(line.split(b': ', 1) for line in head.split(b'\r\n')[1:] if b': ' in line)
        length = int(lines.get(b'Content-Length', b'0'))
        while len(body) < length:
            body += self.read()
        self.rest = body[length:]
        return int(head.split(b' ')[1]), body[:length]

    def read(self) -> bytes:
        try:
            return self.socket.recv(65536)
        except ConnectionError:
            return b''

    def close(self) -> None:
        self.socket.close()


def post(panel, name: str, body: bytes = b'{}', **headers: str) -> tuple[int, bytes]:
    """A command of our own page, and its answer."""
    client = Client(panel).post(name, body, **headers)
    answer = client.answer()
    client.close()
    return answer


def stops(panel) -> None:
    """STOP from a page of our own, at once."""
    before = panel.operations.asked.count(('stop',))
    client = Client(panel)
    began = time.monotonic()
    client.head('POST', '/api/stop', Origin=panel.url, Content_Length='0', Cookie=cookie(panel))
    assert client.answer()[0] == 200
    assert time.monotonic() - began < 10.0
    assert panel.operations.asked.count(('stop',)) == before + 1
    client.close()


def cookie(panel) -> str:
    if not panel.tokens:
        return ''
    value, _ = panel.cell.guard.login(panel.tokens['view'])
    return f'waam_session={value}'


class FakeBridge:
    """Counts what comes to the socket; `says` is its answer, None = none."""

    def __init__(self, path: Path) -> None:
        self.got: list[bytes] = []
        self.says: str | None = OK
        self._listener = Listener(str(path))
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                messages = self._listener.receive()
                if not messages:
                    return
                for order, whom in messages:
                    self.got.append(order)
                    if self.says is not None:
                        self._listener.answer(self.says, whom)

    def close(self) -> None:
        self._listener.close()
