"""The same job on a robot, and an arc that ends whatever dies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory

from waam_bridge import commands, overrides, program
from waam_bridge.frames import ALARM, ARC_ESTABLISHED, HOLD, HOMED, IDLE
from waam_lab import params, restore, run
from waam_lab.job import LabResult
from waam_lab.robot.robot_machine import RobotMachine
from waam_lab.robot.urdf_settings import parameter_file, settings
from waam_node.params import ParameterError
from waam_node.stl import write_worn_block
from waam_process.segment import Kind, Segment
from waam_robot_bridge.params import RobotParams
from waam_sim import part
from waam_sim.config import plant_params
from waam_sim.plant import Plant

TOP = 0.010  # m, of the plate
SMALL_ARM = Path(get_package_share_directory('waam_sim')) / 'urdf' / 'small_arm.urdf'
POSTURE = (0.0, 0.46, 0.40, 0.0, 1.09, 3.14)


def job(parts, **overrides) -> LabResult:
    """One layer on a robot, in a cell that scatters little."""
    nominal, worn = parts
    own = {'machine': 'robot', 'overrides': overrides, 'preset': 'gentle'}
    result = run(restore(nominal, worn, seed=2, layers=1, **own))
    assert not result.failed, result.message
    assert result.arcs_lost == 0
    assert result.layers == 1
    assert np.isfinite(result.rms) and result.contact_rms < 1.5e-3
    return result


def test_a_job_runs_on_a_robot_on_a_part_that_turns_and_on_another_arm(tmp_path):
    x, y = np.linspace(0, 24, 13), np.linspace(0, 18, 10)
    dip = 3.0 * np.ones((len(y), len(x)))
    parts = write_worn_block(tmp_path, x, y, 10.0, dip)
    usual = job(parts)
    turning = (0.3, 1.5, -2.0)  # a part that turns under the torch, in beads and in scans
    turned = job(parts, robot_bridge={'turning': turning}, cell={'robot_turning': turning})
    assert turned.rms == pytest.approx(usual.rms, rel=0.15) and turned.rms != usual.rms
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    other = job(parts, **settings(SMALL_ARM, {}))
    assert other.rms == pytest.approx(usual.rms, rel=0.15) and other.rms != usual.rms


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'cell': {'robot_urdf': ''}}, "robot_urdf '': both are one arm"),
        ({'cell': {'robot_origin': (0.0, -0.15, 0.0)}}, r'cell.robot_origin \(0.0, '),
        ({'cell': {'robot_posture': (0.1,)}}, 'a posture of 1 values for 6 joints'),
    ],
)
def test_a_cell_with_another_arm_than_the_bridge_is_refused(changes, said):
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    found = settings(SMALL_ARM, {'robot_bridge': {'posture': POSTURE}})
    found['cell'].update(changes['cell'])
    made = params.make(found)
    plant = Plant(part.plate(0.1, 0.03, TOP, 8e-4, 5e-3), plant_params(made.cell))
    with pytest.raises(ParameterError, match=said):
        RobotMachine(made.robot_bridge, plant)


def test_the_parameters_of_a_graph_have_the_posture_for_both(tmp_path):
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    order = [5, 0, 1, 2, 3, 4]  # as a driver may name them
    known = settings(SMALL_ARM, {'robot_bridge': {'posture': POSTURE}})['robot_bridge']
    given = {n: [known[n][k] for k in order] for n in known if n.startswith('joint_')}
    own = {'bridge': {'ros__parameters': {**given, 'posture': [POSTURE[k] for k in order]}}}
    (tmp_path / 'own.yaml').write_text(yaml.safe_dump(own))
    file = parameter_file(SMALL_ARM, [tmp_path / 'own.yaml'], tmp_path / 'run' / 'urdf.yaml')
    made = params.read_file(file)
    assert made['cell']['robot_posture'] == list(POSTURE)
    assert made['cell']['robot_urdf'] == made['bridge']['urdf'] == str(SMALL_ARM)
    assert made['bridge']['joint_speed_max'] == given['joint_speed_max']


def test_an_unknown_machine_is_refused(parts):
    with pytest.raises(ValueError, match="'crane', known are gantry, robot"):
        run(restore(*parts, machine='crane'))


@pytest.fixture
def machine():
    """Homed and armed while 'node' answers; `machine.alive` = it does."""
    made = RobotMachine(RobotParams(), Plant(part.plate(0.1, 0.03, TOP, 8e-4, 5e-3), seed=1))
    made.alive = True

    def beat(frame):
        if made.alive:
            made.bridge.beat('node', frame.t_us, made.bridge.link.boot, made.now)

    made.on_frame = beat
    made.connect()
    for command in (commands.RESET, commands.HOME):
        assert made.command(commands.Command(command))[0] == 0
    made.until(lambda: made.bridge.flags & HOMED != 0 and made.bridge.state == IDLE, 60.0)
    zero = commands.Command(commands.SET_ZERO, vector=made.plant.params.work_zero)
    assert made.command(zero)[0] == 0
    assert made.command(commands.Command(commands.ARM, text='job', names=('node',)))[0] == 0
    yield made
    made.close()


def enqueue(made: RobotMachine, *points: tuple[float, float, float]) -> None:
    """Idle moves to all points but the last, and a bead from there."""
    start = made.bridge.position
    segments = []
    for n, end in enumerate(points):
        last = n == len(points) - 1
        source = {'arc': True, 'wire_feed_speed': 0.1, 'voltage': 22.0} if last else {}
        kind, speed = (Kind.DEPOSIT, 0.01) if last else (Kind.IDLE, 0.08)
        segments.append(Segment(n, kind, start, end, speed, **source))
        start = end
    permit = made.bridge.permit('job', segments)
    made.bridge.commit(permit, program.prepare(permit, segments, True))


@pytest.mark.parametrize('dies', ['node', 'bridge', 'driver'])
def test_the_arc_ends_within_the_lease(machine, dies):
    enqueue(machine, (0.01, 0.015, 0.05), (0.01, 0.015, TOP), (0.09, 0.015, TOP))
    assert machine.until(lambda: machine.bridge.flags & ARC_ESTABLISHED != 0, 30.0)
    machine.advance(1.0)
    assert machine.plant.arc_on
    began, tip = machine.now, machine.robot.tip
    machine.alive = dies != 'node'
    machine.bridge_dead = dies == 'bridge'
    machine.robot.dead = dies == 'driver'
    assert machine.until(lambda: not machine.plant.arc_on, 1.0)
    assert machine.now - began <= 0.5
    machine.advance(1.0)
    assert np.linalg.norm(machine.robot.tip - tip) < 0.01  # it has come to rest
    if dies == 'driver':
        assert machine.bridge.state == HOLD
    if dies == 'node':
        assert machine.bridge.silent == ['node']


def test_the_robot_takes_the_override_while_the_arc_burns(machine):
    enqueue(machine, (0.01, 0.015, 0.05), (0.01, 0.015, TOP), (0.09, 0.015, TOP))
    assert machine.until(lambda: machine.bridge.flags & ARC_ESTABLISHED != 0, 30.0)
    for speed, wire in ((1.0, 1.0), (0.6, 1.2), (1.3, 0.9)):
        overrides.operator(machine.bridge, speed, wire, 'test', machine.now)
        machine.advance(1.0)
        begin, tip = machine.now, machine.robot.tip
        machine.advance(0.5)
        went = float(np.linalg.norm(machine.robot.tip - tip))
        assert went / (machine.now - begin) == pytest.approx(0.01 * speed, rel=0.01)
        assert machine._samples['wire_cmd'][-1] == pytest.approx(0.1 * wire, rel=0.01)
        assert machine.plant.arc_on


def test_a_place_outside_the_box_is_refused_before_the_arc(machine):
    with pytest.raises(program.Refusal, match=r'segment 0: end.x is 500.000 mm in machine'):
        enqueue(machine, (0.4, 0.0, 0.05), (0.41, 0.0, 0.05))


def test_a_driver_that_refuses_goals_is_told_and_holds(machine):
    notices = []
    machine.on_outbox = lambda box: notices.extend(box.notices)
    machine.robot.beyond = lambda joints: "the driver knows no joint 'joint_9'"
    enqueue(machine, (0.01, 0.015, 0.05), (0.02, 0.015, 0.05))
    machine.advance(0.5)
    assert any("joint_9" in n.text and 'the arc is cut' in n.text for n in notices)
    assert machine.bridge.state in (HOLD, ALARM)
