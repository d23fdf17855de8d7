"""The simulated arm of a URDF: where the bridge's kinematics have it, its errors, and files that are none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from waam_node.params import ParameterError
from waam_robot.positioner import Machine
from waam_robot.station import Station
from waam_robot.timing import Drives
from waam_robot.urdf_text import UrdfError, write_urdf
from waam_sim.robot import RobotParams, SimRobot
from waam_sim.urdf_arm import UrdfArm
from waam_sim.urdf_file import arm_of

FILE = Path(__file__).parents[1] / 'urdf' / 'small_arm.urdf'
TEXT = FILE.read_text()
NAMES = ('base', 'shoulder', 'elbow', 'wrist_roll', 'wrist_bend', 'wrist_turn')
POSTURE = (0.0, 0.46, 0.40, 0.0, 1.09, 3.14)
ORIGIN = (-0.2, -0.15, 0.0)
TAUGHT = np.array([0.1, 0.08, 0.02])
PARTED = 'joint name="table" type="fixed"'


def test_the_torch_is_where_the_bridge_has_it():
    urdf_station = pytest.importorskip('waam_robot.urdf_station')
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    place = urdf_station.UrdfPlace(NAMES, ORIGIN, posture=POSTURE)
    station, arm = urdf_station.UrdfStation(TEXT, place), UrdfArm(TEXT, POSTURE, NAMES, ORIGIN)
    anywhere = np.random.default_rng(3).uniform(arm.low, arm.high, (40, 6))
    assert np.abs(arm.tips(anywhere) - station.tips(anywhere)).max() < 1e-12
    tips = np.linspace([0.0, 0.0, 0.0], [0.4, 0.3, 0.2], 30)
    upright = arm.frames(station.joints(tips))
    assert np.abs(upright[:, :3, 3] - tips).max() < 2e-9
    assert np.abs(upright[:, :3, :3] - np.eye(3)).max() < 2e-9
    assert np.abs(arm.joints(tips) - station.joints(tips)).max() < 1e-7


def test_the_arm_of_the_table_as_a_file_with_its_positioner():
    station, tip = Station(), np.array([[0.25, 0.1, 0.05]])
    joints = station.joints(tip)
    arm = UrdfArm(write_urdf(Machine(), Drives().speed), tuple(joints[0]), origin=ORIGIN)
    assert arm.names == (*(f'joint{n}' for n in range(1, 7)), 'tilt', 'turn')
    near = joints + np.random.default_rng(1).normal(0, 0.1, (20, 8))
    assert np.abs(arm.frames(near) - station.frames(near)).max() < 1e-9


def test_names_are_in_the_order_that_is_asked_for():
    order = [5, 1, 0, 2, 4, 3]
    usual = UrdfArm(TEXT, POSTURE, (), ORIGIN)
    other = UrdfArm(TEXT, tuple(POSTURE[n] for n in order), tuple(NAMES[n] for n in order), ORIGIN)
    q = np.random.default_rng(4).uniform(usual.low, usual.high, (5, 6))
    assert usual.names == NAMES
    assert np.abs(usual.frames(q) - other.frames(q[:, order])).max() < 1e-12
    assert np.abs(other.joints(TAUGHT[None]) - usual.joints(TAUGHT[None])[:, order]).max() < 1e-7


def test_errors_are_none_where_it_was_taught_and_grow_away_from_there():
    arm = UrdfArm(TEXT, POSTURE, NAMES, ORIGIN)
    params = RobotParams(backlash=0.0)
    near = SimRobot(arm, params, 3, TAUGHT, TAUGHT, 0)
    assert np.abs(near.tip - TAUGHT).max() < 1e-9
    place = TAUGHT + [0.2, 0.15, 0.1]
    parts = [
        SimRobot(arm, RobotParams(backlash=0.0, **less), 3, place, TAUGHT, 0).tip - place
        for less in ({}, {'link_length': 0.0}, {'joint_offset': 0.0, 'gear_wave': 0.0})
    ]
    assert all(1e-5 < np.linalg.norm(miss) < 2e-3 for miss in parts)
    exact = RobotParams(joint_offset=0.0, gear_wave=0.0, link_length=0.0, backlash=0.0)
    assert np.abs(SimRobot(arm, exact, 3, place, TAUGHT, 0).tip - place).max() < 1e-8


def test_goals_beyond_a_limit_of_the_file_are_told():
    robot = SimRobot(UrdfArm(TEXT, POSTURE, NAMES, ORIGIN), RobotParams(), 3, TAUGHT, TAUGHT, 0)
    goal = np.array([POSTURE, POSTURE])
    assert robot.beyond(goal) == ''
    goal[1, 2] = 2.61
    assert robot.beyond(goal) == 'elbow would be 2.6100, its range -2.4000 to 2.6000'


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('<robot name', '<cell name', "the root element is 'cell', wanted 'robot'"),
        ('</robot>', '', 'line '),
        ('link name="torch"', 'link name="gun"', "no link 'torch' for its child"),
        ('"torch"', '"gun"', "no link 'torch'; there are "),
        ('"elbow" type="revolute"', '"elbow" type="fixed"', "5 revolute joints move the link 'torch' and 0 "),
        (PARTED, PARTED.replace('fixed', 'revolute'), "joint 'table' has no limit"),
        ('"elbow" type="revolute"', '"elbow" type="prismatic"', "joint 'elbow' is prismatic; "),
        ('"elbow" type="revolute"', '"elbow" type="continuous"', "joint 'elbow' is continuous; "),
        ('lower="-2.4"', 'lower="2.7"', "joint 'elbow': limits 2.7 to 2.6"),
        ('xyz="0 0 0.66"', 'xyz="0 0 here"', "joint 'elbow': origin xyz is '0 0 here'"),
        ('xyz="0.74 0.02 0.14"', 'xyz="2.74 0.02 0.14"', 'is not reached from the posture'),
        ('</robot>', '<link name="jaw"/><joint name="grip" type="revolute"><parent link="torch"/><child link="jaw"/>'
         '<limit lower="0" upper="1"/></joint></robot>', "joint 'grip' moves, but is not between"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_named(tmp_path, old, new, said):
    assert old in TEXT
    file = tmp_path / 'arm.urdf'
    file.write_text(TEXT.replace(old, new))
    with pytest.raises((ParameterError, UrdfError), match=re.escape(said)):
        SimRobot(
            arm_of(RobotParams(urdf=str(file), posture=POSTURE)),
            RobotParams(),
            1,
            TAUGHT,
            TAUGHT,
            0,
        )


@pytest.mark.parametrize(
    ('changes', 'names', 'said'),
    [
        ({'urdf': '/nowhere/arm.urdf'}, (), "'robot_urdf': /nowhere/arm.urdf: No such file"),
        ({}, ('joint_1', *NAMES[1:]), 'wanted or left over: base, joint_1'),
        ({'posture': (0.1, 0.2)}, (), 'a posture of 2 values for 6 joints'),
        ({'posture': (float('nan'),)}, (), "'robot_posture' is needed"),
        ({'tilt': 0.5}, (), "'robot_tilt': only the M-20iB/25"),
        ({'origin': (0.0, 0.0)}, (), "'robot_origin' has 2 values"),
    ],
)
def test_parameters_that_do_not_fit_are_named(changes, names, said):
    with pytest.raises(ParameterError, match=re.escape(said)):
        arm_of(RobotParams(**{'urdf': str(FILE), 'posture': POSTURE, **changes}), names)
