"""The real node as a process against the fake controller: real DDS, a real pseudo-terminal."""

import math
import subprocess

import pytest
from bridge_cell import line_of
from bridge_fake_controller import FakeController
from bridge_harness import BRIDGE, Bridge, until
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from waam_bridge import program, requests
from waam_msgs.msg import Override
from waam_msgs.srv import Command, Enqueue


@pytest.fixture(scope='module')
def cell(tmp_path_factory):
    """One bridge and one fake controller for the tests that leave them as they were."""
    folder = tmp_path_factory.mktemp('cell')
    fake = FakeController(folder / 'tty')
    log = folder / 'log.csv'
    bridge = Bridge(fake.path, csv_log=log)
    bridge.log = log
    bridge.fake = fake
    try:
        yield bridge.ready()
    finally:
        assert bridge.close() == 0
        fake.close()


def new_job(cell):
    """A job id and the place where the machine stands."""
    cell.jobs = getattr(cell, 'jobs', 0) + 1
    until(lambda: cell.telemetry.state == 0)
    p = cell.telemetry.position
    return f'job{cell.jobs}', (p.x, p.y, p.z)


def test_the_codes_are_those_of_the_messages():
    for name in ('NOT_CONNECTED', 'NOT_ARMED', 'BAD_SEGMENT', 'GAP', 'WRONG_STATE', 'QUEUE_FULL'):
        assert getattr(program, name) == getattr(Enqueue.Response, name)
    for name in ('OK', 'NOT_CONNECTED', 'WRONG_STATE', 'BAD_ARGUMENT', 'REFUSED', 'TIMEOUT'):
        assert getattr(requests, name) == getattr(Command.Response, name)


def test_telemetry_and_states_are_published(cell):
    until(
        lambda: len(cell.got['telemetry']) > 30 and len(cell.got['tick']) > 2 and cell.got['link']
    )
    frames = cell.got['telemetry']
    assert all(b.sequence == a.sequence + 1 for a, b in zip(frames, frames[1:], strict=False))
    last = frames[-1]
    assert last.header.stamp.sec * 10**6 + last.header.stamp.nanosec // 1000 == last.controller_us
    assert last.header.frame_id == 'work' and last.boot_id == 7
    state = cell.state
    assert (state.identity, state.boot_id) == ('WAAM_CONTROLLER_V1', 7)
    assert (state.limit_max.x, state.limit_max.z) == (0.4, 0.2)
    assert cell.got['link'][-1].clock_synchronised and cell.got['link'][-1].telemetry_lost == 0


def test_segments_are_executed_once_although_sent_twice(cell):
    job, here = new_job(cell)
    segments = line_of(25, start=here)
    before = len(cell.done)
    first = cell.enqueue(segments, job)
    again = cell.enqueue(segments, job)
    assert (first.error_code, first.accepted, first.duplicates) == (0, 25, 0)
    assert (again.error_code, again.accepted, again.duplicates) == (0, 0, 25)
    until(lambda: len(cell.done) >= before + 25)
    assert cell.done[before:] == list(range(25))
    assert cell.got['done'][-1].job_id == job


def test_what_is_wrong_is_named_and_nothing_of_the_batch_moves(cell):
    job, here = new_job(cell)
    segments = line_of(5, start=here)
    moved = len(cell.fake.core.gcode)
    bad = cell.enqueue([*segments[:3], segments[3].at(wire_feed_speed=math.nan)], job)
    assert bad.error_code == Enqueue.Response.BAD_SEGMENT and bad.accepted == 0
    assert 'segment 3' in bad.message and 'wire_feed_speed' in bad.message
    gap = cell.enqueue([segments[0], segments[2]], job)
    assert gap.error_code == Enqueue.Response.GAP and 'segment 2' in gap.message
    arc = cell.enqueue(line_of(2, arc=True, start=here), job)
    assert arc.error_code == Enqueue.Response.NOT_ARMED
    assert len(cell.fake.core.gcode) == moved


def test_commands_bring_the_controllers_answer(cell):
    with cell.fake.lock:
        cell.fake.core.refuse['W'] = 'E108 only in IDLE'
    got = cell.command(Command.Request.JOG_WIRE, value=0.01)
    assert (got.error_code, got.message) == (307, 'controller: E108 only in IDLE')
    with cell.fake.lock:
        cell.fake.core.mute.add('D')
    got = cell.command(Command.Request.DISARM)
    assert got.error_code == Command.Response.TIMEOUT and '$D' in got.message
    with cell.fake.lock:
        cell.fake.core.mute.clear()
    assert cell.command(Command.Request.DISARM).error_code == 0
    assert cell.command(77).error_code == Command.Response.BAD_ARGUMENT


def test_overrides_reach_the_controller(cell):
    cell.override.publish(Override(speed_factor=1.5, wire_factor=math.nan, source='test'))
    until(lambda: cell.telemetry.speed_override == pytest.approx(1.5))
    cell.override.publish(Override(speed_factor=0.01, wire_factor=1.0, source='test'))
    until(lambda: any('speed_factor is 0.01' in a.text for a in cell.got['anomaly']))
    cell.override.publish(Override(speed_factor=1.0, wire_factor=math.nan, source='test'))
    until(lambda: cell.telemetry.speed_override == pytest.approx(1.0))


def test_a_node_that_is_silent_is_named_and_the_lease_withheld(cell):
    assert cell.command(Command.Request.ARM, text='j', names=['bridge']).error_code == 0
    beats = cell.fake.core.beats
    until(lambda: beats[-1][1] > 0 and beats[-1][1] > beats[-1][0] - 200_000, what='lease')
    until(lambda: cell.state.armed_job == 'j' and cell.state.silent_nodes == [])
    assert cell.command(Command.Request.ARM, text='j', names=['bridge', 'ghost']).error_code == 0
    until(lambda: list(cell.state.silent_nodes) == ['ghost'])
    until(lambda: beats[-1][1] == 0, what='lease withheld')
    until(lambda: any(a.class_name == 'node' and 'ghost' in a.text for a in cell.got['anomaly']))
    assert cell.command(Command.Request.DISARM).error_code == 0
    until(lambda: cell.state.silent_nodes == [] and cell.state.armed_job == '')


def test_the_csv_log_has_the_columns_of_the_specification(cell):
    until(lambda: cell.log.read_text().count('\n') > 5)
    head, *rows = cell.log.read_text().splitlines()
    assert head.split('; ') == [
        'Timestamp', 'X_pos', 'Y_pos', 'Z_pos', 'Current_A', 'Voltage_V', 'Temp_C', 'Feed_Rate',
    ]  # fmt: skip
    assert all(len(r.split('; ')) == 8 for r in rows[:-1])


def test_a_port_that_is_gone_is_said_and_found_again(tmp_path):
    fake = FakeController(tmp_path / 'tty')
    bridge = Bridge(fake.path)
    try:
        bridge.ready()
        p = bridge.telemetry.position
        bridge.enqueue(line_of(150, start=(p.x, p.y, p.z)))
        until(lambda: len(bridge.done) > 20)
        fake.unplug()
        until(lambda: not bridge.state.connected)
        assert str(fake.path) in bridge.state.message
        assert bridge.enqueue(line_of(1)).error_code == Enqueue.Response.NOT_CONNECTED
        fake.replug()
        until(lambda: len(bridge.done) == 150)
        assert bridge.done == list(range(150))
        assert sum('G1' in g for g in fake.core.gcode) == 150
        texts = [a.text for a in bridge.got['anomaly']]
        assert 'link lost' in texts[0] and 'link restored' in texts[-1]
    finally:
        bridge.close()
        fake.close()


def run_alone(*params):
    args = [*BRIDGE, '--ros-args', *(x for p in params for x in ('-p', p))]
    return subprocess.run(args, capture_output=True, text=True, timeout=30)


@pytest.mark.parametrize(
    ('param', 'words'), [('baudrate:=9600', 'baudrate'), ('window:=0', 'window')]
)
def test_wrong_parameters_are_refused_by_name(param, words):
    end = run_alone(param)
    assert end.returncode == 2 and words in end.stderr and 'Traceback' not in end.stderr


def test_only_the_standoff_parameters_may_be_changed_and_all_of_a_request_or_none(cell):
    client = cell.node.create_client(SetParametersAtomically, 'bridge/set_parameters_atomically')

    def put(**values):
        messages = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        future = client.call_async(SetParametersAtomically.Request(parameters=messages))
        until(future.done, what='the answer')
        return future.result().result

    def get(name):
        reader = cell.node.create_client(GetParameters, 'bridge/get_parameters')
        future = reader.call_async(GetParameters.Request(names=[name]))
        until(future.done, what='the answer')
        return future.result().values[0].double_value

    until(client.service_is_ready, what='the service')
    assert put(standoff_up=0.005, standoff_down=0.002).successful
    assert get('standoff_up') == 0.005
    refused = put(standoff_up=0.003, standoff_source='laser')
    assert not refused.successful and 'this controller has none' in refused.reason
    assert 'standoff_up out of range' in put(standoff_up=0.5).reason
    assert not put(speed_max=0.1).successful
    assert get('standoff_up') == 0.005 and get('speed_max') == 0.5
