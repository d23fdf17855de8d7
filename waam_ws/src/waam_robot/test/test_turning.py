"""The part turned by the positioner while the torch goes: the same place on the part, an arm away from its limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_robot import turn_choice
from waam_robot.station import Place, Station, StationError
from waam_robot.turn_choice import choose
from waam_robot.turning import Turning

TURNING = Turning(0.3, (1.5, -2.0))
LONG = Place(origin=(-0.9, -0.06, 0.0), low=(0.0, 0.0, 0.0), high=(1.8, 0.12, 0.1))


@pytest.fixture
def few(monkeypatch) -> None:
    """Not so many turnings are tried."""
    monkeypatch.setattr(turn_choice, 'OVER', np.radians([-30.0, 0.0, 30.0]))
    monkeypatch.setattr(turn_choice, 'STARTS', np.radians([-90.0, 0.0, 90.0]))


@pytest.fixture(scope='module')
def turned() -> Station:
    return Station(Place(turning=TURNING))


def test_the_torch_is_where_it_is_wanted_and_the_part_turns_with_it(turned):
    tips = np.random.default_rng(3).uniform((0, 0, 0), (0.4, 0.3, 0.2), (50, 3))
    joints = turned.joints(tips)
    wanted = 0.3 + (tips[:, :2] - [0.2, 0.15]) @ [1.5, -2.0] - np.pi / 2
    assert joints[:, 7] == pytest.approx(wanted, abs=1e-12) and not joints[:, 6].any()
    frames = turned.frames(joints)
    assert np.abs(frames[:, :3, 3] - tips).max() < 1e-9
    assert (
        np.abs(frames[:, :3, :3] - np.eye(3)).max() < 1e-9
    )  # so the scanner looks where it does on the gantry


def test_joints_go_on_evenly_along_a_line(turned):
    tips = np.linspace([0.0, 0.0, 0.02], [0.4, 0.3, 0.02], 400)
    moved = np.diff(turned.joints(tips), axis=0)
    assert np.abs(np.diff(moved, axis=0)).max() < 1e-3
    assert (
        np.abs(moved) <= turned.gains * np.linalg.norm(np.diff(tips, axis=0), axis=1)[:, None] * 1.1
    ).all()


def test_a_part_that_turns_by_nothing_is_one_at_rest(turned):
    tips = np.array([[0.1, 0.1, 0.05]])
    still = Station(Place(turning=Turning()))
    assert np.array_equal(still.joints(tips), Station().joints(tips))
    assert not np.allclose(turned.joints(tips), still.joints(tips))


def test_a_long_part_is_served_only_when_it_turns(few):
    with pytest.raises(StationError, match='does not reach all of its box'):
        Station(LONG)
    found = choose(LONG, np.array(LONG.low), np.array(LONG.high))
    assert found.still is None and not found.turning.still
    assert 'at rest it cannot be reached' in found.text
    station = Station(replace(LONG, turning=found.turning))
    assert station.tips(station.joints(np.array([[1.8, 0.0, 0.1]])))[0] == pytest.approx(
        (1.8, 0.0, 0.1)
    )


def test_what_is_chosen_is_better_than_standing_still(few):
    place = Place()
    found = choose(place, np.array([0.05, 0.05, 0.0]), np.array([0.15, 0.12, 0.05]))
    assert found.still is not None
    assert found.turning.still or found.way.cost < found.still.cost
    Station(replace(place, turning=found.turning))  # serves the whole box


def test_nothing_serves_a_box_out_of_reach(few):
    with pytest.raises(StationError, match='however the part is turned'):
        choose(replace(LONG, high=(9.0, 0.12, 0.1)), np.zeros(3), np.array([9.0, 0.12, 0.1]))


def test_a_tilted_part_does_not_turn():
    with pytest.raises(StationError, match='would not stay level'):
        Station(Place(tilt=0.5, turning=TURNING))
