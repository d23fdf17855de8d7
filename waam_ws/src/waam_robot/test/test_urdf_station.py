"""The cell's box before an arm from a URDF: the same arm two ways, one without a spherical wrist, wrong files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_robot.positioner import Machine
from waam_robot.station import Station, StationError
from waam_robot.timing import Drives
from waam_robot.urdf_station import UrdfPlace, UrdfStation
from waam_robot.urdf_text import UrdfError, write_urdf

pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')

STATION = Station()
TEXT = write_urdf(Machine(), Drives().speed)
NAMES = (*(f'joint{n}' for n in range(1, 7)), 'tilt', 'turn')
MIDDLE = np.array([[0.2, 0.15, 0.1]])
PLACE = UrdfPlace(NAMES, STATION.place.origin, posture=tuple(STATION.joints(MIDDLE)[0].tolist()))
# a wrist of three joints that do not meet, as that of many light arms
OFFSET = """<robot name="offset"><link name="base"/><link name="part"/>
<joint name="table" type="fixed"><parent link="base"/><child link="part"/><origin xyz="0.5 -0.1 0.2"/></joint>
{}<link name="torch"/><joint name="tool" type="fixed"><parent link="l6"/><child link="torch"/>
<origin xyz="0 0 0.15"/></joint></robot>"""
JOINTS = [
    ('0 0 0.4', '0 0 1'), ('0 0.12 0', '0 1 0'), ('0.55 0 0', '0 1 0'), ('0.5 -0.1 0', '0 1 0'), ('0 0 -0.1', '0 0 -1'),
    ('0.08 0 0', '1 0 0'),
]  # fmt: skip


def offset_arm() -> str:
    text = ''
    for n, (at, axis) in enumerate(JOINTS, 1):
        parent = f'l{n - 1}' if n > 1 else 'base'
        turn = ' rpy="0 1.5707963 0"' if n == 6 else ''
        text += (
            f'<link name="l{n}"/><joint name="j{n}" type="revolute"><parent link="{parent}"/><child link="l{n}"/>'
            f'<origin xyz="{at}"{turn}/><axis xyz="{axis if n < 6 else "0 0 1"}"/>'
            '<limit lower="-6.2" upper="6.2" velocity="3" effort="9"/></joint>'
        )
    return OFFSET.format(text)


def test_the_same_arm_as_by_its_table():
    station = UrdfStation(TEXT, PLACE)
    tips = np.random.default_rng(2).uniform(STATION.place.low, STATION.place.high, (30, 3))
    tips = tips[np.argsort(tips[:, 0])]
    joints = station.joints(tips)
    assert np.abs(joints - STATION.joints(tips)).max() < 1e-7
    assert np.abs(station.tips(joints) - tips).max() < 1e-8
    again = station.joints(tips[-1:], joints[-1])
    assert np.abs(again - joints[-1:]).max() < 1e-8
    assert station.gains == pytest.approx(STATION.gains, rel=0.05, abs=1e-6)


def test_names_are_in_the_order_of_the_driver():
    order = [1, 0, 2, 3, 4, 5, 7, 6]
    names = tuple(NAMES[n] for n in order)
    posture = tuple(PLACE.posture[n] for n in order)
    station = UrdfStation(TEXT, replace(PLACE, joint_names=names, posture=posture))
    joints = station.joints(MIDDLE)
    assert np.abs(joints[:, np.argsort(order)] - STATION.joints(MIDDLE)).max() < 1e-7


def test_an_arm_without_a_spherical_wrist_finds_a_posture():
    place = UrdfPlace(tuple(f'j{n}' for n in range(1, 7)), high=(0.2, 0.2, 0.1))
    station = UrdfStation(offset_arm(), place)
    tips = np.linspace([0, 0, 0], [0.2, 0.2, 0.1], 50)
    joints = station.joints(tips)
    assert np.abs(np.diff(joints, axis=0)).max() < 0.1
    assert np.abs(station.tips(joints) - tips).max() < 1e-8


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'joint_names': (*NAMES[:5], 'joint_7', *NAMES[6:])}, "no joint 'joint_7' that moves; there are joint1, "),
        ({'joint_names': NAMES[:7], 'posture': ()}, "joint 'turn' moves, but is not among the joint names"),
        ({'joint_names': NAMES[:4]}, '4 joint names; an arm needs 6'),
        ({'posture': (0.0,) * 7}, 'a posture of 7 values for 8 joints'),
        ({'torch': 'gun'}, "no link 'gun'; there are "),
    ],
)  # fmt: skip
def test_wrong_names_are_told(changes, said):
    with pytest.raises(UrdfError, match=said):
        UrdfStation(TEXT, replace(PLACE, **changes))


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'origin': (2.0, -0.15, 0.0)}, r'does not reach all of its box'),
        ({'high': (1.6, 0.3, 0.2)}, r'\(-?\d+, -?\d+, -?\d+\) mm'),
        ({'high': (0.4, 0.0, 0.2)}, 'is empty'),
    ],
)
def test_a_place_that_is_not_reached_is_named(changes, said):
    with pytest.raises(StationError, match=said):
        UrdfStation(TEXT, replace(PLACE, **changes))


def test_beside_the_reach():
    with pytest.raises(StationError, match='out of reach'):
        UrdfStation(TEXT, PLACE).joints(np.array([[5.0, 0.0, 0.0]]))


def test_a_file_that_is_none():
    with pytest.raises(UrdfError, match='line 1'):
        UrdfStation('<robot', PLACE)
