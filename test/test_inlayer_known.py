"""The bounds of correcting within a layer (bench/lib/inlayer_known.py): what it takes for known of the disturbance."""

import sys
from pathlib import Path

import numpy as np
import pytest

from waam_sim.disturbance import lattice, noise

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'bench'))
from lib.inlayer_known import Lattice

VALUES = lattice(3)
SHAPE = VALUES.shape[1:]
ROW = np.array(
    [[0.1 * k, 2.3, 7.6] for k in range(41)]
)  # places along a bead, in lattice coordinates


def true(places, values=VALUES):
    return np.array([[noise(values, c, *place) for place in places] for c in range(3)])


def left(known, values=VALUES):
    """(3, ...) what is not known after the places `known` were seen."""
    found = Lattice(SHAPE)
    found.learn(known, values.reshape(3, -1))
    out = values.reshape(3, -1).copy()
    out[:, found.nodes] -= found.mean
    return out.reshape(values.shape)


def test_a_place_is_the_sum_of_its_nodes_that_the_cell_takes():
    places = np.array([[0.4, 1.7, 3.2], [-2.6, 5.5, 0.0], [70.1, -0.3, 63.9]])
    nodes, weights = Lattice(SHAPE).weights(places)
    found = (VALUES.reshape(3, -1)[:, nodes] * weights).sum(axis=2)
    assert found == pytest.approx(true(places), abs=1e-12)


def test_what_was_seen_is_known_and_what_is_far_is_not():
    rest = left(ROW)
    assert np.std(true(ROW, rest)) < 0.15 * np.std(true(ROW))
    far = ROW + [0.0, 4.0, 0.0]
    assert true(far, rest) == pytest.approx(true(far))


def test_a_neighbour_is_known_in_part():
    beside, some = ROW + [0.0, 0.4, 0.0], [lattice(seed) for seed in range(6)]
    unknown = sum((true(beside, left(ROW, v)) ** 2).sum() for v in some)
    assert 0.1 < unknown / sum((true(beside, v) ** 2).sum() for v in some) < 0.8


def test_places_may_come_one_by_one():
    at_once, one_by_one = Lattice(SHAPE), Lattice(SHAPE)
    at_once.learn(ROW, VALUES.reshape(3, -1))
    for place in ROW:
        one_by_one.learn(place[None], VALUES.reshape(3, -1))
    order, other = np.argsort(at_once.nodes), np.argsort(one_by_one.nodes)
    assert at_once.mean[:, order] == pytest.approx(one_by_one.mean[:, other], abs=1e-9)
