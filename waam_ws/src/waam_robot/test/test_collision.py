"""Contacts of arm, torch, positioner and part, against distances that are computed another way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.bodies import NOZZLE_END, bodies_of, ends, frames_of
from waam_robot.collision import MARGIN, CollisionError, Scene, _spaced
from waam_robot.positioner import Machine
from waam_robot.station import Place, Station

pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')

MACHINE = Machine()
STATION = Station()
NOZZLE = 10e-3  # m, its radius
BAND = 1e-3  # m: so near to the threshold either answer is right


def between(a: np.ndarray, b: np.ndarray) -> float:
    """m: distance of two lines (2, 3), by many points on the one and exactly to the other."""
    share = np.linspace(0, 1, 400)[:, None]
    points = a[0] + share * (a[1] - a[0])
    along = b[1] - b[0]
    t = np.clip((points - b[0]) @ along / max(along @ along, 1e-12), 0, 1)[:, None]
    return float(np.linalg.norm(points - b[0] - t * along, axis=1).min())


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_arm_against_itself(seed):
    """Random poses, most of which fold the arm into itself."""
    rng = np.random.default_rng(seed)
    joints = np.concatenate([rng.uniform(MACHINE.arm.low, MACHINE.arm.high), [0.0, -np.pi / 2]])
    bodies = bodies_of(MACHINE.arm, MACHINE.positioner)
    capsules = bodies.capsules
    frames = frames_of(MACHINE.arm, MACHINE.positioner, joints[None])
    lines = ends(capsules, frames)[0]
    spare = min(
        between(lines[i], lines[j]) - a.radius - b.radius - MARGIN
        for i, a in enumerate(capsules)
        for j, b in enumerate(capsules)
        if b.link < min(a.near, a.link)
    )
    alone = type(bodies)(capsules)
    found = Scene(MACHINE, alone).first(joints[None])
    if abs(spare) > BAND:
        assert (found is not None) == (spare < 0)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_nozzle_over_a_random_surface(seed):
    """The torch stands upright, so what is near the nozzle is a matter of heights and of a circle."""
    rng = np.random.default_rng(seed)
    cell = 3e-3
    heights = rng.uniform(0, 0.02, (20, 20)) + 0.05 * (rng.uniform(size=(20, 20)) < 0.02)
    corner = np.array(STATION.place.origin[:2]) + [0.15, 0.1]
    tip = np.array([0.15, 0.1, 0.0]) + rng.uniform([0.01, 0.01, 0.0], [0.05, 0.05, 0.06])
    scene = Scene(MACHINE)
    scene.set_surface(tuple(corner), cell, heights)
    found = scene.first(STATION.joints(tip[None]))
    middle = (np.arange(20) + 0.5) * cell
    x, y = np.meshgrid(middle + 0.15, middle + 0.1)
    aside = np.maximum(np.hypot(x - tip[0], y - tip[1]), 0.0)
    line = tip[2] + NOZZLE_END + NOZZLE  # where the nozzle's line begins
    half = cell / 2 * np.sqrt(2)

    def spare(beside: np.ndarray) -> float:
        below = np.maximum(line - heights, 0.0)
        return float((np.hypot(beside, below) - NOZZLE - MARGIN).min())

    if spare(aside) < -BAND:  # the middle of a cell is in the way
        assert found is not None and found.bodies == ('nozzle', 'part')
        assert np.abs(found.tip - tip - STATION.place.origin).max() < 1e-9
    if spare(np.maximum(aside - half - cell, 0.0)) > BAND:  # cells are widened by one at most
        assert found is None


def test_what_is_passed_between_two_places_counts():
    scene = Scene(MACHINE)
    tower = np.full((3, 3), 0.10)
    scene.set_surface((0.0, 0.0), 4e-3, tower)
    at = STATION.joints(np.array([[0.15, 0.156, 0.02], [0.25, 0.156, 0.02]]))
    assert scene.first(at[:1]) is None and scene.first(at[1:]) is None
    found = scene.first(at)
    assert found is not None and found.at == 0 and 'nozzle within 2 mm of part' in found.text


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0, 0.03), min_size=1, max_size=30))
def test_places_are_as_near_to_each_other_as_is_wanted(moved):
    found = _spaced(np.array(moved), MARGIN)
    way = np.concatenate([[0.0], np.cumsum(moved)])
    gone = np.interp(found, np.arange(len(way)), way)
    assert found[0] == 0 and found[-1] == len(moved)
    assert (np.diff(found) > 0).all() and np.diff(gone).max() < MARGIN + 1e-9


def test_the_faceplate_is_in_the_way_of_what_is_below_it():
    place = STATION.place
    station = Station(Place(low=(0.0, 0.0, -0.1), high=place.high))
    found = Scene(MACHINE).first(station.joints(np.array([[0.4, 0.15, -0.03]])))
    assert found is not None and found.text == 'nozzle within 2 mm of faceplate'


@pytest.mark.parametrize(
    ('heights', 'said'),
    [(np.zeros(3), 'cells'), (np.full((2, 2), np.nan), 'with a height')],
)
def test_a_surface_without_cells(heights, said):
    with pytest.raises(CollisionError, match=said):
        Scene(MACHINE).set_surface((0.0, 0.0), 1e-3, heights)


def test_no_margin():
    with pytest.raises(CollisionError, match='margin'):
        Scene(MACHINE, margin=0.0)
