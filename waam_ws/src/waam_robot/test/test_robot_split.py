"""Motion split: the test cases and the table of the source, limits from both sides, invariants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.frames import inverse, pose_from_wpr, rotation
from waam_robot.positioner import Positioner
from waam_robot.split import (
    SplitLimits,
    chord_error,
    critical_radius,
    radius_error,
    split,
    tilt,
    turn_angle,
)

# table 2.2: X, Y, Z mm, W, P, R deg before; W = -J1, J2 deg after
TABLE = np.array(
    [
        (100.358, -4.530, 0.003, 19.953, 0.956, -89.576, 19.975, 267.416),
        (99.804, 5.455, 0.003, 19.698, 3.380, -96.297, 19.975, 273.129),
        (99.626, 8.660, 0.003, 19.368, 5.090, -98.056, 20.001, 274.968),
        (99.012, 14.024, 0.003, 18.829, 6.873, -100.186, 20.001, 278.062),
        (98.131, 19.245, 0.003, 18.215, 8.399, -101.765, 19.998, 281.096),
    ]
)
CELL = Positioner(a_b=1.1, d_bb=0.05, d_b=0.3, d_c=0.1)
LOOSE = SplitLimits(delta0=1.0, delta1=1e9, r_crit=1e-6)


def path(x, y, lean=0.0):
    """Tool poses over points (m) of the part, leaning inwards along the radius by `lean` (rad)."""
    x, y, lean = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float), lean)
    poses = rotation(2, np.arctan2(y, x)) @ rotation(1, -lean)
    poses[:, 0, 3], poses[:, 1, 3] = x, y
    return poses


def circle(radius=0.1, count=361, lean=0.0):
    a = np.linspace(0, 2 * np.pi, count)
    return path(radius * np.cos(a), radius * np.sin(a), lean)


def line(offset, direction, length=0.4, count=201, lean=0.0):
    """A line that passes the axis at `offset` (m) under `direction` (rad)."""
    s = np.linspace(-length / 2, length / 2, count)
    c, w = np.cos(direction), np.sin(direction)
    return path(s * c - offset * w, s * w + offset * c, lean)


def rebuilt(found, positioner):
    """(N, 4, 4): the part's poses from robot and positioner."""
    return positioner.to_part(found.robot, found.b, found.c)


def between(found, n, share, positioner):
    """(3,): the point of the part a share of the way from point n - 1 to n, robot and positioner moving evenly."""
    pose = np.eye(4)
    pose[:3, 3], b, c = (
        (1 - share) * v[n - 1] + share * v[n] for v in (found.robot[:, :3, 3], found.b, found.c)
    )
    return positioner.to_part(pose, b, c)[:3, 3]


def test_table_2_2():
    poses = pose_from_wpr(TABLE[:, :3] * 1e-3, np.radians(TABLE[:, 3:6]))
    found = split(poses)
    points, angles = found.program
    assert points * 1e3 == pytest.approx(TABLE[:, :3], abs=1e-9)
    assert np.degrees(angles[:, 0]) == pytest.approx(TABLE[:, 6], abs=1e-3)
    assert angles[:, 1] == pytest.approx(0)
    assert np.degrees(found.b) == pytest.approx(-TABLE[:, 6], abs=1e-3)
    assert np.degrees(found.c) == pytest.approx(TABLE[:, 7], abs=1e-3)
    assert found.turns.tolist() == [False, True, True, True, True]
    assert found.delta0[1] == pytest.approx(0.1248e-3, abs=5e-8)
    assert found.delta1[1] == pytest.approx(5.07e-3, abs=5e-6)
    # the source's upright torch leans up to 1.9 degrees off the torch that the program asked for
    assert np.degrees(found.leaning).max() == pytest.approx(1.926, abs=1e-3)


@pytest.mark.parametrize('lean', [0, 70])
def test_circles_about_the_axis_are_done_by_the_positioner(lean):
    found = split(circle(lean=np.radians(lean)), CELL)
    assert found.turns[1:].all()
    assert np.degrees(found.b) == pytest.approx(-lean)
    assert np.degrees(np.diff(found.c)) == pytest.approx(1.0)
    assert np.ptp(found.robot[:, :3, 3], axis=0).max() < 1e-12  # the robot stands still
    assert found.robot[:, :3, 2] == pytest.approx(
        np.broadcast_to([0, 0, 1], (361, 3))
    )  # gravity-down
    assert found.robot == pytest.approx(np.broadcast_to(found.robot[0], (361, 4, 4)), abs=1e-12)


def test_a_circle_while_b_goes_from_0_to_30_degrees():
    found = split(circle(lean=np.radians(np.linspace(0, 30, 361))), CELL)
    assert found.turns[1:].all()
    assert np.degrees(found.b) == pytest.approx(-np.linspace(0, 30, 361))
    assert found.robot[:, :3, 2] == pytest.approx(np.broadcast_to([0, 0, 1], (361, 3)))


@pytest.mark.parametrize('lean', [0, 70])
@pytest.mark.parametrize('degrees', [0, 30, 45, 90, 160])
def test_lines_past_the_axis(degrees, lean):
    limits = SplitLimits(delta0=0.2e-3, delta1=0.05, r_crit=10e-3)
    found = split(line(0.03, np.radians(degrees), lean=np.radians(lean)), CELL, limits)
    near = np.abs(np.linspace(-0.2, 0.2, 201)) < 0.01  # where the line is a tangent
    assert found.turns[near].all()
    swing = np.abs(np.diff(found.c))
    assert (swing[~found.turns[1:]] == 0).all()
    assert rebuilt(found, CELL)[:, :3, 2:] == pytest.approx(found.part[:, :3, 2:], abs=1e-12)


def test_a_line_through_the_axis_is_done_by_the_robot_alone():
    found = split(line(0.0, 0.7), CELL)
    assert np.ptp(found.c) < 1e-9
    assert np.isfinite(found.robot).all()
    inside = found.radius < 10e-3
    assert inside.any() and not found.turns[inside].any()


def pair(r0, r1, degrees):
    a = np.radians(degrees)
    return path([r0, r1 * np.cos(a)], [0, r1 * np.sin(a)])


@pytest.mark.parametrize(
    ('poses', 'limits'),
    [
        (pair(0.1, 0.1, 5.0), {'delta0': chord_error(np.array(0.1), np.radians(5.0))}),
        (pair(0.1, 0.104, 0.1), {'delta1': radius_error(np.array(0.1), np.array(0.104))}),
        (pair(0.03, 0.03, 0.1), {'r_crit': 0.03}),
    ],
    ids=['delta0', 'delta1', 'r_crit'],
)
def test_each_limit_from_both_sides(poses, limits):
    (name, value), loose = (
        next(iter(limits.items())),
        {'delta0': 1.0, 'delta1': 1.0, 'r_crit': 1e-6},
    )
    for factor, turns in ((1 + 1e-9, True), (1 - 1e-9, False)):
        bound = value / factor if name == 'r_crit' else value * factor
        found = split(poses, CELL, SplitLimits(**loose | {name: float(bound)}))
        assert found.turns[1] == turns


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_tool_stays_where_it_belongs_on_the_part(seed):
    rng = np.random.default_rng(seed)
    poses = pose_from_wpr(rng.uniform(-0.3, 0.3, (20, 3)), rng.uniform(-3, 3, (20, 3)))
    limits = SplitLimits(*10 ** rng.uniform([-5, -4, -3], [0, 1, -1]))
    found = split(poses, CELL, limits)
    again = rebuilt(found, CELL)
    assert again[:, :3, 2:] == pytest.approx(poses[:, :3, 2:], abs=1e-9)
    assert np.linalg.det(found.robot[:, :3, :3]) == pytest.approx(1.0)
    allowed = (
        (found.delta0 <= limits.delta0)
        & (found.delta1 <= limits.delta1)
        & (found.radius >= limits.r_crit)
    )
    assert (found.turns[1:] == allowed[1:]).all()
    assert (np.diff(found.c)[~found.turns[1:]] == 0).all()
    assert CELL.to_part(CELL.to_robot(poses, 0.3, 0.4), 0.3, 0.4) == pytest.approx(poses, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.02, 0.3), st.floats(0.2, 10), st.floats(0, 1))
def test_delta0_bounds_how_far_coordinated_motion_leaves_the_chord(radius, degrees, share):
    poses = pair(radius, radius, degrees)
    found = split(poses, CELL, LOOSE)
    point = between(found, 1, share, CELL)
    a, b = poses[0, :3, 3], poses[1, :3, 3]
    way = (b - a) / np.linalg.norm(b - a)
    off = np.linalg.norm(np.cross(point - a, way))
    assert off <= found.delta0[1] * (1 + 1e-6) + 1e-12
    if share == 0.5:
        assert off == pytest.approx(found.delta0[1], rel=1e-6)


def test_without_a_turn_coordinated_motion_is_the_straight_line():
    poses = pair(0.1, 0.12, 30)
    found = split(poses, CELL, SplitLimits(delta0=1e-9))
    middle = between(found, 1, 0.5, CELL)
    assert middle == pytest.approx(poses[:, :3, 3].mean(axis=0), abs=1e-12)


def test_critical_radius_in_consistent_units():
    turn = np.radians(190)
    assert critical_radius(20e-3, turn) * 1e3 == pytest.approx(6.03, abs=0.01)
    assert critical_radius(30e-3, turn) * 1e3 == pytest.approx(9.05, abs=0.01)


def test_printed_forms_contradict_the_table():
    """S3 eq 2.6 with its printed sign moves the point away; the product of S3 eq 2.5 turns by B twice."""
    poses = circle(count=5)[:2]
    cell = Positioner()
    c = turn_angle(poses[:, :2, 3])
    azimuth = lambda p: np.degrees(np.arctan2(p[:, 1, 3], p[:, 0, 3])) % 360  # noqa: E731
    assert np.ptp(azimuth(cell.turned(poses, c))) == pytest.approx(0, abs=1e-9)
    printed = rotation(2, c) @ poses
    assert np.ptp(azimuth(printed)) == pytest.approx(180)
    b = tilt(path([0.1], [0.0], lean=0.3))
    leaning = path([-0.1], [0.0], lean=0.3)
    assert (inverse(cell.faceplate(b)) @ leaning)[0, 2, 2] == pytest.approx(
        1.0
    )  # upright after one B


@pytest.mark.parametrize('value', [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize('name', ['delta0', 'delta1', 'r_crit'])
def test_limits_are_positive(name, value):
    with pytest.raises(ValueError, match=name):
        SplitLimits(**{name: value})


def test_empty_and_single_paths():
    assert split(np.empty((0, 4, 4))).c.shape == (0,)
    one = split(circle(count=5)[:1])
    assert one.turns.tolist() == [False] and np.degrees(one.c) == pytest.approx(270)
