"""Half-open connections push out each other, wrong tokens cost those who send them, and locks that are held stop
neither the display nor STOP. No ROS."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from panel_client import Client, post, stops
from panel_requests import until

from waam_panel.gate import IN_ALL, PER_SOURCE, Gate, source_of
from waam_panel.throttle import LONGEST_S, SOURCES, Throttle

FORM = 'application/x-www-form-urlencoded'


@pytest.fixture
def locked(make_panel):
    return make_panel(tokens=True)


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
    working = Client(panel).post('home')
    until(lambda: any(g.until is None for g in list(panel.cell.gate.inside)), 'at work')
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
            assert (
                throttle.wait(str(source), now) == pytest.approx(min(cost, LONGEST_S)) or wait > 0
            )


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
    until(lambda: shop.shop.status('cell'), 'first look')
    with held(folder / name):
        panel.cell.mailbox.put(('link', {'rate': 1}))
        for _ in range(3):
            before = shop.shop.status('cell').utc
            until(lambda b=before: shop.shop.status('cell').utc > b, 'status.json is not written')
        assert panel.cell.state.sections['link'] == {'rate': 1}
        for path, asked in (('stop', ('stop',)), ('pause', ('pause', False))):
            status, said = post(panel, path)
            assert status == 200 and asked in panel.operations.asked
            assert (b'not in the audit log' in said) == name.startswith('audit'), said
    until(
        lambda: {'stop', 'pause'} <= {e.what for e in shop.audit.last(9)}, 'entries once it is free'
    )
    assert shop.audit.verify().good


def test_a_log_that_cannot_be_written_is_said_in_the_answer_and_in_the_diagnostics(
    panel, monkeypatch
):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(panel.cell.shop.audit, 'write', full)
    for path in ('stop', 'pause', 'disarm'):
        status, said = post(panel, path)
        assert status == 200 and b'No space left' in said, path
        assert 'No space left' in panel.cell.problem and path in panel.cell.problem
    status, said = post(panel, 'home')
    assert status == 503 and b'No space left' in said
    assert [a[0] for a in panel.operations.asked] == ['stop', 'pause', 'command']


class NoSocket:
    """Stands for a connection; ended: it was turned out."""

    def __init__(self) -> None:
        self.ended = False

    def shutdown(self, _how: int) -> None:
        self.ended = True


@given(
    st.lists(
        st.tuples(st.sampled_from('aaabc'), st.sampled_from(['come', 'busy', 'leave'])),
        max_size=400,
    )
)
def test_whoever_comes_is_let_in_unless_all_of_his_are_being_answered(events):
    """Sources are never above their share, all together never above the bound, and only those who wait are turned
    out."""
    gate = Gate(lambda: None)  # type: ignore[arg-type,return-value]
    gate.most = 60
    for now, (source, what) in enumerate(events):
        mine = [g for g in gate.inside if g.source == source]
        if what == 'busy' and mine:
            mine[-1].until = None
        elif what == 'leave' and mine:
            gate.leave(mine[0])
        elif what == 'come':
            busy = [g for g in gate.inside if g.until is None]
            guest = gate._enter(NoSocket(), source, float(now))  # type: ignore[arg-type]
            assert not any(g.socket.ended for g in busy)
            room = len(mine) < PER_SOURCE and len(busy) < gate.most
            assert guest is not None or not room or all(g.until is None for g in mine)
            assert guest is None or guest in gate.inside
        counts = [sum(g.source == s for g in gate.inside) for s in 'abc']
        assert max(counts) <= PER_SOURCE and sum(counts) <= gate.most
