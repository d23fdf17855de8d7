"""How a restored layer is filled: rings at distances that fit the place, lines in the middle, the most even choice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, affinity, box

from waam_plan.fill import path, strategies
from waam_plan.fill.rings import contour_lines, spacing
from waam_plan.layers import layout
from waam_plan.layers.allocate import metal_heights, unevenness
from waam_plan.layers.restore import plan_restoration
from waam_plan.layers.travel import thinnest_bead
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import raster
from waam_process.grid import GridSpec, HeightGrid

SPEC = GridSpec.covering(-0.05, -0.05, 0.05, 0.05, 0.5e-3)
S = PlanSettings(strategy='contour', edge_metal=1.15, ring_inset=0.28, corner_radius=0.33)


def crossings(lines, y=0.0) -> np.ndarray:
    """x (m) at which lines cross the level y."""
    level = LineString([(-1, y), (1, y)])
    met = [shapely.get_coordinates(LineString(x).intersection(level)) for x in lines]
    return np.sort(np.concatenate([m[:, 0] for m in met if len(m)]))


@pytest.mark.parametrize('half', [14e-3, 15.5e-3, 17e-3, 18.2e-3])
@pytest.mark.parametrize('more', [0.0, 1.0])
def test_rings_and_the_line_in_their_middle_lie_equally_apart(half, more):
    """From one edge to the other, whether the number of beads across is even or odd."""
    shape = box(-half, -0.04, half, 0.04)
    x = crossings(contour_lines(shape, S, more))
    assert np.ptp(np.diff(x)) < 0.1e-3
    assert x[0] + half == pytest.approx(S.first_ring, abs=0.05e-3)
    assert np.diff(x).max() <= S.pitch * 1.001


@pytest.mark.parametrize('width', [15e-3, 18e-3, 20e-3])
def test_a_closed_band_gets_a_closed_line_where_beads_are_odd(width):
    band = Point(0, 0).buffer(0.04).difference(Point(0, 0).buffer(0.04 - width))
    lines = contour_lines(band, S)
    x = crossings(lines)
    apart = np.diff(x[x > 0])
    assert np.ptp(apart) < 0.15e-3 and apart.max() <= S.pitch * 1.001
    assert all(np.allclose(line[0], line[-1]) for line in lines)


def test_more_beads_lie_closer_together():
    shape = box(-0.015, -0.03, 0.015, 0.03)
    apart = [spacing(shape, S, more) for more in layout.MORE]
    assert apart == sorted(apart, reverse=True) and apart[-1] < 0.95 * apart[0]


def area_of(shape) -> strategies.Area:
    return strategies.Area([shape], raster([shape], SPEC), SPEC, S, 1)


def uneven(chains, area) -> float:
    planned = np.where(area.mask, 1e-3, 0.0)
    pieces = path.lay_out(chains, HeightGrid.full(SPEC, 0.0), S)
    height = metal_heights(pieces, planned, area.mask, SPEC, S)
    return unevenness(pieces, height, planned, SPEC, S)


def test_no_layout_is_taken_whose_beads_would_be_too_thin_to_lay():
    """In a lens one number of rings leaves a middle line so close to the innermost that it would need less than the
    least feed; another one, which lies as evenly, does not."""
    shape = affinity.scale(Point(0, 0).buffer(1e-3, 64), 30, 14)
    area = area_of(shape)
    planned = np.where(area.mask, 1e-3, 0.0)
    pieces = path.lay_out(layout.most_even(area, planned), HeightGrid.full(SPEC, 0.0), S)
    height = metal_heights(pieces, planned, area.mask, SPEC, S)
    assert height.min() > thinnest_bead(S)


def test_a_missing_ring_is_uneven():
    area = area_of(box(-0.02, -0.03, 0.02, 0.03))
    chains = strategies.restored(area)
    lines = [line for chain in chains for line in chain]
    without = [[line] for line in lines if np.abs(line[:, 0]).max() > 12e-3]
    assert 0 < len(without) < len(lines)
    assert uneven(without, area) > 2 * uneven([[line] for line in lines], area)


@pytest.mark.parametrize(
    'shape',
    [
        box(-0.02, -0.03, 0.02, 0.03),
        box(-0.03, -0.03, 0.03, 0.03).difference(box(-0.011, -0.014, 0.011, 0.014)),
        box(-0.03, -0.03, 0.0, 0.03).union(box(-0.03, -0.03, 0.04, -0.004)),
    ],
    ids=['plate', 'island', 'ell'],
)
def test_the_most_even_of_all_distances_is_taken(shape):
    area = area_of(shape)
    chosen = layout.most_even(area, np.where(area.mask, 1e-3, 0.0))
    tried = [uneven(strategies.restored(replace(area, more=m)), area) for m in layout.MORE]
    assert uneven(chosen, area) == pytest.approx(min(tried), rel=1e-9)
    assert max(tried) > 1.05 * min(tried), 'otherwise there is nothing to choose'


def test_each_place_gets_a_distance_of_its_own():
    one, other = box(-0.045, -0.03, -0.012, 0.03), box(0.0, -0.02, 0.045, 0.02)
    both = strategies.Area([one, other], raster([one, other], SPEC), SPEC, S, 1)
    planned = np.where(both.mask, 1e-3, 0.0)
    chains = layout.most_even(both, planned)
    alone = [c for p in (one, other) for c in layout.most_even(area_of(p), planned)]
    assert len(chains) == len(alone)
    for chain, expected in zip(chains, alone, strict=True):
        np.testing.assert_array_equal(np.concatenate(chain), np.concatenate(expected))


def hollow(shape, depth: float) -> tuple[HeightGrid, HeightGrid]:
    """As found and nominal: a plate of 10 mm with a pocket that its surroundings end around."""
    inside = raster([shape], SPEC)
    nominal = np.where(inside, 10e-3, np.nan)
    return HeightGrid(SPEC, nominal - depth), HeightGrid(SPEC, nominal)


def star() -> shapely.Polygon:
    angle = np.linspace(0, 2 * np.pi, 181)
    far = 0.026 + 0.008 * np.cos(5 * angle)
    return shapely.Polygon(np.column_stack([far * np.cos(angle), far * np.sin(angle)]))


RING = Point(0, 0).buffer(0.036).difference(Point(0, 0).buffer(0.018))


@pytest.mark.parametrize(
    ('shape', 'hatched', 'other'),
    [(RING, False, 'zigzag'), (star(), True, 'contour')],
    ids=['ring', 'star'],
)
def test_rings_or_parallel_beads_whichever_costs_less(shape, hatched, other):
    settings = PlanSettings()
    plan = plan_restoration(*hollow(shape, 3e-3), settings)
    worse = plan_restoration(*hollow(shape, 3e-3), replace(settings, strategy=other))
    for layer, another in zip(plan.layers, worse.layers, strict=True):
        costs = [layout.cost(x, layer.footprint, SPEC, settings) for x in (layer, another)]
        assert costs[0] < costs[1]
        assert layout.best([another, layer], SPEC, settings) == 1
    assert any('parallel beads' in text for text in plan.remarks) == hatched


def test_a_way_that_turns_back_beside_itself_is_told_from_a_corner():
    def share(*corners) -> float:
        pieces = path.lay_out([[np.array(corners)]], HeightGrid.full(SPEC, 0.0), S)
        return layout.turning_back(pieces, 6e-3)

    assert share((0.0, 0.0), (0.04, 0.0)) == 0.0
    assert share((0.0, 0.0), (0.02, 0.0), (0.02, 0.02)) == 0.0
    hairpin = share((0.0, 0.0), (0.03, 0.0), (0.03, 0.004), (0.0, 0.004))
    # half a bead on both sides of a link of 4 mm, less what still sees the corner alone
    assert 1e-3 / 64e-3 < hairpin <= 8e-3 / 64e-3


def test_a_layer_without_metal_is_never_taken():
    """What misses the same everywhere is even."""
    plan = plan_restoration(*hollow(RING, 3e-3), PlanSettings())
    layer = plan.layers[-1]
    bare = replace(layer, segments=[])
    assert layout.cost(layer, layer.footprint, SPEC, PlanSettings()) < 0.2
    assert layout.cost(bare, layer.footprint, SPEC, PlanSettings()) == np.inf
    assert layout.best([bare, layer], SPEC, PlanSettings()) == 1


def test_a_build_lays_rings_around_a_hole_and_parallel_beads_elsewhere():
    block = box(-0.045, -0.04, -0.02, 0.04)
    band = Point(0.015, 0).buffer(0.03).difference(Point(0.015, 0).buffer(0.012))
    settings = PlanSettings()
    area = strategies.Area([block, band], raster([block, band], SPEC), SPEC, settings, 1)
    chains = strategies.solid(area)
    assert [len(c) for c in chains[:1]] == [len(c) for c in strategies.zigzag(area.part([block]))]
    around = [line for chain in chains[1:] for line in chain]
    assert len(around) >= 4
    for line in around:
        away = np.hypot(line[:, 0] - 0.015, line[:, 1])
        assert np.ptp(away) < 0.1e-3, 'a ring'
