"""The dashboard as a process: records a synthetic job, keeps its heartbeats while maps flood it."""

import json
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from waam_msgs.msg import Heartbeat, JobStatus, LeaseTick
from waam_node.qos import BEAT, EVENTS
from waam_node.testing import fresh_domain
from waam_view.report import write_report

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_cell import Cell  # noqa: E402
from synthetic_job import make_report, write_job  # noqa: E402
from test_drawing import entities  # noqa: E402
from test_playback import EVERYTHING  # noqa: E402

START = (
    'import waam_view.report_writer as w; w.GRACE_S = 1.0; '  # no client writes the page here
    'from waam_view.dashboard_node import main; main()'
)
PATIENCE_S = 300.0  # a machine that does other work, too


class Graph:
    def __init__(self, *parameters: str) -> None:
        domain = fresh_domain()
        arguments = [a for p in parameters for a in ('-p', p)]
        self.process = subprocess.Popen(
            [sys.executable, '-c', START, '--ros-args', *arguments],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stderr=subprocess.PIPE,
            text=True,
        )
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node('cell', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.cell = Cell(self.node)
        self.beats: list[tuple[float, int]] = []
        self.node.create_subscription(
            Heartbeat,
            'heartbeat',
            lambda m: self.beats.append((time.monotonic(), m.controller_us)),
            BEAT,
        )
        self.state = DiagnosticStatus()
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, EVENTS)
        self.ticks = self.node.create_publisher(LeaseTick, 'lease_tick', BEAT)
        names = [n for n in vars(self.cell) if n.endswith('_')]
        publishers = [getattr(self.cell, n) for n in names] + [self.ticks]
        self.until(lambda: all(p.get_subscription_count() for p in publishers), PATIENCE_S)

    def _diagnosed(self, array: DiagnosticArray) -> None:
        self.state = array.status[0]

    def value(self, key: str) -> str:
        """What the diagnostics say."""
        return {v.key: v.value for v in self.state.values}.get(key, '')

    def until(self, condition, timeout: float) -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, 'timeout'
            assert self.process.poll() is None, self.process.stderr.read()
            self.executor.spin_once(timeout_sec=0.02)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Takes what comes in a thread of its own meanwhile."""
        over = threading.Event()

        def listen() -> None:
            while not over.is_set():
                self.executor.spin_once(timeout_sec=0.02)

        thread = threading.Thread(target=listen)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def close(self) -> None:
        self.node.destroy_node()
        self.context.try_shutdown()
        if self.process.poll() is None:
            self.process.terminate()
        self.process.communicate(timeout=60)


@pytest.fixture
def graph():
    made = []

    def make(*parameters: str) -> Graph:
        made.append(Graph(*parameters))
        return made[-1]

    yield make
    for g in made:
        g.close()


def play(cell: Cell, folder: Path, frames: int) -> None:
    cell.status(0.0, JobStatus.SCANNING, str(folder))
    cell.height_map(0.1, 0)
    time.sleep(0.5)
    cell.plan(1.0, 1)
    cell.correction(1.1, 1)
    cell.events(1.2)
    cell.status(1.3, JobStatus.DEPOSITING, str(folder), 1)
    for i in range(frames):
        cell.telemetry(2.0 + i * 0.01)
        if i % 10 == 0:
            cell.slow(2.0 + i * 0.01)
            time.sleep(0.005)
    cell.height_map(60.0, 1)
    write_job(folder / 'as_written_by_the_job', layers=1)
    (folder / 'as_written_by_the_job/layers').rename(folder / 'layers')
    time.sleep(1.0)
    cell.status(61.0, JobStatus.DONE, str(folder), 1)


def all_drawn(g: Graph) -> None:
    """Waits until the file of a job that has ended is closed."""
    g.until(lambda: g.value('file'), PATIENCE_S)
    g.until(lambda: not g.value('file'), PATIENCE_S)


def followed(g: Graph, folder: Path) -> None:
    """A job begins, and the dashboard has heard of it."""
    g.cell.status(0.0, JobStatus.SCANNING, str(folder))
    g.until(lambda: list(folder.glob('*.rrd')), PATIENCE_S)
    time.sleep(0.1)


def test_a_failed_job_gets_its_report_and_ticks_are_answered_meanwhile(graph, tmp_path):
    """Nobody but the dashboard is there: no client, no panel. The job says that it has ended and only then writes its
    report, as the sequencer does."""
    g = graph('grpc_port:=0')
    folder, count = tmp_path / 'job', 0
    folder.mkdir()
    followed(g, folder)
    g.cell.status(1.0, JobStatus.FAILED, str(folder))
    time.sleep(0.5)
    write_job(folder / 'as_written_by_the_job', layers=6, failed=True)
    for path in (folder / 'as_written_by_the_job').iterdir():
        path.rename(folder / path.name)
    (folder / 'report.json').touch()
    while not (folder / 'report.html').is_file():
        count += 1
        g.ticks.publish(LeaseTick(controller_us=count))
        g.until(lambda n=count: g.beats and g.beats[-1][1] == n, PATIENCE_S)
    assert count > 20
    page = (folder / 'report.html').read_text()
    assert page.rstrip().endswith('</html>')
    assert 'arc did not strike' in page and 'No scan was stored' not in page
    g.until(lambda: g.value('report') == str(folder / 'report.html'), PATIENCE_S)


def test_a_report_of_before_the_resume_is_not_taken_for_its_own(graph, tmp_path):
    folder = tmp_path / 'job'
    write_job(folder, layers=1, failed=True)
    write_report(folder)
    g = graph('grpc_port:=0')
    followed(g, folder)
    g.cell.status(1.0, JobStatus.DONE, str(folder))
    time.sleep(1.5)
    assert 'arc did not strike' in (folder / 'report.html').read_text()
    report = make_report('closed_loop', 1, [1e-3, 1e-4], 'resumed anvil', False)
    (folder / 'report.json').write_text(json.dumps(report))
    g.until(lambda: 'resumed anvil' in (folder / 'report.html').read_text(), PATIENCE_S)


def test_a_broken_report_is_a_warning_and_the_next_job_gets_its_page(graph, tmp_path):
    g = graph('grpc_port:=0')
    broken, good = tmp_path / 'broken', tmp_path / 'good'
    write_job(broken, layers=1)
    (broken / 'report.json').write_text('{"closed_loop": ')
    g.cell.status(0.0, JobStatus.FAILED, str(broken))
    g.until(lambda: 'report.json' in g.state.message and g.state.level == b'\x01', PATIENCE_S)
    assert not (broken / 'report.html').exists()
    assert not list(broken.glob('*.rrd'))  # the latched status of an old job opens no file
    write_job(good, layers=1)
    g.cell.status(1.0, JobStatus.DONE, str(good))
    g.until((good / 'report.html').is_file, PATIENCE_S)
    g.until(lambda: g.state.message == 'ok', PATIENCE_S)
    g.process.terminate()
    assert g.process.wait(20) == 0
    assert f'{broken}: no report.html' in g.process.stderr.read()


def test_heartbeats_keep_their_rate_under_a_flood_of_maps(graph, tmp_path):
    """280 000 cells 20 times a second is far more than the drawing thread can show."""
    g = graph('grpc_port:=0')
    folder = tmp_path / 'job'
    folder.mkdir()
    g.cell.status(0.0, JobStatus.SCANNING, str(folder))
    g.cell.plan(0.5, 1)
    with g.listening():  # in a thread: making maps must not make the answers look late
        start = time.monotonic()
        count = 0
        while (now := time.monotonic()) - start < 4.0:
            if now - start >= count * 0.05:
                count += 1
                g.ticks.publish(LeaseTick(controller_us=count))
                g.cell.height_map(1.0 + count, 0, scale=5)
            time.sleep(0.005)
    g.until(lambda: g.beats and g.beats[-1][1] == count, PATIENCE_S)
    # the topic keeps ten ticks: who answers only between two maps loses most, who is short of a processor loses some
    assert len({us for _, us in g.beats}) >= 0.25 * count


def frame(kind: int, flags: int, stream: int, payload: bytes) -> bytes:
    """One HTTP/2 frame."""
    head = struct.pack('>I', len(payload))[1:] + bytes([kind, flags]) + struct.pack('>I', stream)
    return head + payload


def hanging_viewer(port: int) -> socket.socket:
    """Asks for the stream as a rerun viewer does, reads the start of the answer, and nothing more."""
    fields = {
        ':method': 'POST', ':scheme': 'http', ':authority': f'127.0.0.1:{port}', 'te': 'trailers',
        ':path': '/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages',
        'content-type': 'application/grpc',
    }  # fmt: skip
    block = b''.join(
        b'\x00' + b''.join(bytes([len(t)]) + t.encode() for t in item)
        for item in sorted(fields.items())
    )
    s = socket.create_connection(('127.0.0.1', port), timeout=20)
    s.sendall(b'PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n' + frame(4, 0, 0, b''))
    s.sendall(frame(1, 4, 1, block) + frame(0, 1, 1, bytes(5)))
    heard = b''
    while len(heard) < 2000:  # settings are short: this is the stream itself
        more = s.recv(2000)
        assert more, heard
        heard += more
    return s


def test_viewers_that_hang_change_nothing(graph, tmp_path):
    """Three viewers that stop reading, far more data than their buffers hold: every tick is answered, the file of the
    job holds everything."""
    with socket.socket() as s:
        s.bind(('127.0.0.1', 0))
        port = s.getsockname()[1]
    g = graph(f'grpc_port:={port}')
    folder = tmp_path / 'job'
    folder.mkdir()
    g.cell.status(0.0, JobStatus.SCANNING, str(folder))
    g.until(lambda: list(folder.glob('*.rrd')), PATIENCE_S)
    viewers = [hanging_viewer(port) for _ in range(3)]
    for count in range(1, 41):
        g.cell.height_map(1.0 + count, 0, scale=4)
        g.cell.telemetry(1.0 + count)
        g.ticks.publish(LeaseTick(controller_us=count))
        g.until(lambda n=count: g.beats and g.beats[-1][1] == n, PATIENCE_S)
    play(g.cell, folder, 100)
    all_drawn(g)
    g.process.terminate()
    assert g.process.wait(20) == 0
    found = entities(folder / 'job.rrd')
    assert found >= EVERYTHING, EVERYTHING - found
    for viewer in viewers:
        viewer.close()


def test_unknown_parameter_is_refused_by_name():
    command = [sys.executable, '-c', START, '--ros-args', '-p', 'grpc_prt:=1']
    done = subprocess.run(command, capture_output=True, text=True, timeout=30)
    assert done.returncode == 2 and "did you mean 'grpc_port'" in done.stderr
