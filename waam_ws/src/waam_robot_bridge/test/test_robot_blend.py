"""Corners of a commanded path: the speed and the tolerance are kept, elsewhere nothing bends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot_bridge.blend import MAX_LEG_MS, blended, corners, shape

SPEED, STEP = 10e-6, 3.125e-6  # m/ms, m of an axis
HALF = 400  # ms


def commanded(
    turn: float, heading: float = 0.3, height: float = 0.0, dip: float = 0.5
) -> np.ndarray:
    """(2 HALF, 3) m: two legs as the core commands them, in whole steps, slower around the corner."""
    speed = np.full(2 * HALF, SPEED)
    slow = SPEED * dip * np.linspace(1.0, 0.0, 10)
    speed[HALF : HALF + 10] -= slow
    speed[HALF - 10 : HALF] -= slow[::-1]
    way = np.where(np.arange(2 * HALF) < HALF, heading, heading + turn)
    flat = np.cumsum(speed[:, None] * np.column_stack([np.cos(way), np.sin(way)]), axis=0)
    rise = np.linspace(0.0, height, 2 * HALF)
    return np.round(np.column_stack([flat, rise]) / STEP) * STEP


def speeds(path: np.ndarray) -> np.ndarray:
    """Share of SPEED over 50 ms."""
    steps = np.linalg.norm(np.diff(path[::10], axis=0), axis=1) / (10 * SPEED)
    return np.convolve(steps, np.ones(5) / 5, 'valid')[5:-5]


@settings(max_examples=40, deadline=None)
@given(st.floats(20, 110), st.floats(0, 360), st.booleans(), st.floats(1e-4, 4e-4))
def test_a_corner_keeps_the_speed_and_the_tolerance(turn, heading, left, tolerance):
    turn = np.radians(turn) * (1 if left else -1)
    path = commanded(turn, np.radians(heading))
    found = blended(path, tolerance)
    near = slice(HALF - 120, HALF + 120)
    apart = np.linalg.norm(found[near, None, :2] - path[None, ::2, :2], axis=2).min(axis=1)
    assert apart.max() < tolerance + 2 * STEP + SPEED
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).max() < 1.2 * SPEED  # no jump
    assert np.abs(speeds(found) - 1).max() < 0.02
    assert np.abs(speeds(path) - 1).max() > 0.05  # as commanded, it is slower


def test_in_step_again_after_the_corner():
    path = commanded(np.pi / 2)
    found = blended(path, 2e-4)
    for part in (slice(20, HALF - MAX_LEG_MS - 30), slice(HALF + MAX_LEG_MS + 30, None)):
        assert np.abs(found[part] - path[part])[:-20].max() < 2 * STEP


@pytest.mark.parametrize('turn', [5.0, 150.0, 180.0])
def test_other_turns_stay_where_they_are(turn):
    path = commanded(np.radians(turn))
    assert corners(path) == []
    assert np.abs(blended(path, 2e-4) - path).max() < 8e-5


def test_a_path_that_climbs_stays_where_it_is():
    assert corners(commanded(np.pi / 2, height=1e-3)) == []


def test_a_curve_is_no_corner():
    t = np.arange(800) * SPEED / 3e-3
    path = np.column_stack([3e-3 * np.cos(t), 3e-3 * np.sin(t), 0 * t])
    assert corners(path) == []


def test_standing_and_short_paths():
    still = np.full((900, 3), 0.123)
    assert np.array_equal(blended(still, 2e-4), still)
    assert len(blended(commanded(1.0)[:50], 2e-4)) == 50


def test_longer_curves_swing_wider():
    found = [shape(1.5, ratio) for ratio in (1.0, 1.02, 1.05, 1.1)]
    assert np.all(np.diff(np.array(found), axis=0) > 0)
