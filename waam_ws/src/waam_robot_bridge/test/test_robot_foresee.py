"""Where the speed cannot be held, by the positions that a controller commands."""

from __future__ import annotations

import numpy as np
import pytest

from waam_robot.station import Station
from waam_robot_bridge.foresee import END, START, STEP, Bead, places
from waam_robot_bridge.params import RobotParams

SPEED = 10e-3  # m/s


@pytest.fixture(scope='module')
def station():
    return Station()


def bead(
    corners: list[tuple[float, float, float]], speeds: list[float] | None = None, dip: float = 0.0
) -> Bead:
    """The torch along the corners (mm) at the programmed speed; within 1 mm of an inner one slower by `dip`."""
    points = np.array(corners) * 1e-3 + [0.05, 0.05, 0.02]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    wanted = np.array(speeds or [SPEED] * len(lengths))
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    at = [0.0]
    while at[-1] < way[-1]:
        piece = int(np.clip(np.searchsorted(way, at[-1], 'right') - 1, 0, len(lengths) - 1))
        near = np.abs(way[1:-1] - at[-1]).min(initial=1.0) < 1e-3
        at.append(at[-1] + wanted[piece] * (1 - dip * near) * 1e-3)
    at = [0.0] * 100 + at + [way[-1]] * 100
    tips = np.column_stack([np.interp(at, way, points[:, n]) for n in range(3)])
    return Bead(points, wanted, tips, np.arange(1, len(lengths) + 1), layer=3)


def test_a_straight_bead_is_off_at_its_ends_only(station):
    found = places(bead([(0, 0, 0), (60, 0, 0)]), station, RobotParams())
    assert {p.cause for p in found} <= {START, END}
    assert all(p.end - p.begin < 0.6e-3 for p in found)


def test_a_corner_that_a_curve_takes_is_not_told(station):
    """A right angle as the core takes it: it is slower there, the curve is not."""
    slower = bead([(0, 0, 0), (40, 0, 0), (40, 40, 0)], dip=0.0)
    found = [p for p in places(slower, station, RobotParams()) if p.cause not in (START, END)]
    assert found == []


@pytest.mark.parametrize(
    ('corners', 'said'),
    [
        ([(0, 0, 0), (40, 0, 0), (3, 8, 0)], 'a corner of 168 deg: curves turn by 125 deg at most'),
        ([(0, 0, 0), (30, 0, 0), (30, 20, 8)], 'a corner of 90 deg that climbs'),
        ([(0, 0, 0), (30, 0, 0), (30, 1, 0), (60, 1, 0)], 'leg of 1.0 mm, too short for a curve'),
    ],
)
def test_a_corner_without_a_curve_is_told_with_its_place(station, corners, said):
    found = places(bead(corners, dip=0.4), station, RobotParams())
    inner = [p for p in found if p.cause not in (START, END)]
    assert inner and said in inner[0].cause
    corner = np.array(corners[1]) * 1e-3 + [0.05, 0.05, 0.02]
    assert np.linalg.norm(inner[0].at - corner) < 1.3e-3
    assert inner[0].bead in (1, 2) and inner[0].layer == 3
    assert 'mm/s instead of 10.00' in inner[0].text


def test_a_step_of_the_programmed_speed_is_told(station):
    late = bead([(0, 0, 0), (30, 0, 0), (60, 0, 0)], [8e-3, 12e-3])
    inner = [p for p in places(late, station, RobotParams()) if p.cause not in (START, END)]
    assert [p.cause for p in inner] == [STEP]
    assert abs(inner[0].end) < 1e-3 or abs(inner[0].begin - 30e-3) < 1e-3


def test_a_joint_that_is_too_slow_is_named_and_stops_the_job(station):
    speeds = (3.5, 3.5, 0.002, 7.2, 7.2, 15.0, 2.0, 3.3)
    found = places(bead([(0, 0, 0), (60, 0, 0)]), station, RobotParams(joint_speed_max=speeds))
    assert any(p.stops and 'J3 would have to turn at' in p.text for p in found)
    assert any('the job would be held there' in p.text for p in found)


def test_what_a_joint_can_is_told_by_toppra(station):
    """J3 turns at 1.5 times its fastest: two thirds of the speed are possible there, less the reserve of the timing."""
    pytest.importorskip('toppra', reason='requirements-robot.txt is not installed')
    straight = bead([(0, 0, 0), (60, 0, 0)])
    rates = np.abs(np.diff(station.joints(straight.tips[::100]), axis=0)).max(axis=0) / 0.1
    usual = RobotParams().joint_speed_max
    weak = RobotParams(joint_speed_max=(*usual[:2], float(rates[2]) / 1.5, *usual[3:]))
    stopping = [p for p in places(straight, station, weak) if p.stops]
    assert stopping and SPEED * 0.5 < min(p.possible for p in stopping) < SPEED / 1.4
    assert 'mm/s is possible' in stopping[0].text


def test_too_short_to_say_anything(station):
    short = bead([(0, 0, 0), (1, 0, 0)])
    tips = short.tips[:50]
    assert (
        places(Bead(short.corners, short.speeds, tips, short.numbers), station, RobotParams()) == []
    )
