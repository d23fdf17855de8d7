"""Planning rules of source 003 that are off by default: shape of the part, ways to a bead, repeated beads, levels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box

from waam_plan.lay.approach import Ground, laid_again
from waam_plan.lay.build import plan_build
from waam_plan.lay.coverage import Section
from waam_plan.lay.restore import plan_restoration
from waam_plan.lay.shapes import stiffened, with_teardrops
from waam_plan.mesh.deform import Displacements, displacements, predeformed
from waam_plan.mesh.part import PartError, load_part
from waam_plan.plan import PlanError
from waam_plan.post.compact import fragments, saving
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

S = PlanSettings(grid=1e-3)


@pytest.fixture
def part_of(tmp_path):
    def make(mesh, name='part'):
        file = tmp_path / f'{name}.stl'
        mesh.export(file)
        return load_part(file)

    return make


def block(x, y, z):
    return trimesh.creation.box(bounds=[[0, 0, 0], [x, y, z]])


# ---- shape -------------------------------------------------------------------------------------


def test_a_build_is_larger_by_what_it_shrinks(part_of):
    part = part_of(block(40, 30, 8))
    fine = replace(S, grid=0.25e-3)
    plain, larger = (plan_build(part, replace(fine, shrinkage=s)) for s in (0.0, 0.05))
    areas = [p.layers[0].footprint.sum() for p in (plain, larger)]
    assert areas[1] / areas[0] == pytest.approx(1 / 0.95**2, rel=0.01)
    tops = [float(np.nanmax(p.final_target)) for p in (plain, larger)]
    assert tops[1] / tops[0] == pytest.approx(1 / 0.95)
    assert larger.remarks == ['scaled by 1.0526 against a shrinkage of 5.00%'] and not plain.remarks


def extent(plan):
    ends = np.array([s.end for layer in plan.layers for s in layer.deposits])
    return ends[:, 0].min(), ends[:, 0].max(), ends[:, 1].min(), ends[:, 1].max()


@given(st.floats(-0.02, 0.02), st.floats(-0.3, 0.3), st.integers(4, 8))
@settings(max_examples=5, deadline=None)
def test_what_the_field_moves_a_bent_part_comes_out_as_wanted(stretch, sag, n):
    part = PARTS['bar']
    x, y, z = (v.ravel() for v in np.meshgrid(*[np.linspace(-0.01, 0.11, n)] * 3))
    places = np.column_stack([x, y, z])

    def moves(p):
        return np.column_stack([stretch * p[:, 0], 0 * p[:, 1], sag * p[:, 0] ** 2])

    field = Displacements(places, moves(places))
    bent, most = predeformed(part, field, 0.01)
    vertices = np.asarray(bent.mesh.vertices)
    back = vertices + field.at(vertices)
    wanted, _ = predeformed(part, Displacements(places, 0 * places), 0.01)
    assert np.abs(back - wanted.mesh.vertices).max() < 2e-6
    exact = vertices + moves(vertices)  # the field between its samples
    assert np.abs(exact - wanted.mesh.vertices).max() < 2e-4
    assert bent.mesh.is_watertight and most == pytest.approx(np.abs(moves(vertices)).max(), rel=0.5)


class _Parts(dict):
    def __missing__(self, name):
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            block(100, 20, 10).export(f'{folder}/bar.stl')
            self[name] = load_part(f'{folder}/bar.stl')
        return self[name]


PARTS = _Parts()


def test_a_flat_or_single_field_is_one_too():
    flat = Displacements(
        np.array([[0.0, 0, 0], [0.1, 0, 0]]), np.array([[0.0, 0, 0], [0, 0, 1e-3]])
    )
    at = flat.at(np.array([[0.0, 0, 0], [0.05, 0, 0], [0.1, 0, 0]]))
    assert at[:, 2] == pytest.approx([0.0, 0.5e-3, 1e-3], abs=1e-9)
    one = Displacements(np.zeros((1, 3)), np.array([[1e-3, 0, 0]]))
    assert one.at(np.ones((2, 3)))[:, 0] == pytest.approx([1e-3, 1e-3])


def test_a_field_that_folds_the_part_is_refused():
    places = np.column_stack([np.linspace(0, 0.1, 9), np.zeros(9), np.zeros(9)])
    field = Displacements(places, np.column_stack([3 * places[:, 0], np.zeros((9, 2))]))
    with pytest.raises(PartError, match='the part would be folded'):
        predeformed(PARTS['bar'], field, 0.02)


def test_displacements_are_read_with_their_scale():
    field = displacements(
        ['# x y z dx dy dz', '1, 2, 3, 0.1, 0, -0.1', '', '4 5 6 0 0 0'], 1e-3, 'f'
    )
    assert field.places[0] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert field.moves[0] == pytest.approx([1e-4, 0, -1e-4])


@pytest.mark.parametrize(
    'lines, told',
    [
        (['1 2 3'], 'f.csv, line 1: 3 numbers, wanted x y z dx dy dz'),
        (['0 0 0 0 0 0', '1 2 3 4 5 six'], "f.csv, line 2: 'six' is no finite number"),
        (['0 0 0 0 0 nan'], "line 1: 'nan' is no finite number"),
        (['0 0 0 0 0 0', '0 0 0 1 0 0'], 'line 2: this place has been given another move'),
        (['# nothing'], 'f.csv: no displacements'),
        (['1,5 2,5 3,5'], 'f.csv, line 1: decimal commas'),
    ],
)
def test_bad_displacements_are_refused_with_their_line(lines, told):
    with pytest.raises(PartError, match=told):
        displacements(lines, 1.0, 'f.csv')


@given(
    st.lists(st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=40), max_size=4)
)
@settings(max_examples=40, deadline=None)
def test_any_text_is_a_field_or_refused(lines):
    try:
        assert np.isfinite(displacements(lines, 1e-3, 'f').places).all()
    except PartError as e:
        assert str(e).startswith('f')


def test_a_compensation_layer_lies_below_the_part(part_of):
    part = part_of(block(30, 24, 6))
    plain = plan_build(part, S)
    raised = plan_build(part, replace(S, compensation_height=12e-3))
    assert len(raised.layers) == len(plain.layers) + 6
    assert np.nanmax(raised.final_target) == pytest.approx(np.nanmax(plain.final_target) + 12e-3)
    assert raised.offset[2] == pytest.approx(plain.offset[2] + 12e-3)
    for n, p in enumerate(raised.layers):
        assert p.number == n + 1
        assert (p.footprint == plain.layers[0].footprint).all()
    assert 'compensation layer: 12.0 mm in 6 layers' in raised.remarks[0]
    assert len(plan_build(part, replace(S, compensation_height=12e-3), 2).layers) == 2


def test_a_hole_that_lies_on_its_side_ends_in_a_point(part_of):
    part = part_of(bored_wall())
    with pytest.raises(PlanError, match='overhang'):
        plan_build(part, S)
    plan = plan_build(part, replace(S, teardrop=True))
    assert any('teardrop holes' in r for r in plan.remarks)
    assert plan.layers[-1].footprint.sum() > 0.95 * plan.layers[0].footprint.sum()


def bored_wall(n=64):
    """60 x 14 x 44 mm with a bore of 24 mm through its thickness."""
    t = np.linspace(0, 2 * np.pi, n, endpoint=False) + np.pi / n
    c, s = np.cos(t), np.sin(t)
    inner = np.column_stack([30 + 12 * c, 18 + 12 * s])
    reach = np.minimum(30 / np.abs(c), np.where(s > 0, 26, 18) / np.abs(s))
    outer = np.column_stack([30 + reach * c, 18 + reach * s])
    for corner in ((0, 0), (60, 0), (60, 44), (0, 44)):  # the rays next to the corners go to them
        outer[np.linalg.norm(outer - corner, axis=1).argmin()] = corner
    rings = [(r, y) for y in (0.0, 14.0) for r in (inner, outer)]
    vertices = np.concatenate(
        [np.column_stack([r[:, 0], np.full(n, y), r[:, 1]]) for r, y in rings]
    )
    faces = []
    for a, b in ((0, 1), (3, 2), (1, 3), (2, 0)):  # front, back, outside, bore
        for i in range(n):
            j = (i + 1) % n
            p, q, u, v = a * n + i, a * n + j, b * n + i, b * n + j
            faces += [[p, u, v], [p, v, q]]
    mesh = trimesh.Trimesh(vertices, faces)
    mesh.fix_normals()
    return mesh


def sections_of(*rows):
    return [Section(n + 1, n * 2e-3, 2e-3, list(polygons)) for n, polygons in enumerate(rows)]


def test_roofs_are_left_out_until_they_carry_themselves():
    gap = [[box(0, 0, 0.02, 0.01), box(0.04, 0, 0.06, 0.01)]]
    whole = [[box(0, 0, 0.06, 0.01)]] * 6
    remarks: list[str] = []
    out = with_teardrops(sections_of(*gap, *whole), S, remarks)
    widths = [0.06 - sum(p.area for p in s.polygons) / 0.01 for s in out]
    assert widths == pytest.approx([0.02, 0.016, 0.012, 0.008, 0.004, 0.0, 0.0], abs=1e-4)
    assert 'z = 4.0 and 10.0 mm' in remarks[0]


def test_what_juts_out_is_no_roof():
    out = sections_of([box(0, 0, 0.02, 0.01)], [box(0, 0, 0.05, 0.01)])
    assert with_teardrops(out, S, []) == out
    hook = box(0, 0, 0.06, 0.06).difference(box(0.01, 0.02, 0.05, 0.06))
    inwards = hook.union(box(0.01, 0.04, 0.03, 0.06))
    out = sections_of([hook], [inwards], [inwards])
    assert with_teardrops(out, S, []) == out


def test_thin_walls_get_ribs_and_thick_ones_none():
    ring = box(0, 0, 0.08, 0.08).difference(box(0.005, 0.005, 0.075, 0.075))
    remarks: list[str] = []
    out = stiffened(sections_of([ring], [ring]), replace(S, stiffener_spacing=0.04), remarks)
    assert '8 stiffeners' in remarks[0]
    for s in out:
        extra = sum(p.area for p in s.polygons) - ring.area
        assert extra == pytest.approx(8 * 6e-3 * 10e-3, rel=0.02)
        x0, y0, x1, y1 = s.polygons[0].bounds
        assert (x0, y0, x1, y1) == pytest.approx((-0.01, -0.01, 0.09, 0.09), abs=1e-4)
    thick = sections_of([box(0, 0, 0.08, 0.08)])
    assert stiffened(thick, replace(S, stiffener_spacing=0.04), remarks) == thick
    assert 'no stiffeners' in remarks[-1]


def test_a_wall_with_ribs_can_be_planned(part_of):
    tube = trimesh.creation.annulus(r_min=25, r_max=30, height=6, sections=64)
    plan = plan_build(part_of(tube), replace(S, stiffener_spacing=0.06))
    x0, x1, _, _ = extent(plan)
    assert x1 - x0 > 0.062  # a plain one: 55 mm between the middles of the wall


# ---- ways and passes -----------------------------------------------------------------------------


@pytest.mark.parametrize('strategy', ['zigzag', 'contour'])
def test_beads_are_reached_and_left_along_their_direction(strategy, part_of):
    part = part_of(block(40, 30, 4))
    far = replace(S, strategy=strategy, machine_min=(-0.1, -0.1, -0.02))
    plan = plan_build(part, replace(far, tangent_in=10e-3, tangent_out=10e-3))
    plain = plan_build(part, far)
    found = [leads(p) for p in plan.layers]
    assert sum(len(into) + len(off) for into, off in found) >= 3
    for p, q in zip(plan.layers, plain.layers, strict=True):
        assert [(s.start, s.end, s.height) for s in p.deposits] == [
            (s.start, s.end, s.height) for s in q.deposits
        ]
        laid: list[Segment] = []
        for s, t in zip(p.segments, p.segments[1:], strict=False):
            laid += [s] if s.arc else []
            assert math.dist(s.end, t.start) < 1e-9
            if level(s) and (t.arc or s.start[2] == s.end[2] == laid[-1].end[2]):
                assert s.speed == (t if t.arc else laid[-1]).speed and s.length <= 10e-3 + 1e-9
                assert_free(s, laid, 0.0 if t.arc else 6e-3)


def level(s):
    return s.kind == Kind.IDLE and s.start[2] == s.end[2] and s.length < 11e-3


def leads(layer):
    """Level ways that begin or end at a bead, in its direction."""
    pairs = list(zip(layer.segments, layer.segments[1:], strict=False))
    into = [s for s, t in pairs if level(s) and t.arc and straight(s, t)]
    off = [t for s, t in pairs if s.arc and level(t) and straight(s, t)]
    return into, off


def straight(s, t):
    a, b = (np.subtract(m.end, m.start) / m.length for m in (s, t))
    return float(a @ b) > 1 - 1e-6


def assert_free(way, beads, own):
    """No bead that lies there touches the way; at its begin, `own` m, the bead that ends there may."""
    for share in np.linspace(0, 1, 9):
        if own and share * way.length <= own:
            continue
        p = np.array(way.start[:2]) * (1 - share) + np.array(way.end[:2]) * share
        for s in beads:
            a, b = np.array(s.start[:2]), np.array(s.end[:2])
            t = np.clip((p - a) @ (b - a) / max((b - a) @ (b - a), 1e-18), 0, 1)
            assert np.linalg.norm(a + t * (b - a) - p) > 2.9e-3


def test_ways_end_before_metal_beads_and_the_machine():
    spec = GridSpec(0.0, 0.0, 1e-3, 60, 60)
    beside = np.full(spec.shape, -np.inf)
    beside[:, 30:] = 5e-3
    ground = Ground(spec, beside, replace(S, machine_min=(0.0, 0.0, -0.02)))
    east, west = np.array([1.0, 0.0]), np.array([-1.0, 0.0])
    assert ground.lead((0.020, 0.03, 0.0), east, 0.02) == pytest.approx(9.5e-3, abs=1e-3)
    assert ground.lead((0.020, 0.03, 5e-3), east, 0.02) == pytest.approx(0.02)
    assert ground.lead((0.004, 0.03, 0.0), west, 0.02) == pytest.approx(4e-3, abs=1e-3)
    ground.lay([deposit((0.010, 0.0), (0.010, 0.06))])
    assert ground.lead((0.020, 0.03, 0.0), west, 0.02) == pytest.approx(5.5e-3, abs=1e-3)
    assert ground.lead((0.0105, 0.03, 0.0), west, 0.02) == 0.0


def deposit(a, b, bead=1):
    return Segment(0, Kind.DEPOSIT, (*a, 0.0), (*b, 0.0), 0.01, arc=True, bead=bead, height=2e-3)


def test_beads_beside_what_carries_them_are_laid_again():
    spec = GridSpec(0.0, 0.0, 1e-3, 20, 20)
    carried = np.zeros(spec.shape, bool)
    carried[:, :10] = True
    inner = [deposit((0.002, 0.001), (0.002, 0.019))]
    outer = [deposit((0.015, 0.001), (0.015, 0.010)), deposit((0.015, 0.010), (0.015, 0.019))]
    out = laid_again([inner, outer], carried, spec, 3)
    assert [len(r) for r in out] == [1, 2, 2, 2]
    assert out[2][0].start == outer[-1].end and out[2][-1].end == outer[0].start
    assert out[3] == outer
    assert laid_again([inner, outer], carried, spec, 1) == [inner, outer]


def test_a_cone_that_widens_gets_its_outer_bead_twice(part_of):
    cone = trimesh.creation.cylinder(radius=20, height=12, sections=64)
    top = cone.vertices[:, 2] > 0
    cone.vertices[top, :2] *= 1.45
    steep = replace(S, strategy='contour', foot_height=0.0, finish_layers=0)
    part = part_of(cone)
    once, twice = (plan_build(part, replace(steep, overhang_passes=n)) for n in (1, 2))
    assert once.layers[0].volume == pytest.approx(twice.layers[0].volume)
    more = [b.volume / a.volume for a, b in zip(once.layers, twice.layers, strict=True)]
    assert all(1.0 <= m < 1.6 for m in more)


# ---- levels --------------------------------------------------------------------------------------


@pytest.mark.parametrize('strategy', ['contour', 'spiral', 'combined', 'solid'])
def test_multi_level_growth_repeats_with_every_strategy(strategy, part_of):
    disc = trimesh.creation.cylinder(radius=16, height=16, sections=64)
    disc.vertices[disc.vertices[:, 2] > 0, :2] *= 0.97  # leans by 0.06 mm a layer
    part = part_of(disc)
    grown = replace(S, strategy=strategy, growth_step=0.3e-3, finish_layers=0)
    single, multi = (plan_build(part, replace(grown, multi_level=m)) for m in (False, True))
    counts = [saving(p, fragments(p)).after for p in (single, multi)]
    assert counts[1] <= counts[0] and len(fragments(multi)) <= 5 < len(multi.layers)
    for a, b in zip(single.layers, multi.layers, strict=True):
        edge = [np.array([s.end for s in p.deposits])[:, :2] for p in (a, b)]
        reach = [np.linalg.norm(e - e.mean(axis=0), axis=1).max() for e in edge]
        assert abs(reach[0] - reach[1]) < 1.2e-3
    starts = [p.arc_paths[0][0] for p in multi.layers]
    apart = [math.dist(a, b) for a, b in zip(starts, starts[1:], strict=False)]
    assert min(apart) > 4.9e-3


def test_a_repeated_layer_lights_the_arc_as_often_as_the_one_it_repeats(part_of):
    """Rings of a roof, whose lines follow each other with ends that differ in the last bit."""
    roof = trimesh.creation.box(bounds=[[0, 0, 0], [40, 30, 40]])
    high = roof.vertices[:, 2] > 0
    roof.vertices[high, 0] = np.where(roof.vertices[high, 0] > 20, 34, 6)
    grown = replace(S, strategy='contour', growth_step=1e-3, multi_level=True)
    plan = plan_build(part_of(roof), grown)
    assert len(fragments(plan)) < len(plan.layers) - 5
    assert plan.remarks[-1].startswith('multi-level growth: ')
    assert {layer.arc_starts for layer in plan.layers} == {1}


# ---- off ---------------------------------------------------------------------------------------


def test_a_restoration_refuses_what_only_builds_know(worn_block):
    with pytest.raises(PlanError, match='shrinkage, teardrop: only a build knows this'):
        plan_restoration(*worn_block(0.002), replace(S, shrinkage=0.01, teardrop=True))
