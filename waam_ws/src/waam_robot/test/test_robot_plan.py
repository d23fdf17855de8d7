"""Joint paths of whole parts: no flip inside a bead, flat where two axes can, refusals with their place; and timing."""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot import joint_path
from waam_robot.arm import M20IB25
from waam_robot.bead import make_bead
from waam_robot.frames import wrapped
from waam_robot.joint_nodes import JUMP, WRIST
from waam_robot.joint_path import Machine, PlanError, plan
from waam_robot.positioner import Positioner
from waam_robot.timing import Drives, TimingError, part_pose, slow_text, time_bead, torch_speed

MACHINE = Machine()
COARSE = {'step': 1e-3}


def ring(radius=0.1, lean=0.0, part=1.0, z=0.0, count=300, **options):
    """Circle about the axis, or a part of it; the torch leans inwards by `lean` (rad)."""
    a = np.linspace(0, 2 * np.pi * part, count)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), z + 0 * a], axis=1)
    lean = lean + 0 * a
    axes = np.stack([-np.sin(lean) * np.cos(a), -np.sin(lean) * np.sin(a), np.cos(lean)], axis=1)
    return make_bead(points, axes, **COARSE | options)


def straight(*points, axis=None, **options):
    points = np.array(points, float)
    axes = None if axis is None else np.tile(np.array(axis, float), (len(points), 1))
    return make_bead(points, axes, **COARSE | options)


def check(paths, machine=MACHINE):
    """What holds for every plan, seen from the joints alone."""
    arm = machine.arm
    for path in paths:
        theta = path.joints[:, :6]
        assert (theta >= np.array(arm.low) - 1e-9).all() and (
            theta <= np.array(arm.high) + 1e-9
        ).all()
        assert np.abs(np.diff(theta, axis=0)).max() <= JUMP
        assert np.ptp(np.sign(np.sin(theta[:, 4]))) == 0 and np.abs(
            np.sin(theta[:, 4])
        ).min() >= np.sin(WRIST)
        pose = part_pose(path.joints, machine)
        assert pose[:, :3, 3] == pytest.approx(path.bead.points, abs=1e-9)
        assert pose[:, :3, 2] == pytest.approx(path.bead.axes, abs=1e-9)


# ---- beads -------------------------------------------------------------------------------------


def test_a_bead_is_even_and_ends_where_it_should():
    bead = make_bead(np.array([[0, 0, 0], [0.03, 0, 0], [0.03, 0.02, 0]]), corner=0.4e-3)
    assert bead.points[[0, -1]] == pytest.approx(np.array([[0, 0, 0], [0.03, 0.02, 0]]), abs=1e-12)
    steps = np.linalg.norm(np.diff(bead.points, axis=0), axis=1)
    assert np.diff(bead.way) == pytest.approx(bead.way[1]) and steps.max() <= bead.way[1] * (
        1 + 1e-6
    )
    corner = np.linalg.norm(bead.points - [0.03, 0, 0], axis=1).min()
    assert bead.rounding == pytest.approx(0.236 * 0.4e-3, rel=0.02)
    assert (
        bead.rounding - 1e-6 <= corner <= bead.rounding + 25e-6
    )  # a point lies up to half a step beside
    assert bead.axes == pytest.approx(np.tile([0, 0, 1.0], (len(bead.points), 1)))


@pytest.mark.parametrize(
    ('points', 'axes', 'said'),
    [
        ([[0, 0, 0]], None, 'points of shape'),
        ([[0, 0, 0], [0, 0, 0]], None, 'a bead of 0.0000 mm'),
        ([[0, 0, 0], [np.nan, 0, 0]], None, 'not finite'),
        ([[0, 0, 0], [1, 0, 0]], [[0, 0, 1]], 'torch axes of shape'),
        ([[0, 0, 0], [1, 0, 0]], [[0, 0, 1], [0, 0, 0]], 'point 1: a torch axis without length'),
        ([[0, 0, 0], [1e6, 0, 0]], None, 'at most'),
    ],
)
def test_senseless_beads_are_refused(points, axes, said):
    with pytest.raises(ValueError, match=said):
        make_bead(np.array(points, float), None if axes is None else np.array(axes, float))


# ---- joint paths -------------------------------------------------------------------------------


def test_a_whole_part_keeps_every_bead_in_one_branch():
    beads = [
        ring(0.15),
        ring(0.14, z=0.002),
        ring(0.12, lean=0.4),
        straight((0.05, 0, 0), (0.09, 0.03, 0), (0.05, 0.03, 0)),
    ]
    paths = plan(beads)
    assert [p.mode for p in paths] == ['follow', 'follow', 'lean', 'hold']
    check(paths)


@pytest.mark.parametrize('degrees', [5, 30, 60])
def test_leaning_torches_are_brought_upright_by_the_positioner(degrees):
    path = plan([ring(0.12, lean=np.radians(degrees), part=0.4)])[0]
    assert path.off_flat < 1e-6 and path.mode == 'lean'
    assert np.degrees(np.abs(path.joints[:, 6])) == pytest.approx(degrees, abs=0.2)
    assert np.ptp(path.joints[:, :6], axis=0).max() < 0.02  # the robot nearly stands still
    check([path])


def test_a_bead_that_starts_upright_and_leans_later_tells_how_far_from_flat_it_is():
    axes = np.array([[0, 0, 1.0], [0, 0.3, 1.0]])
    path = plan([make_bead(np.array([[0.05, 0, 0], [0.09, 0, 0]]), axes, **COARSE)])[0]
    assert path.mode == 'hold'
    assert 0 <= path.off_flat <= np.arctan(0.3) + 1e-9
    check([path])


def test_a_bead_out_of_reach_with_the_usual_turn_is_brought_to_the_other_side():
    bead = straight((2.0, 0, 0), (2.0, 0.05, 0), (1.95, 0.05, 0))
    with pytest.raises(PlanError, match='out of reach'):
        plan([bead], replace(MACHINE, turns=1))
    path = plan([bead])[0]
    assert path.mode == 'hold' and np.ptp(path.joints[:, 7]) == 0
    check([path])
    near = straight((0.1, 0, 0), (0.15, 0, 0))  # the usual turn stays where it is hardly worse
    assert np.array_equal(plan([near])[0].joints, plan([near], replace(MACHINE, turns=1))[0].joints)


def test_a_refused_bead_is_tried_with_other_turns_of_the_positioner():
    bead, seen = straight((0.1, 0, 0), (0.15, 0, 0)), []

    def refuse(number, path):
        seen.append(float(path.joints[0, 7]))
        near = np.abs(wrapped(path.joints[0, 7] - seen[0])) < 1e-6
        return joint_path.Refused(0.0, 'there', False) if near else None

    path = plan([bead], MACHINE, refuse)[0]
    assert abs(path.joints[0, 7] - seen[0]) > 0.7
    check([path])
    with pytest.raises(PlanError, match='bead 0, 0.0 mm from its start.*: there'):
        plan([bead], MACHINE, lambda number, path: joint_path.Refused(0.0, 'there', True))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_random_beads_are_laid_without_a_flip_or_refused_with_their_place(seed):
    rng = np.random.default_rng(seed)
    start = rng.uniform([-0.3, -0.3, 0], [0.3, 0.3, 0.3])
    points = start + np.cumsum(rng.normal(0, 0.02, (4, 3)), axis=0)
    axis = rng.normal([0, 0, 1.5], 1.0)
    beads = [
        straight(*points, axis=axis, step=2e-3),
        straight(*(points + 0.01), axis=axis, step=2e-3),
    ]
    try:
        check(plan(beads))
    except PlanError as e:
        assert str(e).startswith('bead ') and 'mm of the part' in str(e)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_whole_path_counts_not_the_next_bead(seed):
    """The dynamic programming against trying everything."""
    rng = np.random.default_rng(seed)
    stages = [
        SimpleNamespace(cost=rng.uniform(0, 2, n), first=rng.normal(size=(n, 6)), last=rng.normal(size=(n, 6)))
        for n in rng.integers(1, 5, 4)
    ]  # fmt: skip

    def total(nodes):
        moves = sum(
            np.abs(a.last[i] - b.first[j]).max()
            for a, b, i, j in zip(stages, stages[1:], nodes, nodes[1:], strict=False)
        )
        return moves + sum(s.cost[n] for s, n in zip(stages, nodes, strict=True))

    best = min(total(nodes) for nodes in itertools.product(*(range(len(s.cost)) for s in stages)))
    assert total(joint_path._cheapest(stages)) == pytest.approx(best)


def far_positioner(**changes):
    return replace(
        MACHINE, positioner=Positioner(**{'a_b': 1.2, 'd_b': 0.35, 'd_c': 0.15} | changes)
    )


@pytest.mark.parametrize(
    ('bead', 'machine', 'said'),
    [
        (straight((4.0, 0, 0), (4.0, 0.02, 0)), MACHINE,
         r'bead 0, 0.0 mm from its start, at \(4000.0, .*\) mm of the part: out of reach: its wrist would be at'),
        (straight((0.1, 0, 0), (0.1, 0.02, 0), axis=(0, 0, -1)), MACHINE,
         r'B of the positioner would be 180.0 deg, its range -120.3 to 120.3'),
        (ring(0.1), far_positioner(high=(2.1, 1.0)), r'bead 0, .* mm from its start.*: C of the positioner would be'),
        (straight((0.1, 0, 0), (0.1, 0.02, 0)),
         replace(MACHINE, arm=replace(M20IB25, low=(0.5, *M20IB25.low[1:]), high=(0.6, *M20IB25.high[1:]))),
         r'theta1 is .* deg, its range 28.6 to 34.4'),
        (straight((0.1, 0, 0), (0.1, 0.02, 0)), far_positioner(a_b=0.0, d_b=2.1),
         'singularity|out of reach'),
    ],
)  # fmt: skip
def test_what_cannot_be_laid_is_named_with_its_place(bead, machine, said):
    with pytest.raises(PlanError, match=said):
        plan([bead], machine)


def test_no_beads_no_path():
    assert plan([]) == []


# ---- timing ------------------------------------------------------------------------------------


@pytest.fixture
def toppra():
    return pytest.importorskip('toppra', reason='requirements-robot.txt is not installed')


def share_off(timed, speed, machine=MACHINE):
    """Share of the way on which the torch's speed at the part is off by more than 1 %."""
    off = np.abs(torch_speed(timed, machine) / speed - 1) > 0.01
    way = np.gradient(timed.way)
    return way[off].sum() / way.sum()


@pytest.mark.parametrize('speed', [5e-3, 10e-3])
def test_the_torch_has_its_speed_at_the_part(toppra, speed):
    corners = straight((0.05, 0, 0), (0.09, 0, 0), (0.09, 0.03, 0), step=0.1e-3)
    for bead in (ring(0.08, lean=0.4), corners):
        path = plan([bead])[0]
        timed = time_bead(path, speed)
        assert (timed.used <= 1).all()
        assert timed.way[[0, -1]] == pytest.approx([0, bead.length], abs=1e-9)
        assert (np.diff(timed.way) >= 0).all() and timed.speed.max() < speed * 1.01
        assert timed.rates[[0, -1]] == pytest.approx(0, abs=2e-2)
        assert share_off(timed, speed) < 0.02
        assert [s.axis for s in timed.slow] == ['start', 'end']
        there = part_pose(timed.joints, MACHINE)[:, :3, 3]
        meant = np.stack(
            [np.interp(timed.way, bead.way, bead.points[:, n]) for n in range(3)], axis=1
        )
        assert np.linalg.norm(there - meant, axis=1).max() < 20e-6


def test_where_the_turn_is_too_slow_it_is_told_with_axis_and_place(toppra):
    drives = Drives()
    slow_turn = replace(drives, speed=np.append(drives.speed[:7], np.radians(3)))
    path = plan([ring(0.1, part=0.5)])[0]
    timed = time_bead(path, 10e-3, slow_turn)
    assert timed.used.max() <= 1
    told = max(timed.slow, key=lambda s: s.end - s.begin)
    assert told.axis == 'speed of C' and told.end - told.begin > 0.3
    assert told.speed <= np.radians(3) * 0.1 * 1.01
    assert 'speed of C' in slow_text(told, 4) and slow_text(told, 4).startswith('bead 4, ')
    assert np.median(torch_speed(timed, MACHINE)) == pytest.approx(
        0.9 * np.radians(3) * 0.1, rel=0.02
    )


def test_jerk_limits_make_starts_gentle_and_bends_slow(toppra):
    drives = Drives()
    soft = replace(drives, jerk=drives.jerk / 30)
    path = plan([straight((0.05, 0, 0), (0.09, 0, 0), (0.09, 0.03, 0), step=0.1e-3)])[0]
    hard, gentle = time_bead(path, 30e-3, drives), time_bead(path, 30e-3, soft)
    assert hard.used.max() <= 1 and gentle.used.max() <= 1
    assert gentle.time[-1] > hard.time[-1]
    assert gentle.slow[0].end > hard.slow[0].end


@pytest.mark.parametrize('speed', [0.0, -1.0, np.nan])
def test_a_speed_that_is_none_is_refused(speed):
    with pytest.raises(TimingError, match='travel speed'):
        time_bead(plan([ring(0.1, part=0.1)])[0], speed)


def test_without_the_library_the_error_teaches(monkeypatch):
    monkeypatch.setitem(sys.modules, 'toppra', None)
    with pytest.raises(TimingError, match='needs toppra: pip install -r requirements-robot.txt'):
        time_bead(plan([ring(0.1, part=0.1)])[0], 10e-3)


def test_limits_of_drives_are_positive():
    with pytest.raises(ValueError, match='jerk: wanted 8 positive numbers'):
        Drives(jerk=np.zeros(8))
    with pytest.raises(ValueError, match='speed: wanted 8'):
        Drives(speed=np.ones(6))


def test_a_bead_of_one_millimetre(toppra):
    path = plan([straight((0.1, 0, 0), (0.101, 0, 0), step=0.1e-3)])[0]
    timed = time_bead(path, 10e-3)
    assert timed.way[-1] == pytest.approx(1e-3) and timed.used.max() <= 1
    assert wrapped(timed.joints[-1] - path.joints[-1]) == pytest.approx(0, abs=1e-9)
