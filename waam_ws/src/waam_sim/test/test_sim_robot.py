"""The simulated robot: exact without errors, late as stated, and off as stated with them."""

from dataclasses import replace

import numpy as np
import pytest

from waam_robot.station import Station
from waam_sim.robot import RobotParams, SimRobot

STATION = Station()
START, TAUGHT = np.array([0.06, 0.05, 0.15]), np.array([0.1, 0.08, 0.02])
EXACT = RobotParams(joint_offset=0.0, gear_wave=0.0, axis_offset=0.0, link_length=0.0, backlash=0.0)


def robot(params: RobotParams, start: np.ndarray = START) -> SimRobot:
    return SimRobot(STATION, params, 3, start, TAUGHT, 0)


def line(made: SimRobot, start: np.ndarray, way: np.ndarray, seconds: float) -> np.ndarray:
    """(n, 3): where the torch truly is in every ms along a straight line at constant speed."""
    time = np.arange(0, seconds + 1e-9, 0.01)
    tips = start + np.outer(time / seconds, way)
    joints = STATION.joints(tips)
    made.follow(made.time_us, time, joints, np.gradient(joints, 0.01, axis=0))
    return np.concatenate([made.advance(10)[0] for _ in range(round(seconds * 100))])


def test_an_exact_robot_is_as_late_as_its_servos():
    way = np.array([0.02, 0.01, 0.0])
    tips = line(robot(EXACT), START, way, 2.0)
    late = (np.linalg.norm(START + way / 2 - tips[999]) / np.linalg.norm(way)) * 2.0
    assert late == pytest.approx(EXACT.servo_lag, abs=2e-3)
    across = np.linalg.norm(np.cross(tips - START, way), axis=1) / np.linalg.norm(way)
    assert across.max() < 2e-6


def test_errors_are_none_where_the_robot_was_taught_and_grow_away_from_there():
    made = robot(RobotParams(backlash=0.0), TAUGHT)
    assert np.abs(made.tip - TAUGHT).max() < 1e-12 and np.abs(made.scanner).max() < 1e-12
    far = robot(RobotParams(backlash=0.0), TAUGHT + [0.2, 0.15, 0.1])
    miss = np.linalg.norm(far.tip - (TAUGHT + [0.2, 0.15, 0.1]))
    assert 2e-5 < miss < 2e-3


def test_backlash_shows_where_the_direction_turns():
    tight, loose = robot(EXACT), robot(replace(EXACT, backlash=3e-4))
    way = np.array([0.0, 0.02, 0.0])
    for made in (tight, loose):
        line(made, START, way, 1.0)
    there = [line(made, START + way, -way, 1.0) for made in (tight, loose)]
    lost = np.linalg.norm(there[1] - there[0], axis=1)
    assert lost[500:].min() > 1e-4  # about 1.2 m from joint 1


def test_latency_comes_before_a_new_goal():
    made = robot(replace(EXACT, latency=0.05))
    tips = line(made, START, np.array([0.02, 0.0, 0.0]), 0.2)
    assert np.abs(tips[39] - START).max() < 1e-9
    assert tips[-1, 0] - START[0] > 0.01


def test_a_dead_driver_stands_and_tells_nothing():
    made = robot(EXACT)
    line(made, START, np.array([0.02, 0.0, 0.0]), 0.2)
    made.dead = True
    told, tip = made.state()[0], made.tip
    made.advance(100)
    assert made.state()[0] == told and np.array_equal(made.tip, tip)
