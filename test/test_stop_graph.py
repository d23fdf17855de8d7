"""STOP through whole graphs of real processes: past a panel that is stopped, past locks that are held, on a robot."""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
from pathlib import Path

import pytest

from waam_bringup import paths
from waam_bringup.graph import executable, load
from waam_msgs.action import RunJob
from waam_msgs.msg import JobStatus, Telemetry
from waam_node.locks import locked
from waam_node.stop_socket import HOLD, STOP, send

ROOT = Path(__file__).parents[1]
LONG_S = 60.0


def laying(bench, background):
    """A job whose arc burns."""
    bench.load()
    job = background(bench, layers=1)
    bench.wait(
        lambda: job.raise_error() or (bench.client.machine and bench.client.machine.arc_on),
        LONG_S, 'arc',
    )  # fmt: skip
    return job


def ended(bench, job) -> None:
    """Arc off, queue dropped, job aborted, and the cell takes the next one."""
    result = job.join()
    assert result.error_code == RunJob.Result.ABORTED, result.message
    bench.wait(
        lambda: bench.client.machine.state == Telemetry.STATE_IDLE and not bench.client.machine.arc_on,
        LONG_S, 'rest',
    )  # fmt: skip
    assert bench.events()[-1][1] != 'arc on'
    bench.wait(lambda: bench.client.job.state == JobStatus.ABORTED, LONG_S, 'the end of the job')


def lane_port(bench) -> tuple[int, int]:
    """Of the second way for STOP and of the page, as the graph was started."""
    log = (bench.run / 'logs' / 'stop_lane.log').read_text()
    port = int(log.split('port ')[1].split()[0])
    return port, int(bench.state().panel_url.rsplit(':', 1)[1].strip('/'))


def post(port: int, page: int) -> tuple[int, dict]:
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=20)
    connection.request('POST', '/api/stop', headers={'Origin': f'http://127.0.0.1:{page}'})
    answer = connection.getresponse()
    found = answer.status, json.loads(answer.read())
    connection.close()
    return found


def test_the_second_way_stops_the_job_while_the_panel_stands_still(bench, background):
    lane, page = lane_port(bench)
    job = laying(bench, background)
    pid = bench.state().nodes['panel'].pid
    os.kill(pid, signal.SIGSTOP)
    try:
        assert post(lane, page) == (200, {'ok': True, 'message': 'stopped'})
        ended(bench, job)
    finally:
        os.kill(pid, signal.SIGCONT)
    bench.wait(lambda: post(page, page)[0] == 200, LONG_S, 'the panel')


def waam(bench, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [str(ROOT / 'waam'), *words, '--run', str(bench.run)], capture_output=True, text=True, timeout=120,
        env=os.environ | {'WAAM_SHOP': str(bench.run / 'shop')},
    )  # fmt: skip


def test_the_command_line_pauses_and_aborts_while_the_audit_log_is_held(
    bench, background, monkeypatch
):
    monkeypatch.setenv('WAAM_SHOP', str(bench.run / 'shop'))
    job = laying(bench, background)
    lock = paths.shop_dir() / 'cells' / 'cell' / 'audit.jsonl.lock'
    with locked(lock):
        ran = waam(bench, 'job', 'pause')
        assert ran.returncode == 0 and 'not in the audit log' in ran.stderr, ran.stderr
        bench.wait(lambda: bench.client.machine.state == Telemetry.STATE_HOLD, LONG_S, 'hold')
        ran = waam(bench, 'job', 'abort')
        assert ran.returncode == 0 or 'no job is running' in ran.stderr, ran.stderr
        assert 'not in the audit log' in ran.stderr
        ended(bench, job)


def test_one_byte_pauses_a_job_which_can_then_go_on(bench, background):
    job = laying(bench, background)
    assert send(str(bench.run / 'stop'), HOLD) == ''
    bench.wait(lambda: bench.client.job.state == JobStatus.PAUSED, LONG_S, 'pause')
    assert bench.client.resume()
    assert job.join().error_code == 0


@pytest.mark.parametrize('hang', ['job_sequencer', 'recorder'])
def test_a_program_that_hangs_holds_up_no_stop(bench, background, hang):
    job = laying(bench, background)
    pid = bench.state().nodes[hang].pid
    os.kill(pid, signal.SIGSTOP)
    try:
        assert send(str(bench.run / 'stop'), STOP) == ''
        bench.wait(lambda: not bench.client.machine.arc_on, LONG_S, 'the end of the arc')
        bench.wait(lambda: bench.client.machine.state == Telemetry.STATE_IDLE, LONG_S, 'rest')
    finally:
        os.kill(pid, signal.SIGCONT)
    assert job.join().error_code == RunJob.Result.ABORTED


def test_on_a_robot_the_byte_ends_the_arc(make_graph, background):
    with make_graph(machine='robot', rate=2.0) as robot:
        job = laying(robot, background)
        assert send(str(robot.run / 'stop'), STOP) == ''
        result = job.join()
        assert result.error_code == RunJob.Result.ABORTED, result.message
        robot.wait(
            lambda: robot.client.machine.state == Telemetry.STATE_IDLE and not robot.client.machine.arc_on,
            LONG_S, 'rest',
        )  # fmt: skip


def test_every_way_to_start_a_graph_starts_the_second_way():
    """graph.yaml is what `waam up` and the launch file start."""
    lane = load()['stop_lane']
    assert (
        lane['ros'] is False
        and lane['lease'] is False
        and 'machine' not in lane
        and 'only' not in lane
    )
    assert executable(lane['package'], 'stop_lane').is_file()
    assert '${run}/stop' in lane['arguments']
    text = (ROOT / 'waam_ws/src/waam_bringup/launch/cell.launch.py').read_text()
    assert 'stop_port=stop_port(page)' in text
    for bridge in ('bridge', 'robot_bridge'):
        assert load()[bridge]['parameters']['stop_socket'] == '${run}/stop'
    assert load()['panel']['parameters']['stop_socket'] == '${run}/stop'
