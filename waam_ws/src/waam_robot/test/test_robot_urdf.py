"""Arms from a URDF: the same machine two ways, beads followed with external axes, files that are wrong."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.bead import make_bead
from waam_robot.joint_nodes import JUMP
from waam_robot.joint_path import Machine, PlanError, plan
from waam_robot.positioner import Positioner
from waam_robot.timing import Drives, part_pose
from waam_robot.urdf_arm import UrdfChain
from waam_robot.urdf_text import UrdfError, check_urdf, write_urdf

MACHINE = Machine(positioner=Positioner(a_b=1.2, d_bb=0.1, d_b=0.35, d_c=0.15))
TEXT = write_urdf(MACHINE, Drives().speed)


@pytest.fixture
def pinocchio():
    return pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')


def arc(lean=0.4):
    a = np.linspace(0, 0.6, 40)
    points = np.stack([0.15 * np.cos(a), 0.15 * np.sin(a), 0 * a], axis=1)
    out = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    return make_bead(points, [0, 0, np.cos(lean)] - np.sin(lean) * out, step=4e-3)


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
    assert chain.forward(joints) == pytest.approx(part_pose(joints, MACHINE), abs=1e-12)


@pytest.mark.parametrize('lean', [0.0, 0.4])
def test_a_bead_is_followed_with_the_torch_upright(pinocchio, lean):
    chain, bead = UrdfChain(TEXT), arc(lean)
    near = plan([bead], MACHINE)[0].joints[0] + 0.05
    found = chain.follow(bead, near)
    pose = chain.forward(found.joints)
    assert pose[:, :3, 3] == pytest.approx(bead.points, abs=1e-9)
    assert pose[:, :3, 2] == pytest.approx(bead.axes, abs=1e-9)
    assert found.off_flat < 1e-4 and found.margin > 0.3
    assert np.abs(np.diff(found.joints, axis=0)).max() < JUMP
    again = part_pose(found.joints, MACHINE)  # by the other kinematics
    assert again[:, :3, 3] == pytest.approx(bead.points, abs=1e-9)


def on_a_rail(text):
    """The arm on a linear axis of 2 m along x: nine joints."""
    rail = (
        '<link name="carriage"/><joint name="rail" type="prismatic"><parent link="world"/><child link="carriage"/>'
        '<axis xyz="1 0 0"/><limit lower="0" upper="2" velocity="1" effort="1"/></joint>'
    )
    first = '<parent link="world"/><child link="link1"/>'
    assert first in text
    return text.replace(first, first.replace('world', 'carriage')).replace(
        '</robot>', rail + '</robot>'
    )


def test_a_rail_in_the_chain_is_used_where_the_arm_alone_does_not_reach(pinocchio):
    away = Machine(positioner=Positioner(a_b=2.9, d_b=0.35, d_c=0.15, turn_zero=-np.pi / 2))
    bead = arc()
    with pytest.raises(PlanError, match='out of reach'):
        plan([bead], away)
    chain = UrdfChain(on_a_rail(write_urdf(away, Drives().speed)))
    assert len(chain.names) == 9 and 'rail' in chain.names
    found = chain.follow(make_bead(bead.points[:4], bead.axes[:4], step=4e-3))
    assert found.joints[0, chain.names.index('rail')] > 0.5
    pose = chain.forward(found.joints)
    assert pose[-1, :3, 3] == pytest.approx(bead.points[3], abs=1e-3)
    assert found.off_flat < 1e-3 and found.margin > 0


def test_a_start_is_found_and_of_several_the_one_far_from_limits(pinocchio):
    chain, bead = UrdfChain(TEXT), arc()
    short = make_bead(bead.points[:2], bead.axes[:2], step=4e-3)
    found = chain.follow(short)
    assert found.margin > 0.3
    assert (found.joints >= chain.low).all() and (found.joints <= chain.high).all()


def test_what_cannot_be_followed_is_named_with_its_place(pinocchio):
    chain = UrdfChain(TEXT)
    far = make_bead(np.array([[9.0, 0, 0], [9.0, 0.01, 0]]), step=5e-3)
    with pytest.raises(
        PlanError,
        match=r'0.0 mm from the start .* \(9000.0, 0.0, 0.0\) mm of the part: out of reach',
    ):
        chain.follow(far)
    away = make_bead(np.array([[0.15, 0, 0], [0.15, 0, 3.0]]), step=0.05)
    start = plan([make_bead(away.points[:2], step=0.02)], MACHINE)[0].joints[0]
    with pytest.raises(
        PlanError, match=r'mm from the start of the bead, at \(150.0, 0.0, .*: (out of|joint)'
    ):
        chain.follow(away, start)


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
