"""The positioner tilts the part: a level box before the tilted faceplate, out of the arm's way."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.plate_clearance import PlateClearance
from waam_robot.station import Place, Station, StationError
from waam_robot.tilt import tilted

DEG = np.pi / 180


@cache
def station(degrees: float) -> Station:
    return Station(Place(tilt=degrees * DEG))


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from((45.0, 80.0, 90.0)),
    st.tuples(st.floats(0, 0.4), st.floats(0, 0.3), st.floats(0, 0.2)),
)
def test_there_and_back_upright_at_a_tilt(degrees, tip):
    made = station(degrees)
    joints = made.joints(np.array([tip]))
    frame = made.frames(joints)[0]
    assert np.abs(frame[:3, 3] - tip).max() < 1e-9
    assert np.abs(frame[:3, :3] - np.eye(3)).max() < 1e-9
    assert joints[0, 6] == pytest.approx(degrees * DEG)


def test_a_tilt_that_is_off_shows_in_the_part():
    made, tip = station(80.0), np.array([[0.1, 0.1, 0.05]])
    joints = made.joints(tip)
    joints[0, 6] += 1e-3
    off = made.tips(joints)[0] - tip[0]
    assert 1e-4 < np.linalg.norm(off) < 6e-4 and abs(off[1]) < 1e-9  # the lever is some 0.3 m


def test_what_leans_to_x_stands_upright_at_its_tilt():
    lean = 80 * DEG
    wall = np.array([np.sin(lean), 0.3, np.cos(lean)])
    assert tilted(wall, lean) == pytest.approx([0.0, 0.3, 1.0])


def test_points_on_the_faceplate_are_carried_by_the_tilt():
    made, points = station(90.0), np.array([[0.1, 0.08, 0.02], [0.15, 0.08, 0.05]])
    there = made.carried(points)
    assert there[1] - there[0] == pytest.approx(tilted(points[1] - points[0], np.pi / 2))
    # by the axes of the positioner: on the plate (-0.1, -0.07, 0.02) m from its centre, tilt axis 0.15 m below it
    p = made.place
    base = np.array([p.positioner.a_b - 0.17, -0.07, p.positioner.d_b - 0.1])
    seen = made.poses(there[:1])[0, :3, 3]
    assert seen == pytest.approx(base)
    assert station(0.0).carried(points) == pytest.approx(points)


@pytest.mark.parametrize('degrees', [45.0, 80.0, 90.0])
def test_the_arm_keeps_away_from_the_tilted_faceplate(degrees):
    made = station(degrees)
    grid = np.stack(np.meshgrid([0.05, 0.2, 0.3], [0.05, 0.25], [0.02, 0.15]), -1).reshape(-1, 3)
    clear = PlateClearance(made.place.arm, made.place.positioner, made.place.tilt)
    assert clear.of(made.joints(grid)) > 0.02


def test_more_than_the_positioner_tilts_is_refused():
    with pytest.raises(StationError, match='a tilt of 120.0 deg: at most 100'):
        Station(Place(tilt=120 * DEG))
