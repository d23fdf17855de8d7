"""Properties of restoration plans on synthetic wear."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation

from waam_plan.fill.linking import arc_starts
from waam_plan.fill.path import coverage
from waam_plan.fill.strategies import REGISTRY
from waam_plan.layers.restore import plan_restoration
from waam_plan.plan import PlanError, renumber
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, check_chain

S = PlanSettings()
NOMINAL = 0.030  # m, top of the block in conftest.py


def wear(base, bumps, noise, seed):
    """Depth (m) as a callable: base plus Gaussian bumps plus white noise."""

    def depth(x, y):
        rng = np.random.default_rng(seed)
        d = np.full(x.shape, base)
        for cx, cy, radius, height in bumps:
            d = d + height * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / radius**2)
        return d + rng.normal(0, noise, x.shape)

    return depth


BUMP = st.tuples(
    st.floats(0, 0.06), st.floats(0, 0.04), st.floats(0.008, 0.03), st.floats(-0.004, 0.006)
)
WEAR = st.builds(
    wear,
    st.floats(0.0, 0.012),
    st.lists(BUMP, max_size=3),
    st.floats(0, 1e-4),
    st.integers(0, 1000),
)
OPTIONS = st.fixed_dictionaries(
    {
        'alternation': st.sampled_from(['none', 'reverse', 'cross']),
        'stagger': st.booleans(),
        'direction': st.sampled_from(['auto', 'x', 'y']),
    }
)


@given(WEAR, OPTIONS)
@example(
    wear(0.0, [(0.06, 0.0, 0.013907674388933953, 0.003210893950290541)], 0.0, 0),
    {'alternation': 'none', 'stagger': False, 'direction': 'auto'},
)
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_properties_of_any_plan(worn_block, depth, options):
    found, nominal = worn_block(depth)
    s = PlanSettings(**options)
    plan = plan_restoration(found, nominal, s)
    missing = nominal.z - found.z
    laid = np.sum([p.planned for p in plan.layers], axis=0) if plan.layers else 0 * missing
    check_metal(plan, missing, laid)
    metal = found.z.copy()
    for layer in plan.layers:
        metal += layer.planned
        check_layer(plan, layer, metal)


def check_metal(plan, missing, laid):
    """The layers together are the depth, wherever there is a layer and no limit binds."""
    assert not (laid[~plan.region] > 0).any()
    limited = (
        np.any(
            [
                (p.planned == 0) | (p.planned >= 0.999 * 1.4 * S.layer_height)
                for p in plan.layers
                if p.footprint.any()
            ],
            axis=0,
        )
        if plan.layers
        else False
    )
    free = plan.region & ~limited
    np.testing.assert_allclose(laid[free], missing[free], atol=1e-9)
    part = np.isfinite(missing)
    deep = part & (missing > 1.5 * S.layer_height)
    if deep.any() and plan.layers:  # a rim narrower than the wire is left out of a small pit
        wire = round((S.wire_diameter / plan.spec.resolution) ** 2)
        assert (~plan.region[deep]).sum() <= max(0.03 * deep.sum(), wire)


def check_layer(plan, layer, metal):
    """metal: (rows, cols) m, the surface when the layer is laid."""
    check_chain(layer.segments)
    for s in layer.segments:
        s.check()
    assert layer.segments[0].start[2] == layer.segments[-1].end[2] == plan.safe_z
    heights = np.array([s.height for s in layer.deposits])
    assert heights.max() <= 1.4 * S.layer_height + 1e-12
    assert heights.min() >= 0.5 * S.min_layer * S.layer_height - 1e-12
    for s in layer.segments:
        assert s.length <= S.segment_length + 1e-9 or s.kind == Kind.IDLE
        if s.kind == Kind.IDLE and math.dist(s.start[:2], s.end[:2]) > 0:
            assert min(s.start[2], s.end[2]) >= highest(plan, metal, s) + S.clearance - 1e-9
    share, _ = coverage(layer.segments, layer.footprint, plan.spec, S.pitch / 2 + 0.6e-3)
    # a corner narrower than the wire is left out of a small pit
    wire = (S.wire_diameter / plan.spec.resolution) ** 2
    assert (1 - share) * layer.footprint.sum() <= max(0.01 * layer.footprint.sum(), wire)
    inside(plan, layer)
    fine = ~np.isnan(layer.target_before) == layer.footprint
    assert fine.all()
    assert (np.isfinite(layer.target_after) == layer.footprint).all()


def highest(plan, metal, s):
    """Highest metal (m) under a move, -inf where there is none."""
    x, y = (np.linspace(s.start[k], s.end[k], 200) for k in (0, 1))
    row, col = plan.spec.cell(x, y)
    on = (row >= 0) & (row < plan.spec.rows) & (col >= 0) & (col < plan.spec.cols)
    return np.nanmax(metal[row[on], col[on]], initial=-math.inf)


def inside(plan, layer):
    ends = np.array([s.end[:2] for s in layer.deposits])
    row, col = plan.spec.cell(ends[:, 0], ends[:, 1])
    # beads that cover free sides end over them
    over = math.ceil(S.overrun / plan.spec.resolution)
    assert binary_dilation(layer.footprint, iterations=over)[row, col].mean() > 0.995
    # the outline that paths keep to is smooth and cuts cells at its corners
    assert (~layer.footprint[row, col]).sum() <= max(1, 0.03 * len(row))


@given(st.floats(0.0008, 0.02))
@settings(max_examples=15, deadline=None)
def test_even_wear_becomes_equal_layers(worn_block, depth):
    found, nominal = worn_block(depth, size=(0.03, 0.02))
    plan = plan_restoration(found, nominal, replace(S, wear_limit=0.03))
    steps = [p.planned[p.footprint] for p in plan.layers]
    assert all(s.size == plan.region.sum() for s in steps)
    assert len(plan.layers) == pytest.approx(depth / S.layer_height, abs=0.6)
    if depth > 3 * S.layer_height:
        assert np.ptp(np.concatenate(steps)) < 0.04 * S.layer_height
    np.testing.assert_allclose(plan.final_target[plan.region], NOMINAL, atol=1e-12)


def test_segments_carry_the_metal_of_the_map(worn_block):
    found, nominal = worn_block(lambda x, y: 0.004 + 0.003 * np.sin(x / 0.01))
    plan = plan_restoration(found, nominal, S)
    for layer in plan.layers:
        want = layer.planned.sum() * plan.spec.resolution**2 + layer.beside
        assert layer.volume == pytest.approx(want, rel=0.02)
    assert plan.wire * S.wire_area * S.efficiency == pytest.approx(plan.volume)


def test_the_path_lies_on_the_surface_below_it(worn_block):
    found, nominal = worn_block(lambda x, y: 0.004 + 0.05 * x)
    plan = plan_restoration(found, nominal, S)
    for layer in plan.layers:
        under = HeightGrid(plan.spec, layer.target_before)
        for s in layer.deposits[::7]:
            z = float(under.sample(s.end[0], s.end[1]))
            if math.isfinite(z):
                assert s.end[2] == pytest.approx(z, abs=0.5 * S.layer_height)


def test_start_corner_changes_from_layer_to_layer(worn_block):
    found, nominal = worn_block(0.004)
    zigzag = PlanSettings(strategy='zigzag', pitch_ratio=0.73)
    one, two = plan_restoration(found, nominal, zigzag).layers
    a, b = one.deposits[0].start, two.deposits[0].start
    assert a[0] < 0.01 and a[1] < 0.01 and b[0] > 0.05 and b[1] > 0.03
    cross = plan_restoration(found, nominal, PlanSettings(alternation='cross')).layers
    assert [p.direction for p in cross] == [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]


def test_stagger_lays_beads_over_the_valleys(worn_block):
    found, nominal = worn_block(0.004)
    one, two = plan_restoration(
        found, nominal, PlanSettings(strategy='zigzag', stagger=True, pitch_ratio=0.73)
    ).layers

    def lines(layer):
        return np.unique([round(s.end[1], 4) for s in layer.deposits if s.start[1] == s.end[1]])

    below, above = lines(one), lines(two)
    gaps = np.abs(above[1:-1, None] - below[None]).min(axis=1)
    pitch = np.diff(below).mean()
    assert gaps[1:-1] == pytest.approx(pitch / 2, abs=3e-4)
    assert gaps.min() > 0.3 * pitch


def test_one_arc_per_layer_on_a_rectangle(worn_block):
    found, nominal = worn_block(0.004)
    assert [p.arc_starts for p in plan_restoration(found, nominal, S).layers] == [1, 1]


def test_arc_paths_hold_every_metre_of_arc_and_begin_at_every_start(worn_block):
    found, nominal = worn_block(
        lambda x, y: np.where(np.hypot(x - 0.03, y - 0.02) < 0.010, 0.0, 0.002)
    )
    (layer,) = plan_restoration(found, nominal, S).layers
    paths = layer.arc_paths
    assert len(paths) == layer.arc_starts > 1
    burning = [s for s in layer.segments if s.arc]
    steps = np.concatenate([np.linalg.norm(np.diff(p, axis=0), axis=1) for p in paths])
    assert steps == pytest.approx([math.dist(s.start[:2], s.end[:2]) for s in burning])
    assert (paths[0][0] == burning[0].start[:2]).all() and (
        paths[-1][-1] == burning[-1].end[:2]
    ).all()


def test_a_hole_is_not_crossed_with_the_arc_on(worn_block):
    found, nominal = worn_block(
        lambda x, y: np.where(np.hypot(x - 0.03, y - 0.02) < 0.010, 0.0, 0.002)
    )
    (layer,) = plan_restoration(found, nominal, S).layers
    inside(plan_restoration(found, nominal, S), layer)
    middle = np.array([s.midpoint[:2] for s in layer.deposits])
    assert np.hypot(*(middle - (0.03, 0.02)).T).min() > 0.009


def test_thin_metal_is_laid_fast(worn_block):
    found, nominal = worn_block(0.0008)
    (layer,) = plan_restoration(found, nominal, S).layers
    assert np.median([s.speed for s in layer.deposits]) > 1.1 * S.speed
    assert max(s.speed for s in layer.deposits) <= S.speed_max
    assert all(s.speed == s.speed_programmed for s in layer.deposits)


def test_lead_in_and_out_change_the_metal_at_the_ends_only(worn_block):
    found, nominal = worn_block(0.002)
    plain = plan_restoration(found, nominal, S).layers[0].deposits
    led = (
        plan_restoration(found, nominal, PlanSettings(lead_in_metal=0.8, lead_out_metal=1.2))
        .layers[0]
        .deposits
    )
    ratio = np.array([b.height / a.height for a, b in zip(plain, led, strict=True)])
    assert ratio[0] == pytest.approx(0.8)
    assert ratio[-1] >= 1.0
    np.testing.assert_allclose(ratio[5:-5], 1.0)


def test_nothing_missing_gives_an_empty_plan_with_a_warning(worn_block):
    found, nominal = worn_block(0.0002)
    plan = plan_restoration(found, nominal, S)
    assert not plan.layers and not plan.region.any()
    assert 'nothing to restore' in plan.warnings[0]
    assert plan.length == plan.duration == plan.wire == 0


def test_layers_limits_from_the_bottom_and_warns_above(worn_block):
    found, nominal = worn_block(0.008)
    assert len(plan_restoration(found, nominal, S, 2).layers) == 2
    two = plan_restoration(found, nominal, S, 2)
    np.testing.assert_allclose(two.final_target[two.region], NOMINAL - 0.004, atol=1e-5)
    many = plan_restoration(found, nominal, S, 9)
    assert len(many.layers) == 4 and any('9 layers were asked for' in w for w in many.warnings)
    with pytest.raises(PlanError, match='layers'):
        plan_restoration(found, nominal, S, -1)


def test_allowance_is_added_on_top(worn_block):
    found, nominal = worn_block(0.003)
    plan = plan_restoration(found, nominal, PlanSettings(allowance=0.001))
    np.testing.assert_allclose(plan.final_target[plan.region], NOMINAL + 0.001, atol=1e-12)


def test_holes_in_the_scan_are_filled_and_reported_and_too_many_refused(worn_block):
    found, nominal = worn_block(0.004)
    z = found.z.copy()
    z[30:34, 50:60] = np.nan
    plan = plan_restoration(HeightGrid(found.spec, z), nominal, S)
    assert any('not seen by the scan' in w for w in plan.warnings)
    assert plan.region[32, 55]
    z[:, 60:] = np.nan
    with pytest.raises(PlanError, match='the scan misses'):
        plan_restoration(HeightGrid(found.spec, z), nominal, S)


def test_different_grids_and_empty_nominal_are_refused(worn_block):
    found, nominal = worn_block(0.004)
    other = GridSpec(0, 0, 1e-3, *nominal.spec.shape)
    with pytest.raises(PlanError, match='nominal surface on'):
        plan_restoration(HeightGrid(other, found.z), nominal, S)
    with pytest.raises(PlanError, match='nominal surface is empty'):
        plan_restoration(found, HeightGrid.full(nominal.spec), S)


def test_metal_above_nominal_is_reported_with_its_place(worn_block):
    found, nominal = worn_block(
        lambda x, y: np.where((x > 0.02) & (x < 0.04) & (y < 0.02), -0.003, 0.002)
    )
    (text,) = (w for w in plan_restoration(found, nominal, S).warnings if 'above nominal' in w)
    assert '3.00 mm' in text and 'x = ' in text


def test_outside_the_machine_is_refused(worn_block):
    found, nominal = worn_block(0.004)
    with pytest.raises(PlanError, match='x = .* limit in the work frame is 30.0 mm'):
        plan_restoration(found, nominal, PlanSettings(machine_max=(0.03, 0.2, 0.18)))
    with pytest.raises(PlanError, match='z = 40.0 mm'):
        plan_restoration(found, nominal, PlanSettings(machine_max=(0.3, 0.2, 0.035)))


def test_renumber_connects_from_anywhere_without_collision(worn_block):
    found, nominal = worn_block(0.004)
    plan = plan_restoration(found, nominal, S)
    segments = plan.layers[0].segments
    start = (0.2, 0.1, 0.002)
    out = renumber(segments, 17, start, S, plan.safe_z)
    check_chain(out)
    assert out[0].index == 17 and out[0].start == start
    moves = out[: len(out) - len(segments)]
    assert all(m.kind == Kind.IDLE and not m.arc for m in moves)
    travel = [m for m in moves if math.dist(m.start[:2], m.end[:2]) > 0]
    assert min(m.start[2] for m in travel) >= plan.safe_z
    assert renumber([], 5, start, S) == []


def test_renumber_of_a_layer_resumed_in_the_middle(worn_block):
    found, nominal = worn_block(0.004)
    plan = plan_restoration(found, nominal, S)
    segments = plan.layers[0].segments
    beads = [i for i, s in enumerate(segments) if s.kind == Kind.DEPOSIT]
    rest = segments[beads[10] :]
    for out in (
        renumber(rest, 3, (0.0, 0.0, 0.0), S),
        renumber(rest, 3, rest[0].start, S, plan.safe_z),
    ):
        check_chain(out)
        assert out[-len(rest)].start == rest[0].start
        travel = [m for m in out[: -len(rest)] if math.dist(m.start[:2], m.end[:2]) > 0]
        assert all(m.start[2] >= rest[0].start[2] + S.clearance for m in travel)


@pytest.mark.parametrize('options', [{}, {'alternation': 'turn'}, {'strategy': 'contour'}])
def test_a_plan_goes_on_from_layers_that_lie_there(worn_block, options):
    """Layers 3 and 4 of four are those of a plan made when two lie there: same paths, metal and starts."""
    s = PlanSettings(**options)
    found, nominal = worn_block(8e-3)
    whole = plan_restoration(found, nominal, s)
    assert len(whole.layers) == 4
    surface = found.with_z(np.where(np.isfinite(found.z), whole.layers[1].target_after, np.nan))
    below = arc_starts(whole.layers[1].segments)
    rest = plan_restoration(surface, nominal, s, 0, 2, below)
    for mine, theirs in zip(rest.layers, whole.layers[2:], strict=True):
        assert mine.direction == theirs.direction
        pairs = zip(mine.deposits, theirs.deposits, strict=True)
        assert all(a.start == pytest.approx(b.start, abs=1e-6) for a, b in pairs)
    away = np.linalg.norm(arc_starts(rest.layers[0].segments)[:, None] - below, axis=2)
    assert away.min() >= s.start_spread


def test_the_outermost_ring_gets_what_it_can_carry(worn_block):
    """In restorations whose ring is laid last; a factor of one's own replaces the strategy's."""
    found, nominal = worn_block(2.0e-3)

    def ring(**options):
        plan = plan_restoration(found, nominal, PlanSettings(strategy='combined', **options))
        beads = plan.layers[-1].deposits
        return sum(s.length * s.height for s in beads if s.bead == beads[-1].bead), plan

    usual, plan = ring()
    full = ring(edge_metal=1.0)[0]
    assert usual == pytest.approx(REGISTRY['combined'].edge_metal * full, rel=0.01)
    assert ring(edge_metal=0.8)[0] == pytest.approx(0.8 * full, rel=0.01)
    assert not [w for w in plan.warnings if 'limits of layer height' in w]
    assert REGISTRY['zigzag'].edge_metal == 1.0


@pytest.mark.parametrize(('asked', 'inset'), [(0.0, 0.28), (0.5, 0.5)])
def test_the_outermost_ring_of_a_restored_pocket_lies_near_its_edge(worn_block, asked, inset):
    """The surface goes on beside it: a ring half a bead inside leaves a hollow all along the edge."""
    found, nominal = worn_block(0.004)
    s = PlanSettings(strategy='contour', ring_inset=asked, overrun=0.0)
    plan = plan_restoration(found, nominal, s)
    layer, spec = plan.layers[-1], plan.spec
    x, y = np.array([d.start[:2] for d in layer.deposits]).T
    x = x[abs(y - np.median(y)) < 5e-3]  # away from the corners, where gaps get beads of their own
    _, col = np.nonzero(layer.footprint)
    left = spec.origin_x + col.min() * spec.resolution
    assert x.min() - left == pytest.approx(inset * s.bead_width, abs=1.5 * spec.resolution)
