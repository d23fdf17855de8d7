"""Bodies of a cell from a URDF: where they are, what they touch, and what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waam_robot.bodies import CRADLE, PART, TOOL, bodies_of, ends, frames_of
from waam_robot.positioner import Machine
from waam_robot.timing import Drives
from waam_robot.urdf_bodies import UrdfCell
from waam_robot.urdf_station import UrdfPlace, UrdfStation
from waam_robot.urdf_text import POSITIONER_JOINTS, UrdfError, write_urdf

pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')

TEXT = (Path(__file__).parents[2] / 'waam_sim' / 'urdf' / 'small_arm.urdf').read_text()
JOINTS = tuple(f'joint{n}' for n in range(1, 7))
NAMES = ('base', 'shoulder', 'elbow', 'wrist_roll', 'wrist_bend', 'wrist_turn')
ORIGIN = np.array([-0.2, -0.15, 0.0])
POSTURE = (0.0, 0.46, 0.40, 0.0, 1.09, 3.14)


@pytest.fixture(scope='module')
def station() -> UrdfStation:
    return UrdfStation(TEXT, UrdfPlace(NAMES, (-0.2, -0.15, 0.0), posture=POSTURE))


def test_the_torch_of_the_bodies_is_where_the_station_has_it(station):
    tips = np.array([[0.2, 0.15, 0.1], [0.05, 0.05, 0.02]])
    frames = UrdfCell(TEXT, NAMES).frames(station.joints(tips))
    on_part = np.linalg.inv(frames[:, PART]) @ frames[:, TOOL]
    assert np.abs(on_part[:, :3, 3] - ORIGIN - tips).max() < 1e-8
    assert np.abs(on_part[:, :3, 2] - [0, 0, -1]).max() < 1e-8


def test_every_link_with_a_shape_has_its_body():
    bodies = UrdfCell(TEXT, NAMES).bodies
    assert {c.name for c in bodies.capsules} == {
        'column',
        'upper_arm',
        'forearm',
        'roll',
        'flange',
        'nozzle',
    }
    assert {b.name for b in bodies.blocks} == {'floor', 'part'}
    assert [c.frame for c in bodies.capsules if c.name == 'upper_arm'] == [2]


def test_the_arm_over_its_table_touches_nothing_and_in_the_table_it_does(station):
    pytest.importorskip('coal', reason='requirements-robot.txt is not installed')
    from waam_robot.collision import Scene

    free = station.joints(np.linspace([0.1, 0.1, 0.05], [0.3, 0.2, 0.05], 30))
    cell = UrdfCell(TEXT, NAMES, free[0])
    scene = Scene(Machine(), cell.bodies, frames=cell.frames)
    assert scene.first(free) is None
    below = station.joints(np.linspace([0.2, 0.15, 0.05], [0.2, 0.15, -0.03], 30), free[-1])
    contact = scene.first(below)
    assert contact is not None and contact.bodies == ('nozzle', 'part')
    assert contact.tip[2] == pytest.approx(-0.012 + 0.002 + 0.01 - 0.01, abs=0.012)


def test_what_is_a_mesh_is_left_out_and_named():
    text = TEXT.replace('<cylinder radius="0.055" length="0.42"/>', '<mesh filename="arm.stl"/>')
    cell = UrdfCell(text, NAMES)
    assert cell.left_out == ('forearm',)
    assert 'forearm' not in {c.name for c in cell.bodies.capsules}


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('radius="0.07"', 'radius="thick"', "link 'upper_arm': radius of a shape is 'thick'"),
        (
            'size="0.06 0.05 0.18"',
            'size="0.06 0.05"',
            "link 'flange': size of a shape is '0.06 0.05', wanted 3",
        ),
    ],
)
def test_a_shape_that_is_none_is_named(old, new, said):
    with pytest.raises(UrdfError, match=said):
        UrdfCell(TEXT.replace(old, new), NAMES)


def test_names_that_the_file_does_not_have():
    with pytest.raises(UrdfError, match='its joints are base, shoulder'):
        UrdfCell(TEXT, (*NAMES[:5], 'hand'))


def test_the_file_of_the_table_is_drawn_with_the_bodies_of_the_table():
    """So a plan is judged alike with the arm and with its own URDF."""
    machine = Machine()
    cell = UrdfCell(write_urdf(machine, Drives().speed), (*JOINTS, *POSITIONER_JOINTS))
    bodies = bodies_of(machine.arm, machine.positioner)
    joints = np.random.default_rng(4).uniform(-1.0, 1.0, (5, 8))
    of_file, of_table = cell.frames(joints), frames_of(machine.arm, machine.positioner, joints)
    found = ends(cell.bodies.capsules, of_file)
    assert np.abs(found - ends(bodies.capsules, of_table)).max() < 1e-5
    assert [c.radius for c in cell.bodies.capsules] == [c.radius for c in bodies.capsules]
    assert sorted(b.size[0] for b in cell.bodies.blocks) == sorted(
        c.radius for c in bodies.cylinders
    )
    middle = {b.name: of_file[:, b.frame] @ b.place for b in cell.bodies.blocks if b.size[0] == 0.3}
    plate = of_table[:, CRADLE, :3, 3] - 0.01 * of_table[:, CRADLE, :3, 2]
    assert np.abs(middle['cradle'][:, :3, 3] - plate).max() < 1e-5
