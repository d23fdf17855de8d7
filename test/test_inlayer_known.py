"""The bounds of correcting within a layer (bench/lib/inlayer_known.py): what it takes for known of the disturbance."""

import sys
from pathlib import Path

import numpy as np
import pytest

from waam_process.segment import Kind, Segment
from waam_sim.disturbance import lattice, noise
from waam_sim.metal_params import MetalParams

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'bench'))
from lib.inlayer_known import SIDE, UNIT, Lattice, Sight, known_share

ROW = np.array(
    [[0.1 * k, 2.3, 7.6] for k in range(41)]
)  # places along a bead, in lattice coordinates


def test_a_place_is_the_sum_of_its_nodes_that_the_cell_takes():
    values = lattice(3)
    assert values.shape[1:] == (SIDE,) * 3
    p = MetalParams()
    assert tuple(UNIT) == (p.noise_length, p.noise_length, p.noise_height)
    places = np.array([[0.4, 1.7, 3.2], [-2.6, 5.5, 0.0], [70.1, -0.3, 63.9]])
    nodes, weights = Lattice.weights(places)
    found = (values.reshape(3, -1)[:, nodes] * weights).sum(axis=2)
    told = [[noise(values, c, *place) for place in places] for c in range(3)]
    assert found == pytest.approx(np.array(told), abs=1e-12)


def test_what_was_seen_is_known_a_neighbour_in_part_and_what_is_far_is_not():
    found = Lattice()
    assert found.variance(ROW) == pytest.approx(1.0)
    found.learn(ROW)
    assert found.variance(ROW).max() < 0.05
    assert 0.1 < found.variance(ROW + [0.0, 0.5, 0.0]).mean() < 0.9
    assert found.variance(ROW + [0.0, 4.0, 0.0]) == pytest.approx(1.0)


def layer(length: float, beads: int = 6) -> list[Segment]:
    """Parallel beads along x, 3.6 mm apart, there and back at 10 mm/s, in segments of 10 mm."""
    x, out = np.arange(0.0, length + 1e-6, 0.01), []
    for k in range(beads):
        points = [(v, 3.6e-3 * k, 1e-3) for v in x[:: 1 if k % 2 == 0 else -1]]
        for a, b in zip(points, points[1:], strict=False):
            own = {'kind': Kind.DEPOSIT, 'bead': k + 1, 'width': 6e-3, 'speed': 10e-3}
            out.append(Segment(index=len(out), start=a, end=b, **own))
    return out


def test_who_sees_more_or_sooner_knows_more():
    beads = layer(0.17)
    some = [
        known_share(beads, sight)
        for sight in (
            Sight(mounted=True, delay=10.0),
            Sight(delay=10.0),
            Sight(),
            Sight(at_once=True, delay=1.0),
        )
    ]
    assert 0.01 < some[0] < some[1] < some[2] < some[3] < 1.0


def test_of_a_part_that_is_shorter_than_the_scanner_is_far_nothing_is_known():
    assert known_share(layer(0.05), Sight(mounted=True)) == 0.0
