"""Width of the beads of a layer, from the maps before and after it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_process.grid import GridSpec
from waam_scan.bead_width import BeadWidth, bead_width
from waam_scan.fusion_params import FusionParams
from waam_scan.map_maker import MapMaker
from waam_scan.stream.session import PreviousMap

SPEC = GridSpec(-0.02, -0.02, 0.5e-3, 160, 220)
X, Y = np.meshgrid(SPEC.x, SPEC.y)
NOISE = 2e-5
START = np.array([0.01, 0.02])


def beside(angle, start=START):
    """Distance of every cell from a path (m, to its left positive) and along it."""
    along = np.array([math.cos(angle), math.sin(angle)])
    dx, dy = X - start[0], Y - start[1]
    return dy * along[0] - dx * along[1], dx * along[0] + dy * along[1]


def laid(width, height=2e-3, angle=0.0, start=START, length=0.06, ripple=0.0):
    """Growth (m) of a bead, and its path."""
    across, along = beside(angle, start)
    wide = width + ripple * np.sin(along / 4e-3)
    growth = height * np.clip(1 - (2 * across / wide) ** 2, 0, None)
    end = start + length * np.array([math.cos(angle), math.sin(angle)])
    return growth * ((along >= 0) & (along <= length)), np.array([start, end])


def measure(growth, paths, expected=6e-3, ground=None, seed=101, noise=NOISE):
    ground = 0.02 + 0.03 * X if ground is None else ground
    rng = np.random.default_rng(seed)
    after = ground + growth + noise * rng.standard_normal(growth.shape)
    return bead_width(ground, after, SPEC, paths, [np.full(len(p), expected) for p in paths])


@settings(max_examples=40, deadline=None)
@given(
    st.floats(4.4e-3, 8e-3), st.floats(1e-3, 3e-3), st.floats(0, 2 * math.pi), st.integers(0, 99)
)
def test_width_of_a_free_bead_is_found_in_any_direction(width, height, angle, seed):
    # half the examples would leave the map: they begin at its middle
    growth, path = laid(width, height, angle, start=np.array([0.035, 0.02]), length=0.032)
    found = measure(growth, [path], seed=seed)
    assert found.width == pytest.approx(width, rel=0.02)
    assert found.expected == pytest.approx(6e-3) and 8 <= found.sections <= 13


@pytest.mark.parametrize('width', [5e-3, 6e-3, 7e-3])
def test_of_beads_side_by_side_the_outer_sides_tell_the_width(width):
    beads = [laid(width, start=START + [0, 4e-3 * i]) for i in range(4)]
    growth = np.maximum.reduce([g for g, _ in beads])
    found = measure(growth, [p for _, p in beads])
    assert found.width == pytest.approx(width, rel=0.02)
    # two beads, without their ends and the begin of the layer
    assert found.sections == pytest.approx(48, abs=3)


def test_the_narrow_first_bead_of_a_layer_does_not_count_where_a_later_one_stands_free():
    beads = [laid(w, start=START + [0, 4e-3 * i]) for i, w in enumerate([6e-3] + 6 * [6.6e-3])]
    growth = np.maximum.reduce([g for g, _ in beads])
    assert measure(growth, [p for _, p in beads]).width == pytest.approx(6.6e-3, rel=0.02)
    growth, path = laid(6e-3)
    assert measure(growth, [path]).width == pytest.approx(6e-3, rel=0.02)  # the only bead counts


def test_a_bead_that_varies_has_a_larger_uncertainty():
    even, rippled = (
        measure(*(lambda g, p: (g, [p]))(*laid(6e-3, ripple=r))) for r in (0.0, 0.4e-3)
    )
    assert rippled.u > 5 * even.u > 0
    assert abs(rippled.width - 6e-3) < 4 * rippled.u


def nothing(found):
    return found.sections == 0 and math.isnan(found.width) and math.isnan(found.u)


def test_where_no_bead_stands_free_there_is_no_width():
    growth, path = laid(6e-3)
    assert nothing(BeadWidth())
    assert nothing(measure(growth, []))
    assert nothing(measure(np.zeros(SPEC.shape), [path]))  # nothing was laid
    assert nothing(measure(np.full(SPEC.shape, 2e-3), [path]))  # metal on both sides
    assert nothing(measure(growth, [path[:1] + [[0, 0], [0.015, 0]]]))  # its ends alone
    assert nothing(measure(growth, [path + [0.5, 0.0]]))  # outside the map


def test_the_side_of_a_wall_tells_no_width():
    """A bead on a wall of its own width: what lies below ends with it."""
    growth, path = laid(6e-3)
    across, _ = beside(0.0)
    wall = np.where(np.abs(across) < 2.8e-3, 0.02, 0.0)
    assert nothing(measure(growth, [path], ground=wall))


def test_turns_do_not_count():
    """A square of 60 mm: 20 mm of ends and 12 mm at each of three turns less."""
    corners = START + 0.03 * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    grown = [laid(5e-3, angle=i * math.pi / 2, start=corners[i], length=0.03)[0] for i in range(4)]
    found = measure(np.maximum.reduce(grown), [corners])
    assert found.width == pytest.approx(5e-3, rel=0.03)
    assert 50 <= found.sections <= 66


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_whatever_the_maps_hold_there_is_an_answer(seed):
    rng = np.random.default_rng(seed)
    maps = rng.normal(0.0, 2e-3, (2, *SPEC.shape))
    maps[rng.random(maps.shape) < rng.random()] = np.nan
    paths = [rng.uniform(-0.03, 0.1, (n, 2)) for n in (2, 3, 9)]
    paths.append(np.tile(START, (4, 1)))  # a stretch without length
    found = bead_width(*maps, SPEC, paths, [np.full(len(p), 6e-3) for p in paths])
    assert nothing(found) or (found.width > 0 and found.u >= 0)


def test_the_surface_below_a_layer_is_that_of_the_layer_before():
    def seen(layer, value, job='a'):
        return PreviousMap(job, layer, SPEC, np.full(SPEC.shape, value))

    s = MapMaker(FusionParams())
    assert s.below('a', 1, SPEC) is None
    s.believe(seen(0, 0.0))
    assert s.below('a', 1, SPEC)[0, 0] == 0.0
    s.believe(seen(1, 1.0))
    s.believe(seen(1, 2.0))  # scanned again
    assert s.below('a', 1, SPEC)[0, 0] == 0.0
    assert s.below('a', 2, SPEC)[0, 0] == 2.0
    assert s.below('a', 3, SPEC) is None and s.below('b', 2, SPEC) is None
