"""Requests to the recorder whose answers come late, twice or never: nothing goes on growing that nobody wants."""

import os
import subprocess
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from recorder_graph import START, STOP_SOON

from waam_msgs.msg import Telemetry
from waam_msgs.srv import Record
from waam_node.qos import EVENTS, TELEMETRY
from waam_record.bag_reader import check, info

BLOCKED_DISK = """
import os, time
sync = os.fsync
def blocked(descriptor):
    while os.path.exists({gate!r}):
        time.sleep(0.02)
    sync(descriptor)
os.fsync = blocked
import waam_record.node_thread
waam_record.node_thread.START_S = {start_s}
"""
CLIENT_DIES = 'import waam_record.node_thread\nwaam_record.node_thread.CLIENT_SILENT_S = 1.5\n'


def send(g, code, **fields):
    return g.client.call_async(Record.Request(code=code, **fields))


def size(folder: Path) -> int:
    return sum(f.stat().st_size for f in folder.rglob('*') if f.is_file())


def grows(g, telemetry, folder: Path, seconds: float = 1.8) -> bool:
    """Whether anything in the folder changes while messages go on; a chunk is written every 0.8 s."""
    before, end = size(folder), time.monotonic() + seconds
    while time.monotonic() < end:
        telemetry.publish(Telemetry(arc_current=time.monotonic()))
        g.executor.spin_once(timeout_sec=0.01)
    return size(folder) != before


@pytest.fixture
def blocked(graph, tmp_path):
    """A recorder whose disk answers nothing while the file `gate` is there."""

    def make(start_s: float = 20.0, more: str = ''):
        gate = tmp_path / 'gate'
        program = BLOCKED_DISK.format(gate=str(gate), start_s=start_s) + more + START
        g = graph(program=program)
        assert not g.call(0).success
        gate.touch()
        return g, gate

    return make


def test_stop_ends_a_start_that_is_still_at_work(blocked, tmp_path):
    g, gate = blocked()
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    folder = tmp_path / 'record'
    start = send(g, Record.Request.START, directory=str(folder))
    g.spin_until(folder.exists, 30)
    stop = send(g, Record.Request.STOP, directory=str(folder))
    gate.unlink()
    g.spin_until(lambda: start.done() and stop.done(), 30)
    assert not start.result().success and 'before it had begun' in start.result().message
    assert stop.result().success, stop.result().message
    assert not grows(g, telemetry, folder)
    again = g.call(Record.Request.STOP, directory=str(folder))
    assert again.success, again.message
    assert g.call(Record.Request.START, directory=str(tmp_path / 'second')).success
    assert g.call(Record.Request.STOP, directory=str(tmp_path / 'second')).success


def test_start_that_a_disk_keeps_too_long_fails_and_leaves_nothing_at_work(blocked, tmp_path):
    g, gate = blocked(1.0)
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    folder = tmp_path / 'record'
    answer = g.call(Record.Request.START, directory=str(folder))
    assert not answer.success and 'given up' in answer.message
    gate.unlink()
    assert g.call(Record.Request.STOP, directory=str(folder)).success
    assert check(folder).sound and not grows(g, telemetry, folder)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'second')).success


def test_stop_while_the_disk_is_blocked_answers_and_acts_when_it_is_free(blocked, tmp_path):
    g, gate = blocked(20.0, STOP_SOON)
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    folder = tmp_path / 'record'
    start = send(g, Record.Request.START, directory=str(folder))
    g.spin_until(folder.exists, 30)
    for _ in range(2):
        answer = g.call(Record.Request.STOP, directory=str(folder))
        assert not answer.success and 'disk' in answer.message
    gate.unlink()
    g.spin_until(start.done, 30)
    assert not start.result().success
    end = (
        time.monotonic() + 60
    )  # it answers within half a second, a busy computer closes files more slowly
    while not g.call(Record.Request.STOP, directory=str(folder)).success:
        assert time.monotonic() < end
    assert check(folder).sound and not grows(g, telemetry, folder)


def test_requests_are_known_by_their_folder(graph, tmp_path):
    g = graph()
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    folder, other = tmp_path / 'record', tmp_path / 'other'
    for _ in range(2):  # asked again, it is answered again
        answer = g.call(Record.Request.START, directory=str(folder))
        assert answer.success and 'recording' in answer.message
    answer = g.call(Record.Request.STOP, directory=str(other))
    assert answer.success and f'{other} is not being recorded' in answer.message
    assert grows(g, telemetry, folder), 'a STOP for another job has ended this recording'
    first = g.call(Record.Request.STOP, directory=str(folder))
    assert first.success and 'verified' in first.message
    again = g.call(Record.Request.STOP, directory=str(folder))
    assert (again.success, again.messages) == (True, first.messages)
    assert g.call(Record.Request.STOP).success


def test_the_client_that_was_started_again_need_not_wait_for_the_end_of_the_one_before(
    graph, tmp_path
):
    g = graph()

    def start(folder: str, client: str) -> Record.Response:
        told = [f'client={client}']
        return g.call(Record.Request.START, directory=str(tmp_path / folder), custom_data=told)

    assert start('one', 'job_sequencer@cell:1:aa').success
    assert 'stop that first' in start('two', 'demo@cell:9:cc').message
    assert 'stop that first' in start('two', 'job_sequencer@cell:1:aa').message
    assert start('two', 'job_sequencer@cell:2:bb').success
    g.spin_until(lambda: 'ended' in info(tmp_path / 'one').custom_data, 10)
    assert 'was started again' in info(tmp_path / 'one').custom_data['ended']
    assert check(tmp_path / 'one').sound
    assert g.call(Record.Request.STOP, directory=str(tmp_path / 'two')).success


def test_a_recording_ends_with_its_client(graph, tmp_path):
    g = graph(program=CLIENT_DIES + START)
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    signs = g.node.create_publisher(DiagnosticArray, '/diagnostics', EVENTS)
    told: list[str] = []
    g.node.create_subscription(
        DiagnosticArray,
        '/diagnostics',
        lambda m: told.extend(s.message for s in m.status if s.name.startswith('recorder')),
        EVENTS,
    )

    def live(process: str, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            status = DiagnosticStatus(name='job_sequencer: state')
            status.values = [KeyValue(key='process', value=process)]
            signs.publish(DiagnosticArray(status=[status]))
            telemetry.publish(Telemetry(arc_current=time.monotonic()))
            g.executor.spin_once(timeout_sec=0.05)

    folder = tmp_path / 'record'
    ours = ['client=job_sequencer@cell:1:aa']
    assert g.call(Record.Request.START, directory=str(folder), custom_data=ours).success
    live('job_sequencer@cell:1:aa', 3.0)
    assert not any('ended' in text for text in told)
    live('job_sequencer@cell:2:bb', 2.5)  # the one after it by the same name is another process
    g.spin_until(lambda: any('gave no sign of life' in text for text in told), 30)
    assert check(folder).sound and not grows(g, telemetry, folder)
    assert 'gave no sign of life' in info(folder).custom_data['ended']
    assert g.call(Record.Request.STOP, directory=str(folder)).success
    assert g.call(Record.Request.START, directory=str(tmp_path / 'second')).success


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 4 MB."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=4m', 'tmpfs', str(disk)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode:
        pytest.skip('mounting a file system of 4 MB needs root')
    yield disk
    subprocess.run(['umount', '-l', str(disk)], check=True)


def test_a_full_disk_ends_the_recording_and_the_next_one_can_start(graph, small_disk, tmp_path):
    g = graph('min_free_mb:=0')
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    folder = small_disk / 'record'
    assert g.call(Record.Request.START, directory=str(folder)).success
    (small_disk / 'rest').write_bytes(bytes(os.statvfs(small_disk).f_bavail * 4096 - 65536))
    end = time.monotonic() + 60
    while os.statvfs(small_disk).f_bavail and time.monotonic() < end:
        for _ in range(50):  # values that cannot be compressed
            telemetry.publish(Telemetry(arc_current=time.monotonic(), arc_voltage=os.getpid() / 3))
        g.executor.spin_once(timeout_sec=0.01)
    time.sleep(1.0)
    answer = g.call(Record.Request.STOP, directory=str(folder))
    assert not answer.success and 'No space left' in answer.message
    refused = g.call(Record.Request.START, directory=str(small_disk / 'second'))
    assert not refused.success and 'No space left' in refused.message
    assert not grows(g, telemetry, small_disk)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'third')).success
    assert g.call(Record.Request.STOP, directory=str(tmp_path / 'third')).success
