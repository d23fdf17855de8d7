"""STOP and HOLD past everything: the socket itself, the port's side, and the real node."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import threading
import time

import pytest
from bridge_cell import line_of
from bridge_fake_controller import FakeController
from bridge_harness import BRIDGE, Bridge, until
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from waam_bridge import frames, program
from waam_bridge.node_stop import StopLane
from waam_bridge.transport import SerialTransport
from waam_msgs.srv import Command
from waam_node.stop_socket import HOLD, PIPE, STOP, Listener, post, read, send


class Owner:
    def on_open(self) -> None: ...
    def on_lines(self, lines, read_at) -> None: ...
    def on_idle(self) -> None: ...
    def on_close(self, reason) -> None: ...
    def on_crash(self, error) -> None: ...


# ---- the socket


@pytest.fixture
def lane(tmp_path):
    """acts, after: what was done; `holds` keeps the second thread busy."""
    acts: list[bytes] = []
    after: list[bytes] = []
    holds = threading.Event()
    holds.set()

    def follow(order: bytes) -> None:
        holds.wait(20)
        after.append(order)

    made = StopLane(str(tmp_path / 'stop'), lambda data: acts.append(data) or '', follow)
    made.path, made.acts, made.after, made.holds = str(tmp_path / 'stop'), acts, after, holds
    yield made
    holds.set()
    made.close()


def test_an_order_is_bytes_on_the_wire_and_an_answer(lane):
    assert send(lane.path, STOP) == '' and send(lane.path, HOLD) == ''
    assert lane.acts == [frames.STOP_NOW, frames.HOLD_NOW]
    until(lambda: lane.after == [STOP, HOLD])
    assert os.stat(lane.path).st_mode & 0o777 == 0o600


def test_a_shell_stops_without_starting_a_program(lane):
    pipe = lane.path + PIPE
    assert os.stat(pipe).st_mode & 0o777 == 0o600
    for text in ('S', 'P', 'S' * 200):
        subprocess.run(['bash', '-c', f'printf {text} 1<>"{pipe}"'], check=True, timeout=20)
    subprocess.run(['bash', '-c', f'echo x >"{pipe}"'], check=True, timeout=20)
    until(lambda: len(lane.acts) >= 3)
    assert set(lane.acts) == {frames.STOP_NOW, frames.HOLD_NOW}
    assert send(lane.path, STOP) == ''


def test_what_follows_a_stop_never_holds_up_the_next_one(lane):
    lane.holds.clear()
    for _ in range(50):
        assert send(lane.path, STOP) == ''
    assert len(lane.acts) == 50
    lane.holds.set()
    until(lambda: lane.after)
    assert len(lane.after) <= 2, 'what is repeated is done once'


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.binary(max_size=2000))
def test_other_bytes_are_no_order(lane, data):
    before = len(lane.acts)
    said = send(lane.path, data)
    if data in (STOP, HOLD):
        assert said == ''
    else:
        assert 'no order' in said and len(lane.acts) == before
    assert send(lane.path, STOP) == ''


def test_nobody_waits_for_one_who_never_reads_his_answer(lane):
    held = []
    for _ in range(300):
        with contextlib.suppress(BlockingIOError):
            held.append(post(lane.path, STOP))
    assert send(lane.path, STOP) == ''
    assert read(held[0]) == ''
    for s in held:
        s.close()


def test_a_thousand_answers_that_nobody_reads_take_nobody_elses_room(lane):
    held = []
    for n in range(1000):
        held.append(post(lane.path, STOP))
        until(lambda n=n: len(lane.acts) > n)
        if n % 100 == 99:
            assert send(lane.path, STOP) == ''
            lane.acts.pop()
    for s in held:
        s.close()


def test_an_order_that_finds_the_queue_full_gets_no_answer(tmp_path):
    silent = Listener(str(tmp_path / 'stop'))  # takes nothing
    held = [post(str(tmp_path / 'stop'), STOP) for _ in range(50)]
    assert read(held[0]) is None and read(held[-1]) is None
    assert 'takes nothing' in send(str(tmp_path / 'stop'), STOP, 0.1)
    assert {order for order, _ in silent.receive()} == {STOP}
    silent.close()
    for s in held:
        s.close()


def test_a_folder_with_a_long_name_and_a_socket_that_a_killed_bridge_left(tmp_path):
    folder = tmp_path / ('x' * 200)
    folder.mkdir()
    path = str(folder / 'stop')
    assert send(path, STOP) == 'no bridge is up'
    first = StopLane(path, lambda _: '', lambda _: None)
    second = StopLane(path, lambda _: 'the port is not open', lambda _: None)
    assert send(path, STOP) == 'the port is not open'
    first.close()
    assert send(path, STOP) == 'the port is not open', 'it removes only its own'
    second.close()
    assert send(path, STOP) == 'no bridge is up'
    assert os.listdir(folder) == []


# ---- the port


def test_real_time_bytes_go_before_what_waits():
    """The port takes nothing for a while: what comes out first is STOP."""
    master, slave = os.openpty()
    import tty

    tty.setraw(slave)
    port = SerialTransport(os.ttyname(slave), 115200, Owner())
    port.start()
    until(lambda: port._fd >= 0)
    assert port.write_now(b'') == ''
    sent = b'#' * 1000
    for _ in range(40):
        port.write(sent)
    assert port._backlog, 'the pseudo-terminal is full'
    until(lambda: not select.select([], [port._fd], [], 0.2)[1])  # and stays so: nobody reads
    assert port.write_now(frames.STOP_NOW) == ''
    assert bytes(port._backlog[:4]) == frames.STOP_NOW
    got = b''
    end = time.monotonic() + 20
    while frames.STOP_NOW not in got:
        got += os.read(master, 65536)
        assert time.monotonic() < end
    assert got.rstrip(b'#').endswith(frames.STOP_NOW) and got.count(b'#') < 40_000
    port.close()
    assert 'is not open' in port.write_now(frames.STOP_NOW)
    os.close(master)
    os.close(slave)


# ---- the node


@pytest.fixture(scope='module')
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp('cell')
    fake = FakeController(folder / 'tty')
    bridge = Bridge(fake.path, stop_socket=folder / 'stop')
    bridge.fake, bridge.socket = fake, str(folder / 'stop')
    try:
        yield bridge.ready()
    finally:
        assert bridge.close() == 0
        fake.close()
        assert not (folder / 'stop').exists()


def start(cell, job: str, count: int = 400):
    until(lambda: cell.telemetry.state == frames.IDLE and taken(cell, job, count), what=job)
    until(lambda: cell.telemetry.state == frames.RUN)


def taken(cell, job: str, count: int) -> bool:
    """Whether the bridge takes segments; while a STOP is at work it does not."""
    p = cell.telemetry.position
    answer = cell.enqueue(line_of(count, start=(p.x, p.y, p.z)), job)
    refused = (program.WRONG_STATE, program.BAD_SEGMENT)  # it has begun to move since
    assert answer.error_code in (0, *refused), answer.message
    return answer.error_code == 0


def test_stop_ends_the_motion_and_drops_the_queue(cell):
    start(cell, 'lane')
    assert send(cell.socket, STOP) == ''
    until(lambda: cell.telemetry.state == frames.IDLE and 'dropped' in cell.state.message)
    until(lambda: taken(cell, 'after', 3), what='the next job')


def test_hold_holds_and_resume_goes_on(cell):
    start(cell, 'held', 60)
    assert send(cell.socket, HOLD) == ''
    until(lambda: cell.telemetry.state == frames.HOLD)
    assert cell.command(Command.Request.RESUME).error_code == 0
    until(lambda: cell.telemetry.state == frames.IDLE)


def test_stop_in_every_state_and_as_often_as_one_likes(cell):
    for _ in range(20):
        assert send(cell.socket, STOP) == ''
    # what follows the last one may still drop segments that were taken after its byte: they are sent again
    until(lambda: cell.telemetry.state == frames.RUN or (taken(cell, 'again', 50) and False))
    assert cell.command(Command.Request.STOP).error_code == 0
    until(lambda: cell.telemetry.state == frames.IDLE)


def test_a_socket_that_cannot_be_made_is_refused_by_name(tmp_path):
    words = [*BRIDGE, '--ros-args', '-p', f'stop_socket:={tmp_path}/none/stop']
    end = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert end.returncode == 2 and "'stop_socket'" in end.stderr and 'Traceback' not in end.stderr
