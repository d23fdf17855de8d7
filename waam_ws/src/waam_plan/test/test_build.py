"""Builds from closed meshes: programs that hold, refusals that say why and where."""

import math
import re

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_dilation

from waam_plan.fill.path import coverage
from waam_plan.layers.build import plan_build
from waam_plan.mesh.part import PartError, load_part
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, check_chain

S = PlanSettings()
TALL = PlanSettings(machine_max=(0.3, 0.22, 0.25))


@pytest.fixture
def part(tmp_path):
    def make(mesh, name='part'):
        path = tmp_path / f'{name}.stl'
        mesh.export(path)
        return load_part(path)

    return make


def check(plan, reach=S.pitch / 2 + 0.6e-3):
    for layer in plan.layers:
        check_chain(layer.segments)
        for s in layer.segments:
            s.check()
            if s.kind == Kind.IDLE and math.dist(s.start[:2], s.end[:2]) > 1e-9:
                assert s.start[2] >= layer.target_after[layer.footprint].max() + S.clearance - 1e-9
        assert coverage(layer.segments, layer.footprint, plan.spec, reach)[0] >= 0.99
        ends = np.array([s.end[:2] for s in layer.deposits])
        row, col = plan.spec.cell(*ends.T)
        # bead ends may follow the outline, which cuts cells
        assert binary_dilation(layer.footprint)[row, col].mean() > 0.99
        want = layer.planned.sum() * plan.spec.resolution**2 + layer.beside
        assert layer.volume == pytest.approx(want, rel=0.05)


def test_block(part):
    plan = plan_build(part(trimesh.creation.box(extents=(60, 40, 20))), S)
    check(plan)
    assert len(plan.layers) == 10
    assert plan.offset == pytest.approx((0.03, 0.02, 0.01))
    assert plan.region.sum() * plan.spec.resolution**2 == pytest.approx(0.06 * 0.04, rel=0.01)
    beads = (0.06 + 2 * S.overrun) * (0.04 + 2 * S.overrun)
    assert plan.volume == pytest.approx(beads * 0.02, rel=0.05)
    assert np.nanmax(plan.nominal.z) == pytest.approx(0.020)
    assert np.nanmax(plan.final_target) == pytest.approx(0.020)
    assert [p.arc_starts for p in plan.layers] == [1] * 10
    z = {round(s.end[2], 6) for s in plan.layers[3].deposits}
    assert z == {0.006}


def test_height_is_met_by_equal_layers(part):
    plan = plan_build(part(trimesh.creation.box(extents=(30, 30, 13.2))), S)
    assert len(plan.layers) == 7
    np.testing.assert_allclose([p.planned.max() for p in plan.layers], 0.0132 / 7, atol=1e-9)


def test_layers_from_the_bottom(part):
    block = part(trimesh.creation.box(extents=(30, 30, 20)))
    assert len(plan_build(block, S, 3).layers) == 3
    assert any('99 layers' in w for w in plan_build(block, S, 99).warnings)


def test_block_with_a_hole_keeps_it_open(part):
    plate = trimesh.creation.annulus(r_min=10, r_max=30, height=6)
    plan = plan_build(part(plate), S)
    check(plan)
    for layer in plan.layers:
        middle = np.array([s.midpoint[:2] for s in layer.deposits])
        assert np.hypot(*(middle - 0.03).T).min() > 0.0095


@pytest.mark.parametrize('thickness', [4.5, 6.0, 8.5, 9.0])
def test_thin_tube_is_laid_as_rings(part, thickness):
    tube = trimesh.creation.annulus(r_min=30 - thickness, r_max=30, height=8, sections=96)
    plan = plan_build(part(tube), S)
    check(plan, S.bead_width / 2 + 0.6e-3)
    for layer in plan.layers:
        assert layer.arc_starts == layer.beads == (1 if thickness < 8 else 2)
        first, last = layer.deposits[0], layer.deposits[-1]
        if layer.beads == 1:
            assert math.dist(first.start, last.end) < 1e-6
    seams = {tuple(np.round(p.deposits[0].start[:2], 3)) for p in plan.layers}
    assert len(seams) == len(plan.layers)


@pytest.mark.parametrize('thickness', [9.8, 11.5])
def test_a_tube_too_thick_for_two_rings_is_laid_as_more_in_one_chain(part, thickness):
    tube = trimesh.creation.annulus(r_min=30 - thickness, r_max=30, height=8, sections=96)
    plan = plan_build(part(tube), S)
    check(plan)
    for layer in plan.layers:
        assert layer.arc_starts == 1 and layer.beads >= 3
    seams = {tuple(np.round(p.deposits[0].start[:2], 3)) for p in plan.layers}
    assert len(seams) == len(plan.layers)


def test_single_wall_is_one_bead_along_its_middle(part):
    plan = plan_build(part(trimesh.creation.box(extents=(80, 6, 10))), S)
    for layer in plan.layers:
        assert layer.beads == 1
        y = [s.end[1] for s in layer.deposits]
        np.testing.assert_allclose(y, 0.003, atol=3e-4)
        assert layer.length > 0.07
    ends = [p.deposits[0].start[0] < 0.04 for p in plan.layers]
    assert ends[0] != ends[1]


def half_ring(r_min, r_max, height, n=60):
    """A C-shaped wall, closed: stations of four corners, walls between them, two end caps."""
    angle = np.linspace(0, math.pi, n)
    corners = [(r_min, 0), (r_max, 0), (r_max, height), (r_min, height)]
    vertices = np.array(
        [(r * math.cos(a), r * math.sin(a), z) for a in angle for r, z in corners], float
    )
    faces = [(0, 1, 2), (0, 2, 3)]
    for i in range(0, 4 * (n - 1), 4):
        for j in range(4):
            a, b = i + j, i + (j + 1) % 4
            faces += [(a, a + 4, b + 4), (a, b + 4, b)]
    last = 4 * (n - 1)
    faces += [(last, last + 2, last + 1), (last, last + 3, last + 2)]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return (
        mesh
        if mesh.volume > 0
        else trimesh.Trimesh(vertices, np.array(faces)[:, ::-1], process=False)
    )


def test_curved_wall_follows_its_middle(part):
    plan = plan_build(part(half_ring(27, 33, 6)), S)
    check(plan, S.bead_width / 2 + 1.5e-3)
    for layer in plan.layers:
        assert layer.beads == 1
        r = [math.hypot(s.end[0] - 0.033, s.end[1]) for s in layer.deposits]
        np.testing.assert_allclose(r, 0.030, atol=6e-4)


def test_given_grid_is_used_and_too_small_ones_are_refused(part):
    block = part(trimesh.creation.box(extents=(60, 40, 4)))
    spec = GridSpec.covering(-0.005, -0.005, 0.065, 0.045, 0.5e-3)
    assert plan_build(block, S, 0, spec).spec == spec
    with pytest.raises(PlanError, match='leave the grid'):
        plan_build(block, S, 0, GridSpec.covering(0, 0, 0.05, 0.05, 0.5e-3))


def test_overhang_is_refused_with_angle_and_place(part):
    foot = trimesh.creation.box(extents=(20, 20, 20))
    roof = trimesh.creation.box(extents=(60, 20, 10))
    roof.apply_translation((0, 0, 15))
    with pytest.raises(PlanError) as caught:
        plan_build(part(trimesh.util.concatenate([foot, roof])), S)
    text = str(caught.value)
    assert 'overhang of 8' in text and 'layer 11' in text and '(limit 45 deg)' in text
    assert 'at most 10 layers' in text
    x, y, z = (
        float(v) for v in re.search(r'\(([-\d.]+), ([-\d.]+), ([-\d.]+)\) mm', text).groups()
    )
    assert abs(x) > 10 and abs(y) < 10 and z == pytest.approx(10.0)
    assert len(plan_build(part(trimesh.util.concatenate([foot, roof])), S, 10).layers) == 10


@pytest.mark.parametrize(('lean', 'ok'), [(30, True), (44, True), (50, False), (65, False)])
def test_overhang_limit_follows_the_setting(part, lean, ok):
    block = trimesh.creation.box(extents=(40, 40, 40))
    shear = np.eye(4)
    shear[0, 2] = math.tan(math.radians(lean))
    block.apply_transform(shear)
    flat = PlanSettings(foot_height=0.0)
    if ok:
        plan_build(part(block), flat)
    else:
        with pytest.raises(PlanError, match=f'overhang of {lean}'):
            plan_build(part(block), flat)
        plan_build(part(block), PlanSettings(foot_height=0.0, overhang_limit_deg=lean + 1))


def test_foot_fills_below_low_overhangs(part):
    block = trimesh.creation.icosphere(subdivisions=4, radius=40)
    with pytest.raises(PlanError, match='overhang'):
        plan_build(part(block), PlanSettings(foot_height=0.0), 6)
    plan = plan_build(part(block), PlanSettings(foot_height=0.014), 6)
    check(plan)
    assert any(w.startswith('foot: ') for w in plan.warnings)
    low, high = plan.layers[0].footprint, plan.layers[-1].footprint
    bare = math.pi * (0.040**2 - 0.039**2) / plan.spec.resolution**2
    assert high.sum() > low.sum() > 3 * bare


def test_walls_thinner_than_a_bead_are_refused(part):
    with pytest.raises(PlanError, match=r'about 2.0 mm thick.* too thin for a bead of 6.0 mm'):
        plan_build(part(trimesh.creation.box(extents=(80, 2, 20))), S)


def test_thin_tip_is_left_out_with_a_warning(part):
    cone = trimesh.creation.cone(radius=20, height=40)
    plan = plan_build(part(cone), S)
    assert 15 < len(plan.layers) < 20
    assert any('thinner than a bead and left out' in w for w in plan.warnings)


def test_too_tall_says_how_many_layers_fit(part):
    tower = part(trimesh.creation.box(extents=(20, 20, 60)))
    low = PlanSettings(machine_max=(0.3, 0.22, 0.030))
    with pytest.raises(PlanError, match='plan at most 10 layers'):
        plan_build(tower, low)
    assert len(plan_build(tower, low, 10).layers) == 10


def test_open_mesh_is_refused_as_a_solid_and_built_as_a_shell(tmp_path):
    tube = trimesh.creation.cylinder(radius=30, height=10)
    wall = abs(tube.face_normals[:, 2]) < 0.5
    path = tmp_path / 'shell.stl'
    trimesh.Trimesh(tube.vertices, tube.faces[wall]).export(path)
    shell = load_part(path, require_closed=False)
    with pytest.raises(PartError, match="open mesh.*'shell'"):
        plan_build(shell, S)
    plan = plan_build(shell, PlanSettings(strategy='shell'))
    check(plan)
    for layer in plan.layers:
        r = [math.hypot(s.end[0] - 0.03, s.end[1] - 0.03) for s in layer.deposits]
        np.testing.assert_allclose(r, 0.03, atol=5e-4)
        assert np.mean([s.height for s in layer.deposits]) == pytest.approx(S.layer_height, rel=0.1)


def test_a_gap_in_the_side_is_refused_with_its_height(tmp_path):
    tube = trimesh.creation.cylinder(radius=30, height=10, sections=16)
    faces = tube.faces[abs(tube.face_normals[:, 2]) < 0.5][2:]
    path = tmp_path / 'torn.stl'
    trimesh.Trimesh(tube.vertices, faces).export(path)
    with pytest.raises(PlanError, match=r'section 1.00 mm above .* no closed outline'):
        plan_build(load_part(path, require_closed=False), PlanSettings(strategy='shell'))


RECORDED = [
    ('branches_70_closed_low_res', 0, r'70 features about 2.7 mm thick'),
    ('branches_70_closed_low_res', 1, None),
    ('bunny_closed_low_res', 3, None),
    ('bunny_closed_low_res', 0, r'overhang of 63 deg .* layer 6'),
    ('distorted_v_closed_mid_res', 5, None),
    ('overhang_coin_closed_low_res', 0, r'overhang of 60 deg .* layer 6'),
    ('overhang_coin_closed_low_res', 5, None),
    ('simple_vase_open_low_res', 0, r'open mesh: 188 boundary edges in 2 holes'),
]


@pytest.mark.parametrize(('name', 'layers', 'refusal'), RECORDED)
def test_recorded_parts(meshes, name, layers, refusal):
    path = meshes / f'{name}.stl'
    if refusal:
        with pytest.raises(ValueError, match=refusal):
            plan_build(load_part(path), TALL, layers)
    else:
        check(plan_build(load_part(path), TALL, layers))


def test_recorded_parts_are_too_tall_for_the_default_machine(meshes):
    with pytest.raises(PlanError, match='outside the machine'):
        plan_build(load_part(meshes / 'distorted_v_closed_mid_res.stl'), S)


def test_the_whole_branched_part_in_thick_layers(meshes):
    part = load_part(meshes / 'distorted_v_closed_mid_res.stl', 0.5e-3)
    thick = PlanSettings(layer_height=4e-3, bead_width=10e-3, grid=1e-3, overrun=0.0)
    plan = plan_build(part, thick)
    check(plan, thick.bead_width / 2 + 1e-3)
    assert len(plan.layers) == pytest.approx(99 / 4, abs=3)


def test_open_vase_as_a_shell(meshes):
    part = load_part(meshes / 'simple_vase_open_low_res.stl', require_closed=False)
    plan = plan_build(part, PlanSettings(strategy='shell'), 4)
    check(plan)
    assert [p.arc_starts for p in plan.layers] == [1] * 4


def test_everything_that_is_wrong_with_a_build_is_said_at_once(part):
    foot = trimesh.creation.box(extents=(20, 20, 20))
    roof = trimesh.creation.box(extents=(500, 20, 10))
    roof.apply_translation((0, 0, 15))
    low = PlanSettings(machine_max=(0.3, 0.22, 0.030))
    with pytest.raises(PartError) as caught:
        plan_build(part(trimesh.util.concatenate([foot, roof])), low)
    for words in ('500.0 mm along x', '40.0 mm with clearance', 'overhang of 90 deg'):
        assert words in str(caught.value), words


def test_a_part_too_small_to_spread_its_arc_starts_is_told_so(part):
    post = plan_build(part(trimesh.creation.box(extents=(8, 6, 6))), S)
    found = re.search(
        r'(\d+) arc starts lie nearer than 5 mm .*: (\S+) mm in', ' '.join(post.warnings)
    )
    assert found and 0 < int(found[1]) <= 2
    begun = [p.segments[[s.arc for s in p.segments].index(True)].start[:2] for p in post.layers]
    gaps = [math.dist(a, b) for a, b in zip(begun, begun[1:], strict=False)]
    assert float(found[2]) == pytest.approx(1e3 * min(gaps), abs=0.06)
    block = plan_build(part(trimesh.creation.box(extents=(60, 40, 6))), S)
    assert 'arc starts' not in ' '.join(block.warnings)
