"""The cell's box before the robot: one branch and spin for all of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.station import Place, Station, StationError

STATION = Station()


@settings(max_examples=60, deadline=None)
@given(st.tuples(st.floats(0, 0.4), st.floats(0, 0.3), st.floats(0, 0.2)))
def test_there_and_back(tip):
    joints = STATION.joints(np.array([tip]))
    assert np.abs(STATION.tips(joints)[0] - tip).max() < 1e-9
    frame = STATION.frames(joints)[0]
    assert np.abs(frame[:3, :3] - np.eye(3)).max() < 1e-9  # upright, turned as the machine
    assert np.array_equal(joints[0, 6:], STATION.hold)


def test_nothing_flips_inside_the_box():
    rng = np.random.default_rng(4)
    for _ in range(20):
        a, b = rng.uniform((0, 0, 0), STATION.place.high, (2, 3))
        joints = STATION.joints(np.linspace(a, b, 200))
        assert np.abs(np.diff(joints, axis=0)).max() < 0.02


@pytest.mark.parametrize(
    ('place', 'said'),
    [
        (Place(origin=(0.9, -0.15, 0.0)), 'does not reach'),
        (Place(origin=(-1.5, -0.15, 0.0)), 'does not reach'),
        (Place(low=(0.1, 0.0, 0.0), high=(0.1, 0.3, 0.2)), 'empty'),
    ],
)
def test_a_box_that_cannot_be_used_says_where(place, said):
    with pytest.raises(StationError, match=said):
        Station(place)


def test_beside_the_reach():
    with pytest.raises(StationError, match='out of reach'):
        STATION.joints(np.array([[3.0, 0.0, 0.0]]))
