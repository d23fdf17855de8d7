"""What the drives may do: averaged paths stay inside it, and goals and plans say where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_node.params import ParameterError
from waam_robot.station import Station
from waam_robot_bridge.blend import averaged
from waam_robot_bridge.foresee import asked
from waam_robot_bridge.goals import GoalError, make
from waam_robot_bridge.limits import (
    JUMP,
    MAX_FILTER_MS,
    MIN_FILTER_MS,
    TORCH,
    Limits,
    of_axes,
    smoothing,
)
from waam_robot_bridge.params import RobotParams

AXES = ('a', 'b')


@pytest.fixture(scope='module')
def station():
    return Station()


def limits(push: float, jerk: float) -> Limits:
    return Limits(np.full(2, 9.0), np.full(2, push), np.full(2, jerk), names=AXES)


def test_gains_are_those_of_the_worst_place_in_the_box(station):
    """Random moves anywhere in the box never turn a joint farther, and come near to it."""
    rng = np.random.default_rng(2)
    low, high = np.array(station.place.low), np.array(station.place.high)
    tips, way = rng.uniform(low, high, (20_000, 3)), rng.normal(0, 1, (20_000, 3))
    way *= 1e-5 / np.linalg.norm(way, axis=1, keepdims=True)
    most = np.abs(station.joints(tips + way) - station.joints(tips)).max(axis=0) / 1e-5
    assert (most <= station.gains * 1.001 + 1e-6).all()
    assert (most[:3] > 0.75 * station.gains[:3]).all() and (station.gains[6:] == 0).all()


@settings(max_examples=60, deadline=None)
@given(st.floats(30, 400), st.floats(0.2, 1.0), st.floats(0.0, 1.0), st.floats(-1.0, 1.0))
def test_an_averaged_path_keeps_the_jerk(jerk, gain, jump, before):
    """A jump of velocity and of acceleration at one moment, as large as the core makes them."""
    gains, held = np.array([gain, gain / 2]), limits(100.0, jerk)
    try:
        smooth = smoothing(gains, held)
    except ParameterError:
        assert gain * (2 * TORCH / MAX_FILTER_MS * 1e3 + JUMP / MAX_FILTER_MS**2 * 1e6) > jerk
        return
    t = np.arange(-300, 300) * 1e-3
    after = before - 2 * np.sign(before or 1.0)  # from +-A to -+A at most
    push = TORCH * np.clip(np.where(t < 0, before, after), -1, 1)
    way = 0.01 * t + push * t**2 / 2 + JUMP * jump * np.maximum(t, 0)
    path = averaged(np.column_stack([way, way, way]), smooth)[:, :2] * gains
    inner = path[100:500]
    assert held.shares(inner, 1e-3)[:, 2].max() < 1.02
    assert MIN_FILTER_MS <= smooth <= MAX_FILTER_MS


def test_weaker_drives_are_refused_with_joint_and_value(station):
    usual = RobotParams()
    assert smoothing(station.gains, usual.limits_of_joints()) == 25
    weak = RobotParams(joint_jerk_max=(87.0, 20.0, *usual.joint_jerk_max[2:]))
    with pytest.raises(ParameterError, match="'joint_jerk_max': .* J2 needs 3[78]"):
        smoothing(station.gains, weak.limits_of_joints())
    slow = RobotParams(joint_acceleration_max=(8.7, 8.7, 1.0, *usual.joint_acceleration_max[3:]))
    with pytest.raises(
        ParameterError, match=r"'joint_acceleration_max': .* J3 needs 1\.\d+ rad/s\^2"
    ):
        smoothing(station.gains, slow.limits_of_joints())


def test_axes_are_where_servos_of_this_lag_would_be():
    """Against the differential equation, solved in steps of 10 us."""
    dt, lag = 0.01, 0.02
    t = np.arange(0, 0.6, dt)
    joints = np.column_stack([0.3 * np.sin(5 * t), 0.1 * t**2])
    rates = np.column_stack([1.5 * np.cos(5 * t), 0.2 * t])
    found = of_axes(joints, rates, dt, lag)
    y, out = found[0].copy(), []
    for n in range(round(0.59 / 1e-5) + 1):
        if n % 500 == 0:
            out.append(y.copy())
        now = n * 1e-5
        y += 1e-5 / lag * (np.array([0.3 * np.sin(5 * now), 0.1 * now**2]) - y)
    assert np.abs(found - np.array(out)[: len(found)]).max() < 3e-5
    assert np.array_equal(of_axes(joints, rates, dt, 0.0)[::2], joints)


@pytest.mark.parametrize(
    ('speed', 'said'),
    [(0.05, ''), (0.25, 'accelerate at'), (4.0, 'times its fastest')],
)
def test_a_goal_beyond_a_limit_is_none(station, speed, said):
    """From rest to a speed within 60 ms; what stops the robot afterwards is never refused."""
    ms = np.arange(300)
    way = np.minimum(speed * np.cumsum(np.clip((ms - 60) / 60, 0, 1)) * 1e-3, 0.25)
    tips = np.array([0.1, 0.1, 0.1]) + way[:, None] * [1.0, 0.0, 0.0]
    weak = RobotParams(joint_acceleration_max=(2.0,) * 8, joint_jerk_max=(1e4,) * 8)
    joints = station.joints(tips[:1])[0]
    args = (station, tips[:41], tips[41:], 10, 0, joints, weak.limits_of_joints(), 0.0)
    if said:
        with pytest.raises(GoalError, match=rf'J\d would .*{said}'):
            make(*args, 200)
    else:
        make(*args, 200)
    if said == 'accelerate at':
        make(*args, 0)


def test_a_way_with_too_much_jerk_is_told_with_its_place(station):
    """Back at once, at 0.1 m/s: no path of the core does that."""
    speed = 0.1 * np.clip(np.arange(600) / 200, 0, 1)  # m/s
    way = np.cumsum(np.concatenate([speed, -speed[::-1]])) * 1e-3
    tips = np.array([0.1, 0.1, 0.1]) + way[:, None] * [1.0, 0.0, 0.0]
    found = asked(tips, station, RobotParams())
    said = found.too_much(tips, (0.1, 0.1, 0.1))
    assert 'its limit of jerk' in said and said.startswith('at (47.')  # turns at 50 mm
    assert found.most[0].max() < 0.2 and found.most[1].max() < 1 < found.most[2].max()
    slow = np.array([0.1, 0.1, 0.1]) + np.arange(800)[:, None] * [1e-5, 0.0, 0.0]
    assert asked(slow, station, RobotParams()).too_much(slow, (0.0, 0.0, 0.0)) == ''
