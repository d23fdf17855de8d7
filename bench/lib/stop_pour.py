"""Keeps a panel busy until it is killed: python stop_pour.py KIND PORT CSRF [PORT ...].

strangers: bodies of 8 MB from another site; operators: bodies that are allowed, as large and as many as possible;
lists: everything that is read from files; half_open: 1100 connections that never ask.
"""

from __future__ import annotations

import itertools
import socket
import sys
import threading
from contextlib import suppress

BODY = b'a=1&' * (8 << 18)
JSON = b'{"mm": 1, "x": [' + b'1,' * 30000 + b'1]}'
LISTS = ('audit', 'queue', 'cells', 'jobs', 'choices', 'archive', 'programs', 'standoff')


def request(port: int, line: str, body: bytes = b'', chunked: bool = False, **headers: str) -> None:
    with suppress(OSError), socket.create_connection(('127.0.0.1', port), timeout=3) as s:
        given = {'Host': f'127.0.0.1:{port}', **headers}
        given |= {'Transfer-Encoding': 'chunked'} if chunked else {'Content-Length': str(len(body))}
        head = ''.join(f'{k.replace("_", "-")}: {v}\r\n' for k, v in given.items())
        s.sendall(f'{line} HTTP/1.1\r\n{head}\r\n'.encode())
        s.sendall(b'%x\r\n' % len(body) + body + b'\r\n0\r\n\r\n' if chunked else body)
        s.recv(65536)


def strangers(port: int, csrf: str) -> None:
    for n in itertools.count():
        path = ('stop', 'login', 'parts', 'jog')[n % 4]
        kind = 'application/x-www-form-urlencoded'
        request(
            port, f'POST /api/{path}', BODY, n % 8 > 3, Origin='http://x.example', Content_Type=kind
        )


def operators(port: int, csrf: str) -> None:
    for n in itertools.count():
        own = {'Origin': f'http://127.0.0.1:{port}', 'X_Waam_Csrf': csrf}
        if n % 8:
            kind = 'application/json'
            request(port, 'POST /api/jog_wire', JSON, n % 2 > 0, Content_Type=kind, **own)
        else:
            request(port, 'POST /api/parts?name=bench.stl', BODY, n % 16 > 0, **own)


def lists(port: int, csrf: str) -> None:
    for n in itertools.count():
        request(port, f'GET /api/{LISTS[n % len(LISTS)]}')


def half_open(ports: list[int]) -> None:
    held: list[socket.socket] = []
    for n in itertools.count():
        with suppress(OSError):
            s = socket.create_connection(('127.0.0.1', ports[n % len(ports)]), timeout=3)
            s.sendall((b'', b'P', b'POST /api/stop HTTP/1.1\r\nHost: ')[n % 3])
            held.append(s)
        if len(held) > 1100:
            held.pop(0).close()


if __name__ == '__main__':
    what, port, csrf, *more = sys.argv[1:]
    if what == 'half_open':
        half_open([int(port), *map(int, more)])
    run = {'strangers': strangers, 'operators': operators, 'lists': lists}[what]
    threads = [
        threading.Thread(target=run, args=(int(port), csrf))
        for _ in range(24 if run is lists else 6)
    ]
    for thread in threads:
        thread.start()
