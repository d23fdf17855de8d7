"""The second way for STOP: a real process, a bridge's socket behind it, and everything that must not get through. No
ROS."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import os
import signal
import socket
import ssl
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from panel_client import FakeBridge

from waam_node.stop_socket import STOP, Listener, post
from waam_panel import stop_lane
from waam_panel.gate import IN_ALL
from waam_panel.security import Denied, Guard
from waam_panel.stop_lane import HEAD, Headers, Rules, parse
from waam_shop.roles import Role
from waam_shop.token_file import TokenFile

PAGE = 8600
ORIGIN = f'http://127.0.0.1:{PAGE}'


@dataclass
class Lane:
    """The process, and what stands behind it."""

    port: int
    process: subprocess.Popen
    bridge: FakeBridge
    folder: Path
    tokens: TokenFile | None = None
    tls: str = ''
    cookies: dict[str, str] = field(default_factory=dict)

    def ask(self, method: str = 'POST', path: str = '/api/stop', **headers: str):
        """(status, headers, body) with exactly these headers ('_' stands for '-', '' = left out)."""
        if self.tls:
            trusted = ssl.create_default_context(cafile=self.tls)
            made: http.client.HTTPConnection = http.client.HTTPSConnection(
                '127.0.0.1', self.port, timeout=20, context=trusted
            )
        else:
            made = http.client.HTTPConnection('127.0.0.1', self.port, timeout=20)
        made.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in {'Host': f'127.0.0.1:{self.port}', 'Origin': ORIGIN, **headers}.items():
            if value:
                made.putheader(name.replace('_', '-'), value)
        made.endheaders()
        answer = made.getresponse()
        found = answer.status, dict(answer.getheaders()), answer.read()
        made.close()
        return found


@pytest.fixture
def make_lane(tmp_path):
    made: list[Lane] = []

    def make(*options: str, tokens: TokenFile | None = None, tls: str = '') -> Lane:
        bridge = FakeBridge(tmp_path / 'stop')
        words = [*options, *(['--token-file', str(tokens.path)] if tokens else [])]
        process = subprocess.Popen(
            [sys.executable, '-m', 'waam_panel.stop_lane', '--socket', str(tmp_path / 'stop'), '--port', '0',
             '--page-port', str(PAGE), *words], stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stdout
        port = int(process.stdout.readline().rsplit(' ', 1)[1])
        made.append(Lane(port, process, bridge, tmp_path, tokens, tls))
        return made[-1]

    yield make
    for lane in made:
        lane.process.send_signal(signal.SIGCONT)
        lane.process.terminate()
        assert lane.process.wait(20) == 0
        lane.process.stdout.close()
        lane.bridge.close()


@pytest.fixture
def lane(make_lane) -> Lane:
    return make_lane()


def test_the_page_stops_and_may_read_the_answer(lane):
    status, headers, body = lane.ask(Sec_Fetch_Site='same-site')
    assert (status, body) == (200, b'{"ok": true, "message": "stopped"}')
    assert headers['Access-Control-Allow-Origin'] == ORIGIN
    assert headers['Access-Control-Allow-Credentials'] == 'true'
    assert lane.bridge.got == [STOP]


FORGED = {
    'another origin': {'Origin': 'http://evil.example'},
    'another port of this machine': {'Origin': 'http://127.0.0.1:1'},
    'the port of this process': {'Origin': 'http://127.0.0.1:{port}'},
    'no origin': {'Origin': ''},
    'a sandboxed frame': {'Origin': 'null'},
    'an origin with more behind it': {'Origin': ORIGIN + '@evil.example'},
    'another scheme': {'Origin': f'file://127.0.0.1:{PAGE}'},
    'another site, as the browser says': {'Sec_Fetch_Site': 'cross-site'},
    'a name that was bound to this machine': {'Host': 'evil.example:{port}'},
    'the name of the page': {'Host': f'127.0.0.1:{PAGE}'},
    'no name': {'Host': ''},
}  # fmt: skip


def test_nobody_else_stops_and_nobody_else_reads(lane):
    for name, forged in FORGED.items():
        told = {k: v.replace('{port}', str(lane.port)) for k, v in forged.items()}
        status, headers, _ = lane.ask(**told)
        assert status in (400, 403, 421) and 'Access-Control-Allow-Origin' not in headers, name
        assert lane.bridge.got == [], name


def test_nothing_else_is_here(lane):
    assert lane.ask('GET')[0] == 405 and lane.ask('OPTIONS')[0] == 405
    for path in ('/', '/api/me', '/api/stop/', '/api/stop?x', '//api/stop', 'http://x/api/stop'):
        assert lane.ask(path=path)[0] == 404, path
    assert lane.bridge.got == []


def test_what_the_bridge_says_comes_through(lane):
    lane.bridge.says = 'the port is not open'
    status, _, body = lane.ask()
    assert status == 503 and b'STOP: the port is not open' in body
    lane.bridge.says = None
    status, _, body = lane.ask()
    assert status == 503 and b'did not answer' in body
    lane.bridge.close()
    (lane.folder / 'stop').unlink(missing_ok=True)
    status, _, body = lane.ask()
    assert status == 503 and b'no bridge is up' in body


def test_a_session_is_needed_where_the_page_needs_one_and_any_role_will_do(make_lane, tmp_path):
    tokens = TokenFile(tmp_path / 'tokens.json')
    token = tokens.create('tablet', Role.VIEW)
    cookie, _ = Guard.create(tokens, '127.0.0.1', PAGE).login(token)
    lane = make_lane(tokens=tokens)
    for wrong in ('', 'x', cookie[:-1] + ('0' if cookie[-1] != '0' else '1')):
        assert lane.ask(Cookie=f'waam_session={wrong}')[0] == 401
    assert lane.bridge.got == []
    assert lane.ask(Cookie=f'other=1; waam_session={cookie}')[0] == 200
    tokens.revoke('tablet')
    end = time.monotonic() + 20
    while lane.ask(Cookie=f'waam_session={cookie}')[0] != 401:
        assert time.monotonic() < end, 'the token is revoked'
        time.sleep(0.1)


def test_a_file_of_tokens_that_hangs_holds_up_no_stop(make_lane, tmp_path):
    """A disk that does not answer: here a pipe that nobody writes into."""
    tokens = TokenFile(tmp_path / 'tokens.json')
    cookie, _ = Guard.create(tokens, '127.0.0.1', PAGE).login(tokens.create('x', Role.VIEW))
    lane = make_lane(tokens=tokens)
    tokens.path.unlink()
    os.mkfifo(tokens.path, 0o600)
    time.sleep(1.5)  # it has begun to read
    for _ in range(3):
        assert lane.ask(Cookie=f'waam_session={cookie}')[0] == 200


def test_with_tls_it_speaks_tls(make_lane, tmp_path, certificate):
    cert, key = certificate
    tokens = TokenFile(tmp_path / 'tokens.json')
    cookie, _ = Guard.create(tokens, '127.0.0.1', PAGE).login(tokens.create('x', Role.VIEW))
    lane = make_lane('--tls-cert', cert, '--tls-key', key, tokens=tokens, tls=cert)
    origin = f'https://127.0.0.1:{PAGE}'
    held = [socket.create_connection(('127.0.0.1', lane.port)) for _ in range(300)]
    assert lane.ask(Cookie=f'waam_session={cookie}', Origin=origin)[0] == 200
    assert len(os.listdir(f'/proc/{lane.process.pid}/fd')) < IN_ALL + 32
    for s in held:
        s.close()


def test_half_open_connections_and_large_bodies_hold_up_no_stop(lane):
    held = []
    for n in range(400):
        s = socket.create_connection(('127.0.0.1', lane.port), timeout=20)
        with contextlib.suppress(OSError):
            s.sendall((b'', b'POST /api/stop HTTP/1.1\r\nHost', b'x' * (HEAD + 1))[n % 3])
        held.append(s)
        if n % 100 == 99:
            assert lane.ask()[0] == 200
            assert len(os.listdir(f'/proc/{lane.process.pid}/fd')) < IN_ALL + 32
    for s in held:
        s.close()
    assert lane.bridge.got == [STOP] * 4


def test_it_leaves_with_status_2_and_a_reason_when_it_cannot_listen(lane):
    again = subprocess.run(
        [sys.executable, '-m', 'waam_panel.stop_lane', '--socket', 'x', '--port', str(lane.port),
         '--page-port', '1'], capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert (
        again.returncode == 2
        and f'port {lane.port}: Address already in use' in again.stderr
        and 'Traceback' not in again.stderr
    )


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.binary(max_size=300)
    | st.builds(
        lambda lines: b'POST /api/stop HTTP/1.1\r\n' + b'\r\n'.join(lines) + b'\r\n\r\n',
        st.lists(
            st.binary(max_size=40)
            | st.sampled_from(
                [b'Host: 127.0.0.1', f'Origin: {ORIGIN}'.encode(), b'Origin: x', b'Cookie: a=;;"', b'Host: ']
            ),
            max_size=8,
        ),
    )
)  # fmt: skip
def test_any_bytes_are_refused_and_stop_nothing(fuzzed, data):
    """No random request has our Host with the right port."""
    with socket.create_connection(('127.0.0.1', fuzzed.port), timeout=20) as s:
        s.sendall(data)
        s.shutdown(socket.SHUT_WR)
        with contextlib.suppress(ConnectionError):
            answer = s.recv(4096)
            assert answer == b'' or answer.startswith(b'HTTP/1.1 4')
    assert fuzzed.bridge.got == []


@pytest.fixture
def fuzzed(lane) -> Lane:
    yield lane
    assert lane.ask()[0] == 200 and lane.bridge.got == [STOP]


HEADER = st.text(st.characters(min_codepoint=32, max_codepoint=255), max_size=30)


@settings(max_examples=300)
@given(st.dictionaries(st.sampled_from(
    ['host', 'origin', 'cookie', 'sec-fetch-site', 'x']), HEADER | st.just(ORIGIN) | st.just('127.0.0.1:8601')),
    st.sampled_from(['POST', 'GET', '']), st.sampled_from(['/api/stop', '/']))  # fmt: skip
def test_the_rules_let_through_only_what_is_right(headers, method, path):
    page = Guard.create(None, '127.0.0.1', PAGE)
    rules = Rules(page, Guard.create(None, '127.0.0.1', PAGE + 1))
    try:
        origin = rules.check(method, path, Headers(headers))
    except (Denied, ValueError):
        return
    assert (method, path) == ('POST', '/api/stop')
    assert origin == headers['origin'] and origin.split('://')[1].lower() in page.hosts
    assert headers['host'].lower() in rules.here.hosts


@given(st.binary(max_size=200))
def test_any_head_is_read_or_refused(data):
    with contextlib.suppress(Denied):
        method, path, headers = parse(data)
        assert all(k == k.lower() and k for k in headers)


def test_an_order_that_goes_by_the_pipe_is_told_as_not_answered(tmp_path):
    silent = Listener(str(tmp_path / 'stop'))  # takes nothing
    held = [post(str(tmp_path / 'stop'), STOP) for _ in range(50)]
    assert asyncio.run(stop_lane.stop(str(tmp_path / 'stop'))) == 'the bridge gives no answer'
    silent.close()
    for s in held:
        s.close()
