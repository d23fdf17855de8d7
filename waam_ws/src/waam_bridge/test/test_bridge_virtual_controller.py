"""The real node and the real controller core: motion, arc lease, kill of the bridge."""

import time

import numpy as np
import pytest
from bridge_cell import line_of
from bridge_harness import Bridge, VirtualController, until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from waam_bridge.frame_tree import Placed, Tree, in_root
from waam_msgs.msg import AccelerationBatch, Anomaly, Telemetry
from waam_msgs.srv import Command, Enqueue
from waam_node import qos

ZERO = (0.1, 0.08, 0.02)
LEASE_US = 500_000


@pytest.fixture(scope='module')
def machine(tmp_path_factory):
    """Controller and bridge, homed, with a work zero."""
    folder = tmp_path_factory.mktemp('machine')
    controller = VirtualController(folder, '--rate', '10', '--epoch-us', '1700000000000000')
    bridge = Bridge(controller.path)
    bridge.controller = controller
    try:
        bridge.ready()
        switched_on(bridge)
        assert bridge.command(Command.Request.HOME).error_code == 0
        until(lambda: bridge.state.homed and bridge.state.state == Telemetry.STATE_IDLE)
        assert bridge.command(Command.Request.SET_ZERO, ZERO).error_code == 0
        until(lambda: bridge.telemetry.position.x == pytest.approx(-ZERO[0]))
        yield bridge
    finally:
        bridge.close()
        controller.close()


def switched_on(bridge):
    """Like a board it waits in ALARM for somebody to acknowledge; that is no fault, but nothing moves before."""
    assert (bridge.state.state, bridge.state.fault) == (Telemetry.STATE_ALARM, 306)
    assert 'power-up' in bridge.state.fault_text
    assert bridge.command(Command.Request.HOME).error_code == Command.Response.WRONG_STATE
    assert bridge.command(Command.Request.ARM, text='j').error_code != 0
    assert bridge.command(Command.Request.RESET).error_code == 0
    until(lambda: bridge.state.state == Telemetry.STATE_IDLE)
    assert not bridge.state.homed
    assert all(a.severity == Anomaly.INFO for a in bridge.got['anomaly'])


@pytest.fixture
def cell(machine, request):
    """The machine at rest, with a job of its own and nothing received yet."""
    if machine.process.poll() is not None:
        machine.got['state'].clear()
        machine.start()
        machine.ready()
    assert machine.command(Command.Request.STOP).error_code == 0
    until(lambda: machine.telemetry.state == Telemetry.STATE_IDLE)
    machine.job = request.node.name
    for got in (machine.got['done'], machine.got['anomaly']):
        got.clear()
    machine.struck = len(machine.controller.times('arc on'))
    return machine


def strikes(cell, event='arc on'):
    """Times of an arc event within this test, us."""
    return cell.controller.times(event)[cell.struck :]


def approach(cell, end=(0.0, 0.0, 0.0)):
    p = cell.telemetry.position
    return line_of(1, start=(p.x, p.y, p.z))[0].at(end=end, speed=0.05)


def weld(cell, count, names=('bridge',)):
    """Starts a bead of `count` mm and waits until the arc burns."""
    assert cell.command(Command.Request.ARM, text=cell.job, names=list(names)).error_code == 0
    got = cell.enqueue([approach(cell), *line_of(count, arc=True, first=1)], cell.job)
    assert (got.error_code, got.accepted) == (0, count + 1), got.message
    until(lambda: cell.telemetry.arc_established, what='arc')


def test_the_accelerometer_is_switched_and_published(cell):
    got = []
    node = cell.node
    node.create_subscription(AccelerationBatch, 'acceleration', got.append, qos.PROFILES)
    enable = node.create_client(SetBool, 'accelerometer/enable')
    until(enable.service_is_ready)
    time.sleep(0.5)
    answer = cell.call(enable, SetBool.Request(data=True))
    assert answer.success, answer.message
    until(lambda: len(got) > 12)
    assert cell.call(enable, SetBool.Request(data=False)).success
    assert [b.sequence for b in got] == list(range(got[0].sequence, got[0].sequence + len(got)))
    assert got[-1].sample_rate == pytest.approx(3200, rel=1e-3)
    assert got[-1].header.frame_id == 'machine' and got[-1].header.stamp.sec >= 1_700_000_000
    assert sum(got[-1].z) / len(got[-1].z) == pytest.approx(9.81, abs=0.1)


def test_tf_has_the_torch_where_telemetry_has_it(cell):
    """Somebody who comes late gets description and fixed frames; the moving ones come at 25 Hz at most."""
    got = {'urdf': [], 'static': [], 'moving': [], 'joints': []}
    for key, kind, topic, profile in (
        ('urdf', String, 'robot_description', qos.LATCHED),
        ('static', TFMessage, '/tf_static', qos.LATCHED),
        ('moving', TFMessage, '/tf', qos.EVENTS),
        ('joints', JointState, 'joint_states', qos.SENSOR),
    ):
        cell.node.create_subscription(kind, topic, got[key].append, profile)
    until(lambda: all(got.values()), what='frames')
    began, seen = time.monotonic(), len(got['moving'])
    until(lambda: len(got['moving']) > seen + 20)
    assert time.monotonic() - began > 0.6
    assert cell.command(Command.Request.SET_ZERO, (0.2, 0.08, 0.02)).error_code == 0
    until(lambda: got['static'][-1].transforms[0].transform.translation.x == pytest.approx(0.2))
    assert cell.command(Command.Request.SET_ZERO, ZERO).error_code == 0
    until(lambda: got['static'][-1].transforms[0].transform.translation.x == pytest.approx(ZERO[0]))
    until(lambda: cell.telemetry.position.x == pytest.approx(-ZERO[0]))
    found = [placed(t) for m in (got['static'][-1], got['moving'][-1]) for t in m.transforms]
    seen = np.linalg.inv(in_root(found, 'work')) @ in_root(found, 'torch_tcp')
    p = cell.telemetry.position
    assert seen[:3, 3] == pytest.approx([p.x, p.y, p.z], abs=1e-6)
    assert 'torch_tcp' in Tree(got['urdf'][-1].data).frames
    at = dict(zip(got['joints'][-1].name, got['joints'][-1].position, strict=True))
    assert at == pytest.approx({'x': p.x + ZERO[0], 'y': p.y + ZERO[1], 'z': p.z + ZERO[2]})
    stamps = [
        (t.header.stamp.sec, t.header.stamp.nanosec)
        for m in got['moving']
        for t in m.transforms[:1]
    ]
    assert stamps == sorted(set(stamps)) and stamps[0][0] >= 1_700_000_000


def placed(msg):
    """A transform of tf as the core has it."""
    t, q = msg.transform.translation, msg.transform.rotation
    return Placed(msg.header.frame_id, msg.child_frame_id, (t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


def test_a_bead_is_laid_and_reported(cell):
    weld(cell, 40)
    until(lambda: cell.done and cell.done[-1] == 40)
    assert cell.done == list(range(41))
    until(lambda: cell.state.state == Telemetry.STATE_IDLE)
    assert cell.telemetry.position.x == pytest.approx(0.04, abs=4e-6)
    assert len(strikes(cell)) == len(strikes(cell, 'arc off')) == 1
    burning = [t for t in cell.got['telemetry'] if t.arc_established and t.travel_speed > 0.0099]
    assert burning and all(t.lease_left > 0 for t in burning)
    assert cell.got['anomaly'] == []


def test_the_controllers_refusals_come_back(cell):
    weld(cell, 60)
    got = cell.command(Command.Request.JOG, (0.001, 0.0, 0.0), value=0.01)
    assert got.error_code == Command.Response.WRONG_STATE and 'segments' in got.message
    got = cell.command(Command.Request.JOG_WIRE, value=0.01)
    assert got.error_code == Command.Response.REFUSED and 'E108' in got.message
    got = cell.command(Command.Request.RESET)
    assert got.error_code == Command.Response.REFUSED
    assert cell.command(Command.Request.STOP).error_code == 0
    assert cell.state.state == Telemetry.STATE_IDLE and 'stopped by host' in cell.state.message
    outside = cell.enqueue([approach(cell, (0.301, 0.0, 0.0)).at(index=900)], cell.job)
    assert outside.error_code == Enqueue.Response.BAD_SEGMENT and '401.000 mm' in outside.message


def test_hold_and_resume_strike_the_arc_again(cell):
    weld(cell, 60)
    assert cell.command(Command.Request.HOLD).error_code == 0
    until(lambda: cell.state.state == Telemetry.STATE_HOLD and not cell.state.arc_on)
    assert cell.enqueue(line_of(1, first=61), cell.job).error_code == Enqueue.Response.WRONG_STATE
    assert cell.command(Command.Request.RESUME).error_code == 0
    until(lambda: cell.done and cell.done[-1] == 60)
    assert cell.done == list(range(61)) and len(strikes(cell)) == 2


def test_a_killed_bridge_leaves_the_arc_off_within_the_lease(cell):
    weld(cell, 200)
    cell.process.kill()
    cell.process.wait(5)
    last_sign_us = cell.telemetry.controller_us
    until(lambda: strikes(cell, 'arc off'), what='arc off')
    off = strikes(cell, 'arc off')[0]
    assert off - last_sign_us <= LEASE_US
    cell.got['state'].clear()
    cell.start()
    until(lambda: cell.state.connected, what='second bridge')
    # the state comes with the first telemetry frame, a moment after the identification
    until(lambda: cell.state.state == Telemetry.STATE_HOLD, what='HOLD')
    assert cell.state.fault in (201, 202)
    assert not cell.state.arc_on and cell.state.armed_job == ''
    assert cell.command(Command.Request.STOP).error_code == 0
    until(lambda: cell.state.state == Telemetry.STATE_IDLE)


def test_a_node_that_never_answers_keeps_the_arc_off(cell):
    names = ['bridge', 'ghost']
    assert cell.command(Command.Request.ARM, text=cell.job, names=names).error_code == 0
    segments = [approach(cell), *line_of(20, arc=True, first=1)]
    assert cell.enqueue(segments, cell.job).error_code == 0
    until(lambda: cell.state.state == Telemetry.STATE_HOLD, what='hold')
    assert cell.state.fault == 202 and 'ghost' in cell.state.message
    until(lambda: list(cell.state.silent_nodes) == ['ghost'])  # named only once it is no mere delay
    until(lambda: any('ghost' in a.text for a in cell.got['anomaly']))


def test_a_clean_end_of_the_bridge_holds_the_machine_at_once(cell):
    weld(cell, 200)
    held = len(cell.controller.times('state HOLD E200'))
    cell.process.terminate()
    assert cell.process.wait(5) == 0
    until(lambda: strikes(cell, 'arc off'), what='arc off')
    assert len(cell.controller.times('state HOLD E200')) == held + 1
