"""The source's arm: forward and inverse, branches, limits, ways to count angles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.arm import (
    M20IB25,
    ArmError,
    Link,
    forward,
    in_limits,
    limit_text,
    link_frames,
)
from waam_robot.frames import inverse, pose_from_wpr, rotation, wpr
from waam_robot.inverse import BRANCHES, choose, nearest_turns, solve, unreachable_text
from waam_robot.joints import DH, Counting

ANGLE = st.floats(-math.pi, math.pi)
ANGLES = st.tuples(*[ANGLE] * 6).map(np.array)
PENDANT = Counting('vertical', coupled=True)
COUNTINGS = [Counting(zero, coupled) for zero in ('dh', 'vertical') for coupled in (False, True)]
FORWARD = [  # angles, flange and tool of the source's arm in mm
    ((0, 0, 0, 0, 0, 0), (1100, 0, -315), (1390, 0, -405)),
    ((0, 90, 0, 0, 0, 0), (1040, 0, 1675), (1130, 0, 1965)),
    ((30, 60, -20, 40, 50, 60), (1117.291, 588.210, 836.739), (1211.277, 299.969, 853.587)),
]


def alike(angles, others, tolerance=1e-6):
    """The same but for whole turns."""
    return np.abs(np.exp(1j * np.asarray(angles)) - np.exp(1j * np.asarray(others))) < tolerance


@pytest.mark.parametrize(('angles', 'flange', 'tool'), FORWARD)
def test_forward_gives_the_values_of_the_source(angles, flange, tool):
    theta = np.radians(angles)
    assert forward(M20IB25, theta, tool=False)[:3, 3] * 1e3 == pytest.approx(flange, abs=1e-3)
    assert forward(M20IB25, theta)[:3, 3] * 1e3 == pytest.approx(tool, abs=1e-3)


@pytest.mark.parametrize(
    ('degrees', 'end'), [(0, (75, 0, 0)), (45, (53.033, 53.033, 0)), (90, (0, 75, 0))]
)
def test_table_3_4_end_of_the_first_link(degrees, end):
    low = replace(M20IB25, links=(replace(M20IB25.links[0], d=0.0), *M20IB25.links[1:]))
    theta = np.array([np.radians(degrees), 0, 0, 0, 0, 0])
    assert link_frames(low, theta)[1, :3, 3] * 1e3 == pytest.approx(end, abs=1e-3)


@settings(max_examples=150, deadline=None)
@given(ANGLES)
def test_every_branch_leads_to_the_pose_and_one_is_where_it_came_from(theta):
    pose = forward(M20IB25, theta)
    found = solve(M20IB25, pose[None])
    branches = found.theta[0][found.reachable[0]]
    assert len(branches) in (4, 8)
    assert np.abs(forward(M20IB25, branches) - pose).max() < 1e-9
    # at the three singularities the pose leaves an angle free, or loses half of its digits
    elbow = np.sin(theta[2] + np.arctan2(0.12, 0.865) + np.pi / 2)
    reach = np.hypot(*forward(M20IB25, theta, tool=False)[:2, 3] - 0.1 * pose[:2, 2])
    if min(abs(elbow), abs(np.sin(theta[4])), reach) > 1e-3:
        assert alike(branches, theta, 1e-6).all(axis=1).any()


def test_wanted_accuracy_holds_for_many_poses_in_all_branches():
    theta = np.random.default_rng(5).uniform(-np.pi, np.pi, (3000, 6))
    poses = forward(M20IB25, theta)
    found = solve(M20IB25, poses)
    for branch in range(BRANCHES):
        there = found.reachable[:, branch]
        assert there.mean() > 0.8
        off = forward(M20IB25, found.theta[there, branch]) - poses[there]
        assert np.abs(off).max() < 1e-12
    assert np.isnan(found.theta[~found.reachable]).all()


def test_branches_are_shoulder_elbow_and_wrist():
    pose = forward(M20IB25, np.radians([20, 70, -30, 10, 60, 40]))
    theta = solve(M20IB25, pose[None]).theta[0]
    assert alike(theta[4:, 0], theta[:4, 0] + np.pi).all()  # the other shoulder
    assert (theta[:2, 1] > theta[2:4, 1]).all()  # elbow up, elbow down
    assert theta[1::2, 4] == pytest.approx(-theta[::2, 4])  # the other wrist
    assert alike(theta[1::2, 3], theta[::2, 3] + np.pi).all()


@pytest.mark.parametrize('theta5', [0.0, 1e-13, 1e-9, -1e-7, math.pi])
def test_a_stretched_wrist_keeps_the_pose(theta5):
    pose = forward(M20IB25, np.array([0.3, 1.0, -0.2, 0.7, theta5, 0.4]))
    found = solve(M20IB25, pose[None], theta4=0.25)
    assert np.abs(forward(M20IB25, found.theta[0]) - pose).max() < 1e-9


@pytest.mark.parametrize('stretch', [1.0, 1 - 1e-13])
def test_full_stretch_is_still_in_reach(stretch):
    straight = np.array([0.2, 0.6, np.pi / 2 - np.arctan2(0.12, 0.865), 0.1, 0.5, 0.3])
    pose = forward(M20IB25, straight)
    centre = link_frames(M20IB25, straight)[1, :3, 3]
    pose[:3, 3] = pose[:3, 3] - (1 - stretch) * (pose[:3, 3] - centre)
    found = solve(M20IB25, pose[None])
    assert found.reachable[0, :4].all()
    assert np.abs(forward(M20IB25, found.theta[0, :4]) - pose).max() < 1e-6


def test_wrist_on_the_axis_of_joint_1_and_on_joint_2():
    up = rotation(2, 0.4)
    on_axis, on_joint = up.copy(), up.copy()
    on_axis[:3, 3] = (0, 0, 2.0 + 0.1)
    on_joint[:3, 3] = (0.075, 0, 0.650 + 0.1)
    arm = replace(M20IB25, tool=np.eye(4))
    found = solve(arm, np.stack([on_axis, on_joint]))
    assert found.reachable[0].all()
    assert np.abs(forward(arm, found.theta[0]) - on_axis).max() < 1e-9
    assert not found.reachable[1, :4].any()
    assert 'too near to' in unreachable_text(arm, found, 1)


def test_out_of_reach_says_what_and_where():
    far = pose_from_wpr(np.array([3.0, 0, 0]), np.zeros(3))
    found = solve(M20IB25, far[None])
    assert not found.any[0] and found.stretch[0, 0] > 1
    text = unreachable_text(M20IB25, found, 0)
    assert 'out of reach' in text and '(2710.0, 0.0, -190.0) mm' in text
    assert 'too far from it' in text and '31.7 to 1778.3 mm' in text
    with pytest.raises(ArmError, match='pose 0: out of reach'):
        choose(M20IB25, found, 0, np.zeros(6))


def test_the_branch_next_to_a_state_is_taken_and_limits_are_told():
    theta = np.radians([20, 70, -30, 190, 60, 250])  # joints 4 and 6 beyond half a turn
    found = solve(M20IB25, forward(M20IB25, theta)[None])
    assert choose(M20IB25, found, 0, theta + 0.1)[1] == pytest.approx(theta)
    narrow = replace(M20IB25, low=(0.5, *M20IB25.low[1:]), high=(0.6, *M20IB25.high[1:]))
    with pytest.raises(ArmError, match=r'branch 0: theta1 is 20.0 deg, its range 28.6 to 34.4'):
        choose(narrow, found, 0, theta)


def test_the_forearm_has_a_range_of_its_own():
    theta = np.radians([0, 170, 130, 0, 0, 0])
    assert not in_limits(M20IB25, theta) and 'theta2 + theta3 is 300.0 deg' in limit_text(
        M20IB25, theta
    )
    assert in_limits(replace(M20IB25, forearm=(-9.0, 9.0)), theta)


@given(ANGLES, ANGLES)
def test_turns_added_stay_the_same_place_and_inside_limits_where_they_can(theta, reference):
    near = nearest_turns(M20IB25, theta, reference)
    assert alike(near, theta).all()
    low, high = np.array(M20IB25.low), np.array(M20IB25.high)
    possible = np.any(
        [(theta + t >= low) & (theta + t <= high) for t in (-2 * np.pi, 0, 2 * np.pi)], axis=0
    )
    slack = 1e-9
    assert ((near >= low - slack) & (near <= high + slack))[possible].all()


@given(ANGLES, st.sampled_from(COUNTINGS))
def test_countings_are_inverses(theta, counting):
    assert counting.from_dh(counting.to_dh(theta)) == pytest.approx(theta, abs=1e-12)


def test_both_zeros_and_the_coupling():
    upright = np.radians([0, 90, 0, 0, 0, 0])  # DH: upper arm upright, forearm horizontal
    assert PENDANT.from_dh(upright) == pytest.approx(np.zeros(6))
    leaning = PENDANT.to_dh(
        np.radians([0, 30, 0, 0, 0, 0])
    )  # J2 forwards: the forearm stays horizontal
    assert np.degrees(leaning[:3]) == pytest.approx([0, 60, 30])
    assert np.degrees(leaning[1] + leaning[2]) == pytest.approx(90)
    serial = Counting('vertical').to_dh(np.radians([0, 30, 0, 0, 0, 0]))
    assert np.degrees(serial[:3]) == pytest.approx([0, 60, 0])
    assert Counting('dh', True).from_dh(upright)[2] == pytest.approx(np.pi / 2)  # theta2 + theta3
    assert DH.to_dh(upright) == pytest.approx(upright)
    with pytest.raises(ValueError, match="zero 'up': known are dh, vertical"):
        Counting('up')


@pytest.mark.parametrize(
    ('number', 'link', 'said'),
    [
        (1, Link(0.05, 0.905, 0.0), r'wants d2 = 0, not 0.05 m'),
        (4, Link(0, 0.03, np.pi / 2), r'wants a5 = 0, not 0.03 m'),
        (2, Link(0, 0.12, 0.3), r'wants alpha3 = 90 deg, not 17.189'),
        (1, Link(0, 0.0, 0.0), r'a2 and \(a3, d4\) have to be longer'),
    ],
)
def test_an_arm_without_an_analytic_inverse_is_refused_by_what_it_has(number, link, said):
    links = list(M20IB25.links)
    links[number] = link
    with pytest.raises(ArmError, match=said):
        solve(replace(M20IB25, links=tuple(links)), np.eye(4)[None])


def test_senseless_arms_and_poses_are_refused():
    with pytest.raises(ArmError, match='limits of joint 1'):
        replace(M20IB25, low=(4.0, *M20IB25.low[1:]))
    with pytest.raises(ArmError, match='not a finite number'):
        replace(M20IB25, links=(Link(np.nan), *M20IB25.links[1:]))
    with pytest.raises(ArmError, match='six|6 links'):
        replace(M20IB25, links=M20IB25.links[:5])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, 0, 0] = -1.0
    with pytest.raises(ValueError, match='pose 1: no rotation'):
        solve(M20IB25, poses)
    poses[1, 0, 0] = np.inf
    with pytest.raises(ValueError, match='pose 1: a number that is not finite'):
        solve(M20IB25, poses)
    with pytest.raises(ValueError, match='wanted'):
        solve(M20IB25, np.eye(4))


def test_no_pose_gives_no_solution():
    found = solve(M20IB25, np.empty((0, 4, 4)))
    assert found.theta.shape == (0, 8, 6) and found.any.shape == (0,)


@given(st.tuples(ANGLE, st.floats(-np.pi / 2, np.pi / 2), ANGLE).map(np.array))
def test_wpr_is_a_way_to_write_a_rotation(angles):
    pose = pose_from_wpr(np.array([1.0, 2.0, 3.0]), angles)
    again = pose_from_wpr(pose[:3, 3], wpr(pose))
    assert again == pytest.approx(
        pose, abs=2e-8
    )  # at P = 90 degrees W and R turn about the same axis
    assert inverse(pose) @ pose == pytest.approx(np.eye(4), abs=1e-12)


@pytest.mark.parametrize('p', [90, -90])
def test_at_p_of_90_degrees_r_is_zero(p):
    pose = pose_from_wpr(np.zeros(3), np.radians([20, p, 50]))
    w, _, r = wpr(pose)
    assert r == 0.0
    assert pose_from_wpr(np.zeros(3), wpr(pose)) == pytest.approx(pose, abs=1e-9)
