"""Strategies: inside the section, covering it, few arc starts that move from layer to layer."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, box
from shapely.affinity import rotate

from waam_plan.fill import path, strategies
from waam_plan.fill.band import band_lines
from waam_plan.fill.inside import keep_inside
from waam_plan.fill.linking import StartsBelow, near_starts, spread_starts
from waam_plan.fill.medial import medial_lines
from waam_plan.fill.rings import bead_count, contour_lines, spiral_lines
from waam_plan.settings import STRATEGIES, PlanSettings
from waam_plan.slice.section import outline, raster
from waam_process.grid import GridSpec, HeightGrid

SPEC = GridSpec.covering(-0.012, -0.012, 0.092, 0.072, 0.5e-3)
PLATE = box(0, 0, 0.08, 0.05).difference(Point(0.05, 0.025).buffer(0.012))
ELL = Polygon([(0, 0), (0.07, 0), (0.07, 0.025), (0.03, 0.025), (0.03, 0.06), (0, 0.06)])
RIBS = box(0, 0, 0.08, 0.006).union(box(0.036, 0, 0.042, 0.05)).union(box(0.06, 0, 0.066, 0.04))
SHAPES = {'plate': PLATE, 'ell': ELL, 'ribs': RIBS}
FILLS = [s for s in STRATEGIES if s != 'shell']


def filled(shape, strategy, number=1, **options):
    """Pieces of layer `number`."""
    s = PlanSettings(strategy=strategy, **options)
    area = strategies.Area([shape], raster([shape], SPEC), SPEC, s, number)
    return keep_inside(
        path.lay_out(strategies.fill(area), HeightGrid.full(SPEC, 0.0), s), area.polygons
    )


def lines(pieces):
    return shapely.linestrings(np.stack([pieces.start[:, :2], pieces.end[:, :2]], axis=1))


def starts(pieces):
    first = np.append(True, pieces.chain[1:] != pieces.chain[:-1])
    return pieces.start[first, :2]


def test_every_name_of_the_settings_has_a_strategy():
    assert tuple(strategies.REGISTRY) == STRATEGIES
    assert all(entry.summary for entry in strategies.REGISTRY.values())


@pytest.mark.parametrize('strategy', FILLS)
@pytest.mark.parametrize('name', SHAPES)
def test_path_is_inside_and_covers_the_section(name, strategy):
    shape = SHAPES[name]
    pieces = filled(shape, strategy)
    assert shapely.contains(shape.buffer(1e-9), lines(pieces)).all()
    covered = shapely.union_all(lines(pieces)).buffer(3e-3).intersection(shape).area
    assert covered >= 0.985 * shape.area
    assert len(starts(pieces)) <= 6


@pytest.mark.parametrize('strategy', ['contour', 'spiral', 'combined'])
def test_the_edge_is_followed_half_a_bead_inside(strategy):
    edge = shapely.union_all(lines(filled(ELL, strategy)))
    ring = ELL.buffer(-3e-3).exterior
    assert edge.buffer(0.1e-3).intersection(ring).length > 0.97 * ring.length


def test_a_spiral_has_one_arc_start_where_contours_have_a_seam_per_ring():
    disc = Point(0.04, 0.03).buffer(0.024)
    spiral, rings = filled(disc, 'spiral'), filled(disc, 'contour')
    assert len(starts(spiral)) == 1
    radius = np.hypot(*(spiral.end[:, :2] - (0.04, 0.03)).T)
    assert (np.diff(radius) < 0.3e-3).all() and radius[-1] < 0.006  # inwards, turn by turn
    steps = np.sort(np.hypot(*(rings.end[:, :2] - (0.04, 0.03)).T).round(3))
    assert len(np.unique(steps)) >= 4
    length = shapely.union_all(lines(rings)).length
    ramp_and_last_closing = 0.1 * length  # nowhere else is the path laid twice
    assert shapely.length(lines(spiral)).sum() < length + ramp_and_last_closing


@pytest.mark.parametrize('number', [1, 2, 3])
def test_combined_lays_its_rings_last_and_moves_their_starts(number):
    pieces = filled(ELL, 'combined', number)
    last = pieces.chain == pieces.chain[-1]
    ring = shapely.union_all(lines(pieces)[last])
    edge = ELL.buffer(-3e-3).exterior
    assert ring.buffer(0.1e-3).intersection(edge).length > 0.97 * edge.length
    assert ring.length == pytest.approx(edge.length, rel=0.02)  # and nothing else
    inside = ELL.buffer(-(3e-3 + PlanSettings().pitch / 3))  # the fill comes no nearer to the ring
    assert inside.covers(shapely.union_all(lines(pieces)[~last]))
    before = starts(filled(ELL, 'combined', number + 1))[-1]
    assert np.linalg.norm(starts(pieces)[-1] - before) > 5e-3


@pytest.mark.parametrize('shift', [0.0, 0.38, 0.76])
def test_a_spiral_in_a_scanned_region_does_not_turn_back(shift):
    y, x = np.mgrid[0 : SPEC.rows, 0 : SPEC.cols]
    worn = ((x - 100) / 75) ** 4 + (
        (y - 80) / 45
    ) ** 4 < 1  # a rounded pocket, with the steps of its cells
    (shape,) = outline(worn, SPEC)
    for line in spiral_lines(shape, PlanSettings(strategy='spiral'), shift):
        way = np.diff(line, axis=0)
        way = way[np.linalg.norm(way, axis=1) > 1e-9]
        turn = np.diff(np.unwrap(np.arctan2(*way.T[::-1])))
        assert np.abs(turn).max() < np.radians(120)
        back = np.abs(turn).sum() - abs(turn.sum())
        assert back < np.radians(90) * len(contour_lines(shape, PlanSettings()))


@given(
    st.lists(st.floats(0.012, 0.03), min_size=5, max_size=9),
    st.floats(0, 1),
)
@settings(max_examples=40, deadline=None)
def test_turns_of_any_spiral_stay_inside_and_follow_each_ring(radii, shift):
    angles = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    shape = Polygon(
        [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    )
    s = PlanSettings(strategy='spiral')
    rings = [shapely.LineString(x) for x in contour_lines(shape, s)]
    turns = shapely.multilinestrings([shapely.LineString(x) for x in spiral_lines(shape, s, shift)])
    assert turns.length > 0 and shape.buffer(-s.bead_width / 2).buffer(1e-6).covers(turns)
    for ring in rings:
        left = ring.difference(turns.buffer(1e-6)).length
        assert left <= 0.1 * ring.length + 12 * s.pitch


def test_zigzag_turns_by_the_angle_of_the_settings():
    def heading(number):
        p = filled(box(0, 0, 0.08, 0.05), 'zigzag', number, alternation='turn', turn_deg=30.0)
        step = (p.end - p.start)[:, :2]
        long = np.linalg.norm(step, axis=1) > 1.5e-3
        angle = np.degrees(np.arctan2(step[long, 1], step[long, 0])) % 180
        return float(np.median(angle))

    assert heading(2) == pytest.approx(30, abs=3) and heading(4) == pytest.approx(90, abs=3)


@pytest.mark.parametrize('strategy', FILLS)
def test_arc_starts_move_between_layers(strategy):
    for shape in (PLATE, ELL):
        below = starts(filled(shape, strategy, 1))
        s = PlanSettings(strategy=strategy)
        known = StartsBelow(below, s.start_spread)
        area = strategies.Area([shape], raster([shape], SPEC), SPEC, s, 2, below=known)
        chains = spread_starts(strategies.fill(area), below, s.start_spread)
        long = [c for c in chains if sum(shapely.LineString(x).length for x in c) > 20e-3]
        gaps = [np.linalg.norm(below - c[0][0], axis=1).min() for c in long]
        assert long and min(gaps) >= 5e-3


@given(st.floats(0.0, 1.0), st.integers(1, 6), st.floats(3e-3, 8e-3))
@settings(max_examples=40, deadline=None)
def test_rings_keep_away_from_starts_below_and_still_go_from_the_outside_in(where, number, least):
    shape = box(0, 0, 0.05, 0.03)
    outer = contour_lines(shape, PlanSettings(strategy='contour'))[0]
    below = np.array(LineString(outer).interpolate(where, normalized=True).coords)
    s = PlanSettings(strategy='contour', start_spread=least)
    known = StartsBelow(below, least)
    area = strategies.Area([shape], raster([shape], SPEC), SPEC, s, number, below=known)
    chains = strategies.fill(area)
    assert len(chains) == 1 and len(chains[0]) > 2
    assert known.room(chains[0][0][0]) >= least
    assert spread_starts(chains, below, least) == chains, 'nothing is left to turn round'
    inset = [shape.exterior.distance(LineString(line)) for line in chains[0]]
    assert inset == sorted(inset)


def test_starts_that_stay_near_are_told_with_their_place():
    layers = [
        np.array(p).reshape(-1, 2) * 1e-3
        for p in ([[0, 0]], [[9, 0], [0, 4]], [], [[3, 0]], [[3, 6]])
    ]
    (text,) = near_starts(layers, 5e-3)
    assert text.startswith('1 arc starts') and '4.0 mm in layer 2 at (0.0, 4.0) mm' in text
    (text,) = near_starts(layers, 6.5e-3, first=0)
    assert text.startswith('2 arc starts') and 'in layer 1 at' in text
    assert near_starts(layers, 3e-3) == [] == near_starts([], 5e-3)


@pytest.mark.parametrize('number', [1, 2, 3])
@pytest.mark.parametrize('thickness', [3.4e-3, 4e-3, 6e-3])
def test_a_restored_strip_is_one_ring_whose_ends_are_turns(thickness, number):
    strip = shapely.LineString([(0.005, 0.02), (0.04, 0.03), (0.075, 0.02)]).buffer(
        thickness / 2, cap_style='flat'
    )
    s = PlanSettings()
    area = strategies.Area([strip], raster([strip], SPEC), SPEC, s, number)
    ((line,),) = strategies.restored(area)
    curve = shapely.LineString(line)
    away = curve.segmentize(0.5e-3).coords
    apart = shapely.distance(strip.exterior, shapely.points(away))
    np.testing.assert_allclose(apart, thickness / 4, atol=0.1 * thickness)
    assert curve.length > 1.8 * 0.07
    # a wall that is too thin for two beads is not
    other = strip.buffer(-0.3 * thickness)
    area = strategies.Area([other], raster([other], SPEC), SPEC, s, number)
    assert len(strategies.restored(area)) > 1 or len(strategies.restored(area)[0]) > 1


@pytest.mark.parametrize('thickness', [3.4e-3, 5e-3, 7.0e-3])
def test_a_restored_band_around_a_hole_is_two_rings_along_its_sides(thickness):
    middle = Point(0.04, 0.03).buffer(0.02, 64)
    band = middle.buffer(thickness / 2).difference(middle.buffer(-thickness / 2))
    area = strategies.Area([band], raster([band], SPEC), SPEC, PlanSettings(), 1)
    rings = [shapely.LineString(line) for chain in strategies.restored(area) for line in chain]
    outer, inner = sorted((r for r in rings if r.length > 0.08), key=lambda r: -r.length)
    for ring, side in ((outer, band.exterior), (inner, band.interiors[0])):
        apart = shapely.distance(side, shapely.points(ring.segmentize(0.5e-3).coords))
        np.testing.assert_allclose(np.median(apart), thickness / 4, atol=0.1 * thickness)


@pytest.mark.parametrize('island', np.arange(16e-3, 20e-3, 0.25e-3))
def test_rings_around_an_island_never_run_on_each_other(island):
    """The band between two squares, one of them with round corners: thick at its corners only."""
    half = island / 2 - 4e-3
    band = box(-0.021, -0.019, 0.021, 0.019)
    band = band.difference(box(-half, -half, half, half).buffer(4e-3))
    s = PlanSettings(bead_width=5e-3, strategy='contour', ring_inset=0.28)
    for more in (0.0, 0.25, 0.5, 0.75, 1.0):
        rings = [shapely.LineString(x) for x in contour_lines(band, s, more)]
        for k, ring in enumerate(rings):
            others = shapely.union_all(rings[:k] + rings[k + 1 :])
            near = ring.intersection(others.buffer(0.25 * s.pitch)).length
            assert near < 0.2 * ring.length, (more, k)


def test_rings_around_an_island_share_the_band_where_it_is_wide_and_where_it_is_narrow():
    band = box(-0.028, -0.031, 0.028, 0.031).difference(box(-0.008, -0.008, 0.008, 0.008))
    s = PlanSettings(ring_inset=0.28)
    rings = [shapely.LineString(x) for x in band_lines(band, s)]
    assert all(r.is_ring for r in rings)

    def gaps(ray):
        at = sorted(shapely.get_coordinates(r.intersection(ray))[0].tolist() for r in rings)
        return np.linalg.norm(np.diff(at, axis=0), axis=1)

    across = gaps(shapely.LineString([(0, 0), (0.04, 0)]))  # 20 mm of band
    along = gaps(shapely.LineString([(0, 0), (0, 0.04)]))  # 23 mm
    for found, width in ((across, 20e-3), (along, 23e-3)):
        np.testing.assert_allclose(
            found, (width - 2 * s.first_ring) / (len(rings) - 1), atol=0.1e-3
        )
    assert len(band_lines(band, s, more=1)) == len(rings) + 1
    # nothing for a plate, two islands, or a band that is four times as wide on one side
    two = band.difference(box(0.015, 0.015, 0.017, 0.017))
    aside = box(-0.01, -0.01, 0.04, 0.01).difference(box(-0.005, -0.005, 0.005, 0.005))
    for other in (box(0, 0, 0.03, 0.03), two, aside):
        assert band_lines(other, s) == []


@given(st.floats(6e-3, 0.1), st.floats(4e-3, 8e-3), st.floats(0.55, 0.7))
def test_bead_count_keeps_the_overlap(wall, width, ratio):
    """The source's rule: never wider apart than the ratio, never one bead more than that needs."""
    n = bead_count(wall, width, ratio)
    if n > 1:
        apart = (wall - width) / (n - 1)
        assert apart <= ratio * width * (1 + 1e-5)
        assert n == 2 or (wall - width) / (n - 2) > ratio * width * (1 - 1e-5)


@pytest.mark.parametrize('thickness', [4e-3, 6e-3])
def test_medial_axis_of_a_curved_wall_and_a_tee(thickness):
    arc = shapely.LineString([(0.03 * math.cos(a), 0.03 * math.sin(a)) for a in np.linspace(0, 3)])
    (line,) = medial_lines(arc.buffer(thickness / 2, cap_style='flat'), 2e-3)
    np.testing.assert_allclose(np.hypot(*line.T), 0.03, atol=0.3e-3)
    tee = box(0, -thickness / 2, 0.06, thickness / 2).union(
        box(0.03 - thickness / 2, 0, 0.03 + thickness / 2, 0.04)
    )
    found = sorted(shapely.LineString(x).length for x in medial_lines(tee, 2e-3))
    assert len(found) == 2
    assert found[1] == pytest.approx(0.06, abs=thickness)
    assert found[0] == pytest.approx(0.04, abs=thickness)


def test_edge_beads_get_the_surplus_of_the_rule_of_thumb():
    """Half a bead from the edge they have more area than pitch times length: 20 to 30 % more, as the source says."""
    from waam_plan.layers.allocate import along_edge, metal_heights

    s = PlanSettings(strategy='contour', pitch_ratio=0.65)
    shape = box(0, 0, 0.08, 0.06)
    pieces = filled(shape, 'contour', pitch_ratio=0.65)
    mask = raster([shape], SPEC)
    height = metal_heights(pieces, np.where(mask, 2e-3, 0.0), mask, SPEC, s)
    edge = along_edge(pieces, mask, SPEC, s)
    inner = ~edge & (np.abs(pieces.start[:, 0] - 0.04) < 0.02) & (pieces.start[:, 1] < 0.02)
    side = edge & (np.abs(pieces.start[:, 0] - 0.04) < 0.02) & (pieces.start[:, 1] < 0.02)
    assert 1.1 < height[side].mean() / height[inner].mean() < 1.45


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_whatever_leaves_the_section_is_brought_back(seed):
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 15)[:-1]
    radius = rng.uniform(0.008, 0.03, 14)
    shape = Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])).buffer(0)
    points = np.column_stack([rng.uniform(-0.03, 0.03, (15, 2)), np.zeros(15)])
    number = np.zeros(14, int)
    kept = keep_inside(path.Pieces(points[:-1], points[1:], number + 1, number), [shape])
    assert shapely.contains(shape, lines(kept)).all()
    whole = shapely.contains(shape, lines(path.Pieces(points[:-1], points[1:], number, number)))
    assert len(kept.bead) >= whole.sum()
    joined = np.linalg.norm(kept.end[:-1] - kept.start[1:], axis=1) < 1e-9
    assert joined[kept.chain[1:] == kept.chain[:-1]].all()


@pytest.mark.parametrize('turn', [0.0, 0.4, 1.9])
def test_a_bead_that_cuts_an_inner_corner_goes_around_it_with_the_arc_on(turn):
    """As when lines beside the corner shift by half a pitch: a cut would leave a crater and a hump."""
    shape = rotate(ELL, turn, origin=(0.03, 0.025), use_radians=True)
    points = rotate(
        LineString([(0.01, 0.0255), (0.0295, 0.0255), (0.0325, 0.0245), (0.06, 0.0245)]),
        turn, origin=(0.03, 0.025), use_radians=True,
    ).coords  # fmt: skip
    points = np.column_stack([points, [0.001, 0.002, 0.003, 0.004]])
    one = np.zeros(3, int)
    kept = keep_inside(path.Pieces(points[:-1], points[1:], one + 1, one), [shape])
    assert shapely.contains(shape, lines(kept)).all()
    assert len(starts(kept)) == 1
    length = np.linalg.norm(kept.end - kept.start, axis=1)
    assert length.sum() < 1.02 * np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert len(length) < 10 and (np.diff(kept.start[:, 2]) > 0).all()


def test_the_outline_of_a_mask_is_within_a_cell_of_it():
    mask = raster([PLATE], SPEC)
    again = raster(outline(mask, SPEC), SPEC)
    assert (mask ^ again).sum() < 0.01 * mask.sum()
    (shape,) = outline(mask, SPEC)
    assert shape.hausdorff_distance(PLATE) < 1.5 * SPEC.resolution and len(shape.interiors) == 1


@pytest.mark.parametrize('shape', ['strip', 'band'])
@pytest.mark.parametrize('thickness', np.arange(6.8e-3, 14.1e-3, 1.2e-3))
def test_no_groove_is_left_in_a_wall(shape, thickness):
    """Beads farther apart than 0.8 of their width leave one that no correction fills."""
    if shape == 'strip':
        wall = box(0.005, 0.02, 0.075, 0.02 + thickness)
    else:
        middle = Point(0.04, 0.03)
        wall = middle.buffer(0.016 + thickness / 2, 64).difference(
            middle.buffer(0.016 - thickness / 2, 64)
        )
    for strategy in ('solid', 'contour'):
        pieces = filled(wall, strategy)
        inside = wall.buffer(-PlanSettings().bead_width / 2)
        near = shapely.union_all(lines(pieces)).buffer(0.4 * PlanSettings().bead_width)
        assert inside.difference(near).area < 0.02 * wall.area, strategy
