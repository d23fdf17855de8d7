"""The paths of beads, even and with rounded corners, and their timing under the limits of the drives."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from waam_robot.bead import make_bead
from waam_robot.frames import wrapped
from waam_robot.station import Station
from waam_robot.timing import Drives, TimingError, time_bead

STATION = Station()
FINE = 0.1e-3


def straight(*points, step=1e-3):
    return make_bead(np.array(points, float), step=step)


def timed_bead(bead, speed, drives=None):
    return time_bead(bead, STATION.joints(bead.points), speed, drives)


CORNER = (0.15, 0.1, 0.02), (0.19, 0.1, 0.02), (0.19, 0.13, 0.02)

# ---- beads -------------------------------------------------------------------------------------


def test_a_bead_is_even_and_ends_where_it_should():
    bead = make_bead(np.array([[0, 0, 0], [0.03, 0, 0], [0.03, 0.02, 0]]), corner=0.4e-3)
    assert bead.points[[0, -1]] == pytest.approx(np.array([[0, 0, 0], [0.03, 0.02, 0]]), abs=1e-12)
    steps = np.linalg.norm(np.diff(bead.points, axis=0), axis=1)
    assert np.diff(bead.way) == pytest.approx(bead.way[1])
    assert steps.max() <= bead.way[1] * (1 + 1e-6)
    corner = np.linalg.norm(bead.points - [0.03, 0, 0], axis=1).min()
    # a point lies up to half a step beside
    assert 0.23 * 0.4e-3 <= corner <= 0.24 * 0.4e-3 + 25e-6


@pytest.mark.parametrize(
    ('points', 'said'),
    [
        ([[0, 0, 0]], 'points of shape'),
        ([[0, 0, 0], [0, 0, 0]], 'a bead of 0.0000 mm'),
        ([[0, 0, 0], [np.nan, 0, 0]], 'not finite'),
        ([[0, 0, 0], [1e6, 0, 0]], 'at most'),
    ],
)
def test_senseless_beads_are_refused(points, said):
    with pytest.raises(ValueError, match=said):
        make_bead(np.array(points, float))


# ---- timing ------------------------------------------------------------------------------------


@pytest.fixture
def toppra():
    return pytest.importorskip('toppra', reason='requirements-robot.txt is not installed')


def share_off(timed, speed):
    """Share of the way on which the torch's speed, by forward kinematics, is off by more than 1 %."""
    step = np.linalg.norm(np.diff(STATION.tips(timed.joints), axis=0), axis=1)
    off = np.abs(step / np.diff(timed.time) / speed - 1) > 0.01
    return step[off].sum() / step.sum()


@pytest.mark.parametrize('speed', [5e-3, 10e-3])
def test_the_torch_has_its_speed_at_the_part(toppra, speed):
    a = np.linspace(0, 2 * np.pi, 300)
    ring = make_bead(np.column_stack([0.2 + 0.08 * np.cos(a), 0.15 + 0.08 * np.sin(a), 0 * a]))
    for bead in (ring, straight(*CORNER, step=FINE)):
        timed = timed_bead(bead, speed)
        assert (timed.used <= 1).all()
        assert timed.way[[0, -1]] == pytest.approx([0, bead.length], abs=1e-9)
        assert (np.diff(timed.way) >= 0).all() and timed.speed.max() < speed * 1.01
        assert timed.rates[[0, -1]] == pytest.approx(0, abs=2e-2)
        assert share_off(timed, speed) < 0.02
        there = STATION.tips(timed.joints)
        meant = np.stack(
            [np.interp(timed.way, bead.way, bead.points[:, n]) for n in range(3)], axis=1
        )
        assert np.linalg.norm(there - meant, axis=1).max() < 20e-6


def test_where_a_drive_is_too_slow_the_torch_is_slower(toppra):
    drives = Drives()
    slow = replace(drives, speed=np.append(np.radians(0.3), drives.speed[1:]))
    timed = timed_bead(straight((0.2, 0.05, 0.02), (0.2, 0.2, 0.02)), 10e-3, slow)
    assert timed.used.max() <= 1
    inner = (timed.way > 0.02) & (timed.way < 0.13)
    assert timed.speed[inner].max() < 8e-3
    assert np.abs(timed.rates[inner, 0]).min() > 0.85 * np.radians(0.3)


def test_jerk_limits_make_starts_gentle_and_bends_slow(toppra):
    drives = Drives()
    soft = replace(drives, jerk=drives.jerk / 30)
    bead = straight(*CORNER, step=FINE)
    hard, gentle = timed_bead(bead, 30e-3, drives), timed_bead(bead, 30e-3, soft)
    assert hard.used.max() <= 1 and gentle.used.max() <= 1
    assert gentle.time[-1] > hard.time[-1]


@pytest.mark.parametrize('speed', [0.0, -1.0, np.nan])
def test_a_speed_that_is_none_is_refused(speed):
    with pytest.raises(TimingError, match='travel speed'):
        timed_bead(straight(*CORNER), speed)


def test_without_the_library_the_error_teaches(monkeypatch):
    monkeypatch.setitem(sys.modules, 'toppra', None)
    with pytest.raises(TimingError, match='needs toppra: pip install -r requirements-robot.txt'):
        timed_bead(straight(*CORNER), 10e-3)


def test_limits_of_drives_are_positive():
    with pytest.raises(ValueError, match='jerk: wanted 8 positive numbers'):
        Drives(jerk=np.zeros(8))
    with pytest.raises(ValueError, match='speed: wanted 8'):
        Drives(speed=np.ones(6))


def test_a_bead_of_one_millimetre(toppra):
    bead = straight((0.1, 0.1, 0), (0.101, 0.1, 0), step=FINE)
    timed = timed_bead(bead, 10e-3)
    assert timed.way[-1] == pytest.approx(1e-3) and timed.used.max() <= 1
    last = STATION.joints(bead.points[-1:])[0]
    assert wrapped(timed.joints[-1] - last) == pytest.approx(0, abs=1e-9)
