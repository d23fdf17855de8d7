"""Nobody who may not ask makes the panel work: bodies are not read before the sender is known, half-open connections
push out each other, wrong tokens cost those who send them. STOP from another connection works meanwhile. No ROS."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_panel import bodies
from waam_panel.gate import IN_ALL, PER_SOURCE, source_of
from waam_panel.throttle import LONGEST_S, SOURCES, Throttle
from waam_panel.web import ALL_ROUTES

POSTS = sorted(
    r.path.replace('{name}', 'height') for r in ALL_ROUTES if r.method == 'POST'
)  # every one
LARGE = 8 << 20
FORM = 'application/x-www-form-urlencoded'
KINDS = (FORM, 'application/json', 'multipart/form-data; boundary=x', 'text/plain')


class Client:
    """One connection; reads answers as they come."""

    def __init__(self, panel) -> None:
        self.socket = socket.create_connection(('127.0.0.1', panel.server.port), timeout=20)
        self.rest = b''

    def head(self, method: str, path: str, **headers: str) -> Client:
        given = {'Host': self.host, **headers}
        lines = [f'{method} {path} HTTP/1.1']
        lines += [f'{k.replace("_", "-")}: {v}' for k, v in given.items() if v]
        self.socket.sendall(('\r\n'.join(lines) + '\r\n\r\n').encode())
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
        lines = dict(
            line.split(b': ', 1) for line in head.split(b'\r\n')[1:] if b': ' in line
        )
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


@pytest.fixture
def locked(make_panel):
    return make_panel(tokens=True)


@pytest.mark.parametrize('chunked', [False, True], ids=['length', 'chunked'])
def test_no_body_of_a_stranger_is_read(locked, chunked):
    """On every route and for every kind of body, the answer comes while the first byte of it is still to be sent."""
    size = {'Transfer_Encoding': 'chunked'} if chunked else {'Content_Length': str(LARGE)}
    for path in POSTS:
        for kind in KINDS:
            client = Client(locked)
            client.head('POST', path, Origin=locked.url, Content_Type=kind, **size)
            if path == '/api/login' and chunked:
                client.socket.sendall(b'1000\r\n' + bytes(0x1000) + b'\r\n')
            status, _ = client.answer()
            wanted = (413, 401) if path == '/api/login' else (401,)
            assert status in wanted, (path, kind)
            client.close()
    stops(locked)
    assert [a for a in locked.operations.asked if a != ('stop',)] == []


@pytest.mark.parametrize('chunked', [False, True], ids=['length', 'chunked'])
@pytest.mark.parametrize(
    'forged',
    [{'Origin': 'http://evil.example'}, {'Sec_Fetch_Site': 'cross-site'}, {'Host': 'evil.example'}],
    ids=['origin', 'site', 'host'],
)
def test_no_body_from_another_site_is_read(panel, forged, chunked):
    """The browser of the cell's computer itself sends it; no session is needed there."""
    size = {'Transfer_Encoding': 'chunked'} if chunked else {'Content_Length': str(LARGE)}
    for path in POSTS:
        client = Client(panel)
        client.head('POST', path, **{'Origin': panel.url, 'Content_Type': FORM, **size, **forged})
        assert client.answer()[0] in (403, 421), path
        client.close()
    stops(panel)
    assert [a for a in panel.operations.asked if a != ('stop',)] == []


def test_while_a_large_body_arrives_others_are_served(locked):
    """Eight strangers pour 8 MB each into the panel; between their pieces STOP is answered."""
    pouring = [Client(locked) for _ in range(8)]
    for n, client in enumerate(pouring):
        path = POSTS[n % len(POSTS)]
        client.head(
            'POST', path, Origin=locked.url, Content_Type=FORM, Content_Length=str(LARGE)
        )
    piece = b'a=1&' * 16384
    for _ in range(LARGE // len(piece) // 16):
        for client in pouring:
            with contextlib.suppress(OSError):
                client.socket.settimeout(0.05)
                client.socket.sendall(piece)
        stops(locked)
    for client in pouring:
        client.close()


@pytest.mark.parametrize('chunked', [False, True], ids=['length', 'chunked'])
def test_every_route_has_a_limit_for_those_who_may_ask(panel, chunked):
    """One byte more than allowed is refused by name, announced or not; what is allowed is taken."""
    csrf = {'X_Waam_Csrf': panel.csrf, 'Origin': panel.url, 'Content_Type': 'application/json'}
    for path in POSTS:
        route = next(r for r in ALL_ROUTES if r.path == path and r.method == 'POST')
        limit = panel.cell.upload_bytes if route.body < 0 else route.body
        client = Client(panel)
        body = b'"' + b'x' * (limit - 1) + b'"'
        if path in ('/api/login', '/api/stop'):
            headers = csrf | {'Content_Type': FORM}
            if path == '/api/stop':
                headers |= {'X_Waam_Csrf': '', 'Origin': ''}  # then the form is read
        else:
            headers = csrf
        if chunked:
            client.head('POST', path, Transfer_Encoding='chunked', **headers)
            with contextlib.suppress(OSError):
                client.socket.sendall(b'%x\r\n' % len(body) + body + b'\r\n0\r\n\r\n')
        else:
            client.head('POST', path, Content_Length=str(len(body)), **headers)
        status, said = client.answer()
        assert status == 413 and str(bodies.FORM if limit < 1000 else 'longer') in said.decode(), path
        client.close()
    assert panel.operations.asked == []


def test_a_body_of_the_allowed_length_is_taken_in_chunks_as_well(panel):
    data = json.dumps({'mm': 5.0, 'note': 'x' * (bodies.COMMAND - 40)}).encode()
    client = Client(panel)
    client.head(
        'POST', '/api/jog_wire', Origin=panel.url, X_Waam_Csrf=panel.csrf,
        Content_Type='application/json', Transfer_Encoding='chunked',
    )  # fmt: skip
    for k in range(0, len(data), 1000):
        piece = data[k : k + 1000]
        client.socket.sendall(b'%x\r\n' % len(piece) + piece + b'\r\n')
    client.socket.sendall(b'0\r\n\r\n')
    assert client.answer()[0] == 200
    client.close()


@pytest.mark.parametrize('packed', ['gzip', 'deflate', 'br', 'x'])
def test_packed_bodies_are_not_unpacked(panel, packed):
    client = Client(panel)
    client.head(
        'POST', '/api/home', Origin=panel.url, X_Waam_Csrf=panel.csrf, Content_Type='application/json',
        Content_Encoding=packed, Content_Length='100',
    )  # fmt: skip
    assert client.answer()[0] == 415
    client.close()


@pytest.mark.parametrize('text', ['[' * 60_000, '{"a":' * 10_000, '9' * 5000, '{"mm":' + '9' * 4400 + '}'])
def test_json_that_is_too_deep_or_too_long_is_refused_by_name(panel, text):
    client = Client(panel)
    client.head(
        'POST', '/api/jog_wire', Origin=panel.url, X_Waam_Csrf=panel.csrf,
        Content_Type='application/json', Content_Length=str(len(text)),
    )  # fmt: skip
    client.socket.sendall(text.encode())
    status, said = client.answer()
    assert status == 400 and b'JSON' in said
    client.close()


def test_a_form_that_never_comes_ends_in_time(panel, monkeypatch):
    monkeypatch.setattr(bodies, 'PATIENCE_S', 0.3)
    client = Client(panel)
    client.head('POST', '/api/stop', Content_Type=FORM, Content_Length='100')
    assert client.answer()[0] == 408
    client.close()
    assert panel.operations.asked == []


# ---- connections


def test_half_open_connections_push_out_each_other(panel):
    """More of them than there may be descriptors; who asks is answered, and they never count more than they may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 4096:
        pytest.skip('this account may not open 1100 connections')
    script = (
        'import socket, sys, time\n'
        'import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (4096, 4096))\n'
        'held = []\n'
        'for n in range(1100):\n'
        '    s = socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=20)\n'
        '    s.sendall([b"", b"P", b"POST /api/stop HTTP/1.1\\r\\nHost: x"][n % 3])\n'
        '    held.append(s)\n'
        'print("held", flush=True); sys.stdin.read()\n'
    )
    flood = subprocess.Popen(
        [sys.executable, '-c', script, str(panel.server.port)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert flood.stdout and flood.stdin
        most = 0
        answered = threading.Event()

        def look() -> None:
            nonlocal most
            while not answered.wait(0.01):
                most = max(most, len(panel.cell.gate.inside))

        watcher = threading.Thread(target=look)
        watcher.start()
        assert flood.stdout.readline() == b'held\n'
        for _ in range(5):
            client = Client(panel)
            client.head('GET', '/api/me')
            assert client.answer()[0] == 200
            client.close()
        stops(panel)
        answered.set()
        watcher.join()
        assert most <= PER_SOURCE <= IN_ALL
        assert len(os.listdir('/proc/self/fd')) < soft
    finally:
        flood.stdin.close()
        flood.wait(20)


def test_a_connection_that_never_asks_ends(panel, monkeypatch):
    monkeypatch.setattr('waam_panel.gate.HEAD_S', 0.3)
    silent, slow = Client(panel), Client(panel)
    slow.socket.sendall(b'GET /api/me HTTP/1.1\r\nX: ')
    for client in (silent, slow):
        assert client.read() == b''
        client.close()


def test_a_request_that_is_being_answered_is_not_pushed_out(panel):
    panel.operations.hang.clear()
    working = Client(panel)
    working.head(
        'POST', '/api/home', Origin=panel.url, X_Waam_Csrf=panel.csrf,
        Content_Type='application/json', Content_Length='2',
    )  # fmt: skip
    working.socket.sendall(b'{}')
    end = time.monotonic() + 20
    while not any(g.until is None for g in list(panel.cell.gate.inside)):
        assert time.monotonic() < end
        time.sleep(0.01)
    others = [Client(panel) for _ in range(PER_SOURCE + 20)]
    stops(panel)
    panel.operations.hang.set()
    assert working.answer()[0] == 200
    for client in (*others, working):
        client.close()


@pytest.mark.parametrize(
    'address,source',
    [
        (('10.0.0.1', 5), '10.0.0.1'), (('::ffff:10.0.0.1', 5, 0, 0), '10.0.0.1'),
        (('2001:db8:1:2:3::4', 5, 0, 0), '2001:db8:1:2::/64'), (('fe80::1%eth0', 5, 0, 2), 'fe80::/64'),
        (('::1', 5, 0, 0), '::/64'), ('', ''), (None, ''),
    ],
)  # fmt: skip
def test_addresses_of_one_computer_count_together(address, source):
    assert source_of(address) == source


# ---- signing in


def sign_in(panel, token: str) -> Client:
    body = f'token={token}'.encode()
    client = Client(panel)
    client.head(
        'POST', '/api/login', Origin=panel.url, Content_Type=FORM, Content_Length=str(len(body))
    )
    client.socket.sendall(body)
    return client


def test_forty_who_hang_up_hold_up_nobody_for_long(locked):
    """The right token from the same address waits for a moment, not for all of them."""
    locked.cell.throttle = Throttle(1.0)
    for _ in range(40):
        sign_in(locked, 'waam_00000000_wrong').close()
    began = time.monotonic()
    client = sign_in(locked, locked.tokens['view'])
    assert client.answer()[0] == 303
    assert time.monotonic() - began < LONGEST_S + 10.0
    client.close()


@given(
    st.lists(st.tuples(st.integers(0, 3), st.floats(0.0, 5.0), st.booleans()), max_size=60),
    st.floats(0.01, 5.0),
)
def test_nobody_waits_for_another_one_or_for_longer_than_a_while(tries, cost):
    throttle, now = Throttle(cost), 0.0
    wrong: set[int] = set()
    for source, passed, right in tries:
        now += passed
        wait = throttle.wait(str(source), now)
        assert 0.0 <= wait <= LONGEST_S
        assert wait == 0.0 or source in wrong
        if right:
            throttle.right(str(source))
            wrong.discard(source)
            assert throttle.wait(str(source), now) == 0.0
        else:
            throttle.wrong(str(source), now)
            wrong.add(source)
            assert throttle.wait(str(source), now) == pytest.approx(min(cost, LONGEST_S)) or wait > 0


def test_addresses_that_are_remembered_are_bounded():
    throttle = Throttle(1.0)
    for n in range(3 * SOURCES):
        throttle.wrong(str(n), 0.0)
    assert throttle.wait('0', 0.0) == 0.0 and throttle.wait(str(3 * SOURCES - 1), 0.0) == 1.0
    assert len(throttle._free) == SOURCES


# ---- locks and disks


@pytest.mark.parametrize('name', ['audit.jsonl.lock', 'queue.json.lock'])
def test_a_lock_that_is_held_stops_neither_display_nor_stop(panel, name):
    """A suspended `waam audit`, or whoever else has it: status.json stays young, STOP and Pause act and say so."""
    from waam_node.locks import locked as held

    shop = panel.cell.shop
    folder = shop.shop.folder('cell')
    end = time.monotonic() + 20
    while shop.shop.status('cell') is None:
        assert time.monotonic() < end
        time.sleep(0.02)
    with held(folder / name):
        panel.cell.mailbox.put(('link', {'rate': 1}))
        for _ in range(3):
            before = shop.shop.status('cell').utc
            end = time.monotonic() + 20
            while shop.shop.status('cell').utc == before:
                assert time.monotonic() < end, 'status.json is not written any more'
                time.sleep(0.02)
        assert panel.cell.state.sections['link'] == {'rate': 1}
        for path, asked in (('stop', ('stop',)), ('pause', ('pause', False))):
            client = Client(panel)
            client.head(
                'POST', f'/api/{path}', Origin=panel.url, X_Waam_Csrf=panel.csrf,
                Content_Type='application/json', Content_Length='2',
            )  # fmt: skip
            client.socket.sendall(b'{}')
            status, said = client.answer()
            client.close()
            assert status == 200 and asked in panel.operations.asked
            assert (b'not in the audit log' in said) == name.startswith('audit'), said
    end = time.monotonic() + 30
    while {'stop', 'pause'} - {e.what for e in shop.audit.last(9)}:
        assert time.monotonic() < end, 'the entries follow once the lock is free'
        time.sleep(0.05)
    assert shop.audit.verify().good


def test_a_log_that_cannot_be_written_is_said_in_the_answer_and_in_the_diagnostics(panel, monkeypatch):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(panel.cell.shop.audit, 'write', full)
    for path in ('stop', 'pause', 'disarm'):
        client = Client(panel)
        client.head(
            'POST', f'/api/{path}', Origin=panel.url, X_Waam_Csrf=panel.csrf,
            Content_Type='application/json', Content_Length='2',
        )  # fmt: skip
        client.socket.sendall(b'{}')
        status, said = client.answer()
        client.close()
        assert status == 200 and b'No space left' in said, path
        assert 'No space left' in panel.cell.problem and path in panel.cell.problem
    assert [a[0] for a in panel.operations.asked] == ['stop', 'pause', 'command']


def test_nothing_but_bodies_reads_a_body():
    """So that no route forgets its limit."""
    folder = Path(bodies.__file__).parent
    for file in folder.glob('*.py'):
        text = file.read_text()
        for call in ('request.post(', 'request.read(', 'request.text(', 'request.json(', 'request.multipart('):
            assert call not in text, (file.name, call)
        assert ('request.content' in text.replace('request.content_', '')) <= (
            file.name in ('bodies.py', 'web.py')
        ), file.name
