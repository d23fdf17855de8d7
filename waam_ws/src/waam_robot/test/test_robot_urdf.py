"""Arms from a URDF: the same machine two ways, files that are wrong."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.arm import forward
from waam_robot.frames import rotation
from waam_robot.positioner import Machine, Positioner
from waam_robot.timing import Drives
from waam_robot.urdf_arm import UrdfChain
from waam_robot.urdf_text import UrdfError, check_urdf, write_urdf

MACHINE = Machine(positioner=Positioner(a_b=1.2, d_bb=0.1, d_b=0.35, d_c=0.15))
TEXT = write_urdf(MACHINE, Drives().speed)


@pytest.fixture
def pinocchio():
    return pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')


def test_the_written_machine_is_the_same_machine(pinocchio):
    """Pinocchio on the URDF against the DH table and the positioner's own formulas."""
    chain = UrdfChain(TEXT)
    assert chain.names == (
        'joint1',
        'joint2',
        'joint3',
        'joint4',
        'joint5',
        'joint6',
        'tilt',
        'turn',
    )
    assert chain.low[:6] == pytest.approx(MACHINE.arm.low) and chain.high[:6] == pytest.approx(
        MACHINE.arm.high
    )
    joints = np.random.default_rng(0).uniform(-2, 2, (100, 8))
    tip = forward(MACHINE.arm, joints[:, :6]) @ rotation(0, np.pi)
    on_part = MACHINE.positioner.to_part(tip, joints[:, 6], joints[:, 7])
    assert chain.forward(joints) == pytest.approx(on_part, abs=1e-12)


def test_a_rail_in_the_chain_is_one_of_its_joints(pinocchio):
    """The arm on a linear axis of 2 m along x: nine joints."""
    rail = (
        '<link name="carriage"/><joint name="rail" type="prismatic"><parent link="world"/><child link="carriage"/>'
        '<axis xyz="1 0 0"/><limit lower="0" upper="2" velocity="1" effort="1"/></joint>'
    )
    first = '<parent link="world"/><child link="link1"/>'
    assert first in TEXT
    text = TEXT.replace(first, first.replace('world', 'carriage')).replace(
        '</robot>', rail + '</robot>'
    )
    chain, usual = UrdfChain(text), UrdfChain(TEXT)
    assert len(chain.names) == 9 and 'rail' in chain.names
    joints = np.full((1, 9), 0.3)
    joints[0, chain.names.index('rail')] = 0.5
    moved = chain.forward(joints)[0, :3, 3] - usual.forward(np.full((1, 8), 0.3))[0, :3, 3]
    assert np.linalg.norm(moved) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('<robot', '<machine', "line 1: the root element is 'machine', wanted 'robot'|mismatched tag"),
        ('</robot>', '', 'no element found'),
        ('type="revolute"', 'type="hinge"', r"line \d+: joint 'joint1': type 'hinge'; known are revolute"),
        ('<parent link="link1"/>', '<parent link="lost"/>', "joint 'joint2': no link 'lost' for its parent"),
        ('<child link="link2"/>', '<child link="link1"/>', "joint 'joint2': link 'link1' has two parents"),
        ('name="joint2"', 'name="joint1"', "joint 'joint1' is there twice"),
        ('xyz="0 0 1"', 'xyz="0 0 0"', "joint 'joint1': an axis without direction"),
        ('xyz="0 0 1"', 'xyz="0 0"', "joint 'joint1': axis is '0 0', wanted 3 numbers"),
        ('xyz="0 0 1"', 'xyz="0 nan 1"', "joint 'joint1': axis is"),
        ('lower="-3.14', 'lower="3.24', "joint 'joint1': limits 3.2"),
        ('<link name="world">', '<link name="earth">', "joint 'joint1': no link 'world' for its parent"),
        ('<link name="part"/>', '<link name="part"/><link name="alone"/>', 'links without a parent: world, alone'),
        ('<link name="part"/>', '<link/>', 'a link without a name'),
        ('<robot', '<!DOCTYPE a><robot', 'document types and entities are not read'),
    ],
)  # fmt: skip
def test_wrong_files_are_told_with_line_and_name(old, new, said):
    assert old in TEXT
    with pytest.raises(UrdfError, match=said):
        check_urdf(TEXT.replace(old, new, 1))


def test_joints_that_go_round_are_refused():
    ring = ''.join(
        f'<link name="{a}"/><joint name="j{a}" type="fixed"><parent link="{a}"/><child link="{b}"/></joint>'
        for a, b in ('ab', 'ba')
    )
    with pytest.raises(UrdfError, match='go round'):
        check_urdf(f'<robot name="r">{ring}</robot>')
    with pytest.raises(UrdfError, match='go round through link'):
        check_urdf(f'<robot name="r"><link name="base"/>{ring}</robot>')


def test_links_that_are_not_there_are_named(pinocchio):
    with pytest.raises(UrdfError, match="no link 'gun'; there are .*torch"):
        UrdfChain(TEXT, torch='gun')
    with pytest.raises(UrdfError, match='no joint moves'):
        UrdfChain('<robot name="r"><link name="torch"/></robot>', part='torch')


def test_without_the_library_the_error_teaches(monkeypatch):
    monkeypatch.setitem(sys.modules, 'pinocchio', None)
    with pytest.raises(UrdfError, match='need pin: pip install -r requirements-robot.txt'):
        UrdfChain(TEXT)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, len(TEXT) - 1), st.integers(0, 30), st.binary(max_size=10))
def test_damaged_files_are_read_or_refused(pinocchio_or_none, at, length, other):
    raw = TEXT.encode()
    damaged = raw[:at] + other + raw[at + length :]
    try:
        check_urdf(damaged)
        if pinocchio_or_none:
            UrdfChain(damaged)
    except UrdfError as e:
        assert str(e)


@pytest.fixture(scope='module')
def pinocchio_or_none():
    try:
        import pinocchio
    except ImportError:
        return None
    return pinocchio
