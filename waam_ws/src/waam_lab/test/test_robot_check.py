"""A plan on the robot before the arc: what is told, and whether the simulated robot then does what was told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from ament_index_python.packages import get_package_share_directory

from waam_bridge import commands, program
from waam_bridge.frames import HOMED, IDLE
from waam_lab import params
from waam_lab.cli_robot_check import check_robot
from waam_lab.robot.dry_run import DryRunError, clipped, layers, work_zero
from waam_lab.robot.robot_check import check
from waam_lab.robot.robot_machine import RobotMachine
from waam_lab.robot.urdf_settings import settings
from waam_plan.gcode.program import with_base_feed
from waam_plan.layers.build import plan_build
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan, renumber
from waam_plan.settings import PlanSettings
from waam_robot_bridge.params import NAMES, RobotParams
from waam_sim import part
from waam_sim.plant import Plant

SMALL_ARM = Path(get_package_share_directory('waam_sim')) / 'urdf' / 'small_arm.urdf'
POSTURE = (0.0, 0.46, 0.40, 0.0, 1.09, 3.14)
WINDOW = 5  # exchanges of 10 ms over which speeds are measured


@pytest.fixture(scope='module')
def plan(tmp_path_factory) -> Plan:
    """One layer of a wedge: its beads meet at sharp corners."""
    corners = np.array([(0, 0), (50, 0), (50, 26)])
    ground = np.column_stack([corners, np.zeros(3)])
    points = np.concatenate([ground, ground + [0, 0, 4]])
    wedge = trimesh.convex.convex_hull(points)
    file = tmp_path_factory.mktemp('parts') / 'wedge.stl'
    wedge.export(file)
    return plan_build(load_part(file), PlanSettings(edge_metal=1.0, pitch_ratio=0.66), 1)


@pytest.fixture(scope='module')
def found(plan):
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    return check(plan, RobotParams())


LONG = {'origin': [-0.9, -0.15, 0.0], 'work_high': [1.8, 0.3, 0.2]}


def test_a_long_part_is_laid_by_a_robot_that_turns_it(tmp_path, capsys):
    """600 mm, beyond the gantry's 400 mm; at rest the robot does not reach its box of 1.8 m."""
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    trimesh.creation.box((600, 12, 2)).export(tmp_path / 'bar.stl')
    far = PlanSettings(machine_max=(1.7, 0.22, 0.18))
    built = plan_build(load_part(tmp_path / 'bar.stl'), far, 1)
    file = tmp_path / 'long.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': LONG}}))
    with pytest.raises(
        ValueError, match=r'all of its box, \(\d+, 300, 0\) mm of the machine not: too near'
    ):
        check_robot(built, files=[file])
    other = tmp_path / 'other.yaml'
    other.write_text(yaml.safe_dump({'brige': {'ros__parameters': LONG}}))
    with pytest.raises(ValueError, match="no node 'brige'; did you mean 'bridge'"):
        check_robot(built, files=[other])
    check_robot(built, turning=True, out=tmp_path, files=[file])
    said = capsys.readouterr().out
    assert 'at rest it cannot be reached' in said and 'keep their distance' in said
    written = params.read_file(tmp_path / 'robot.yaml')
    assert any(written['bridge']['turning'])
    for name, value in written['bridge'].items():
        assert written['cell'][f'robot_{name}'] == value
    assert '&' not in (tmp_path / 'robot.yaml').read_text()  # rcl reads no aliases


def test_the_core_lays_what_was_planned(plan):
    (laid,) = layers(plan, RobotParams())
    assert len(laid.beads) == plan.arc_starts
    for bead in laid.beads:
        way = np.linalg.norm(np.diff(bead.tips, axis=0), axis=1).sum()
        assert way == pytest.approx(
            np.linalg.norm(np.diff(bead.corners, axis=0), axis=1).sum(), abs=1e-4
        )
        assert np.abs(bead.tips[-1] - bead.corners[-1]).max() < 1e-5


def test_places_are_told_with_bead_way_and_cause(found):
    assert not found.refused and found.contacts == ()
    assert found.off and all('deg' in p.cause or 'speed' in p.cause for p in found.off)
    said = '\n'.join(found.lines())
    assert 'mm from its start, at (' in said and 'mm/s instead of' in said
    assert 'keep their distance' in said


def test_the_robot_does_what_was_told(plan, found):
    """Elsewhere the true torch of the simulated robot has the programmed speed."""
    machine = RobotMachine(RobotParams(), Plant(part.plate(0.07, 0.05, 0.004, 1e-3, 5e-3), seed=3))
    tips: list[np.ndarray] = []

    def see(samples, plant):
        s = samples[-1]
        place = np.array([s['table_x'], s['table_y'], s['tool_z']])
        tips.append(place if plant.arc_on else np.full(3, np.nan))

    machine.on_exchange = see
    machine.connect()
    for name in (commands.RESET, commands.HOME):
        assert machine.command(commands.Command(name))[0] == 0
    machine.until(lambda: machine.bridge.flags & HOMED != 0 and machine.bridge.state == IDLE, 60.0)
    zero = work_zero(plan)
    assert machine.command(commands.Command(commands.SET_ZERO, vector=zero))[0] == 0
    assert machine.command(commands.Command(commands.ARM, text='job'))[0] == 0
    machine.advance(0.5)
    tips.clear()
    (layer,) = plan.layers
    up = [
        s.at(start=_raised(s.start), end=_raised(s.end))
        for s in clipped(with_base_feed(layer.segments, plan.settings), RobotParams())
    ]
    segments = renumber(up, 0, machine.bridge.position, plan.settings, plan.safe_z + 0.004)
    permit = machine.bridge.permit('job', segments)
    machine.bridge.commit(permit, program.prepare(permit, segments, True))
    machine.advance(0.1)
    assert machine.until(lambda: machine.bridge.state == IDLE and not machine.bridge.queued, 200.0)
    machine.close()
    speed, place = _speeds(np.array(tips), zero)
    wanted = _wanted(plan, place)
    told = np.zeros(len(place), bool)
    for p in found.off:
        told |= np.linalg.norm(place[:, :2] - p.at[:2], axis=1) < (p.end - p.begin) + 1.5e-3
    (laid,) = layers(plan, RobotParams())
    ends = np.array([(b.corners[0], b.corners[-1]) for b in laid.beads])
    for point in ends.reshape(-1, 3) - zero:
        told |= np.linalg.norm(place[:, :2] - point[:2], axis=1) < 2e-3
    off = np.abs(speed / wanted - 1)[~told]
    assert len(off) > 200
    assert np.quantile(off, 0.99) < 0.015
    for p in found.off:  # what is told does happen
        share = abs(p.speed / p.wanted - 1)
        here = np.linalg.norm(place[:, :2] - p.at[:2], axis=1) < 2e-3
        assert np.abs(speed / wanted - 1)[here].max() > share / 2, p.text


def _raised(point):
    x, y, z = point
    return (x, y, z + 0.004)


def _speeds(tips, zero):
    """Speed (m/s) and place (m, work frame) of the torch while the arc burns."""
    xyz = np.column_stack([-tips[:, 0], -tips[:, 1], tips[:, 2]])
    way = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
    windows = np.lib.stride_tricks.sliding_window_view(way, WINDOW)
    speed = windows.mean(axis=1) / 1e-2
    place = (xyz[WINDOW // 2 : -(WINDOW // 2) - 1] + xyz[WINDOW // 2 + 1 : -(WINDOW // 2)]) / 2
    place = place[: len(speed)]
    good = np.isfinite(speed) & (speed > 1e-4)
    return speed[good], place[good] - zero


def _wanted(plan, place):
    """m/s: the programmed speed at the nearest piece."""
    laid = plan.layers[0].deposits
    a, b = (np.array([getattr(s, n)[:2] for s in laid]) for n in ('start', 'end'))
    along = b - a
    out = []
    for p in place[:, :2]:
        t = np.clip(((p - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18), 0, 1)
        out.append(laid[int(np.argmin(np.linalg.norm(p - a - t[:, None] * along, axis=1)))].speed)
    return np.array(out)


def test_a_tower_beside_the_bead_is_a_contact_with_its_place(plan):
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    z = plan.as_found.z.copy()
    rows, cols = plan.spec.cell(np.array([0.035]), np.array([0.012]))
    z[rows[0] : rows[0] + 4, cols[0] : cols[0] + 4] = 0.05
    layers = [replace(layer, footprint=layer.footprint & ~(z == 0.05)) for layer in plan.layers]
    built = replace(plan, as_found=replace(plan.as_found, z=z), layers=layers)
    found = check(built, RobotParams())
    assert found.contacts and 'nozzle within 2 mm of part' in found.contacts[0]
    assert found.refused == found.contacts[0] and found.refused.startswith('layer 1, ')
    with pytest.raises(
        ValueError, match='not on this robot: layer 1, .* nozzle within 2 mm of part'
    ):
        check_robot(built)


def test_a_robot_that_stands_too_far_away(plan):
    found = check(plan, RobotParams(positioner=(2.5, 0.35, 0.15)))
    assert 'does not reach' in found.problem and found.lines() == [f'robot: {found.problem}']


def test_a_plan_beyond_the_box_names_the_segment(plan):
    far = replace(plan, settings=replace(plan.settings, machine_min=(-0.395, -0.08, -0.02)))
    with pytest.raises(DryRunError, match=r'segment \d+: (start|end)\.x is'):
        list(layers(far, RobotParams()))


def test_joints_that_are_too_slow_for_the_arc_refuse_the_plan(plan):
    slow = check(plan, RobotParams(joint_speed_max=(0.001, *RobotParams().joint_speed_max[1:])))
    assert 'J1 allows ' in slow.refused and 'with the arc on at least 3 mm/s' in slow.refused


def test_beads_that_a_joint_slows_down_are_told(plan):
    pytest.importorskip('toppra', reason='scripts/setup.sh --robot installs it')
    usual = RobotParams().joint_speed_max
    weak = RobotParams(joint_speed_max=(0.007, *usual[1:]), wire_feed_min=0.01)
    slow = check(plan, weak)
    assert not slow.problem and not any(p.stops for p in slow.off)
    held = [p for p in slow.off if 'J1 would have to turn at' in p.cause]
    assert held and all(p.speed < 0.99 * p.wanted for p in held)
    assert any('timed by TOPPRA' in line for line in slow.lines())


def test_ways_with_the_arc_off_are_slowed_down(plan):
    """Beads are slow enough for this joint, the way to them is not."""
    usual = RobotParams().joint_speed_max
    slow = check(plan, RobotParams(joint_speed_max=(0.03, *usual[1:])))
    assert not slow.problem and slow.used[0, 0] <= 1.0


def test_another_arm_is_checked_too(plan):
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    overrides = settings(SMALL_ARM, {'robot_bridge': {'posture': POSTURE}})
    found = check(plan, params.make(overrides).robot_bridge)
    assert not found.refused and found.contacts == () and not found.unchecked
    said = '\n'.join(found.lines())
    assert 'keep their distance' in said


@pytest.mark.parametrize(
    ('names', 'said'),
    [
        (('foo', *NAMES[1:]), "the robot has no joint 'foo'; there are joint_1, joint_2, "),
        ((*NAMES[:6], 'turn', 'tilt'), "has 'turn' in the place of 'tilt'"),
    ],
)  # fmt: skip
def test_joints_that_the_robot_does_not_have_are_named(plan, tmp_path, names, said):
    file = tmp_path / 'names.yaml'
    file.write_text(yaml.safe_dump({'/bridge': {'ros__parameters': {'joint_names': [*names]}}}))
    with pytest.raises(ValueError, match=said):
        check_robot(plan, files=[file])


def test_the_screen(plan, capsys):
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    check_robot(plan)
    assert 'robot: the torch has the programmed speed within 1% on' in capsys.readouterr().out
