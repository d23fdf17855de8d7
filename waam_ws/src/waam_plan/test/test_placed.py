"""Where files lie, and what does not lie on the part: random parts, shifted, scaled, turned, with faces missing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.agreement import check
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.part import PartError, load_part
from waam_plan.mesh.placed import on_table, surfaces_of
from waam_plan.mesh.surface import behind, top_surface
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid

S = PlanSettings(grid=1e-3)
STEP = 2.0  # mm


def body(heights: np.ndarray, step: float = STEP) -> trimesh.Trimesh:
    """A closed block on z = 0, lower corner at the origin; heights (m, n) mm of its top, on corners `step` mm apart."""
    m, n = heights.shape
    x, y = np.meshgrid(np.arange(m) * step, np.arange(n) * step, indexing='ij')
    top = np.stack([x, y, heights], axis=2).reshape(-1, 3)
    points = np.concatenate([top, top * (1.0, 1.0, 0.0)])
    at = np.arange(m * n).reshape(m, n)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=2).reshape(-1, 4)
    upper = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    rim = np.concatenate([at[:, 0], at[-1, 1:], at[-2::-1, -1], at[0, -2::-1]])
    ends = np.roll(rim, -1)[: len(rim)]
    keep = rim != ends
    rim, ends, under = rim[keep], ends[keep], m * n
    walls = [np.stack([ends, rim, rim + under], 1), np.stack([ends, rim + under, ends + under], 1)]
    faces = np.concatenate([upper, upper[:, ::-1] + under, *walls])
    mesh = trimesh.Trimesh(points, faces, process=True)
    mesh.fix_normals()
    assert mesh.is_watertight and mesh.volume > 0
    return mesh


def worn_plate(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Corner heights (mm) of a plate with a step, and of the same with a worn pocket."""
    m, n = rng.integers(22, 30), rng.integers(16, 22)
    nominal = np.full((m, n), rng.uniform(14, 22))
    nominal[: m // 3] -= rng.uniform(3, 6)  # a lower shoulder: which end is which can be seen
    u, v = np.meshgrid(np.linspace(-1, 1, m), np.linspace(-1, 1, n), indexing='ij')
    wear = rng.uniform(2.5, 6) * np.clip(1.6 * (1 - np.hypot(u - 0.2, v) ** 2), 0, 1)
    return nominal, nominal - np.where(u > -0.2, wear, 0.0)


def without_face(mesh: trimesh.Trimesh, x: float, y: float) -> trimesh.Trimesh:
    """The mesh without the face of its top at a place (mm)."""
    up = mesh.face_normals[:, 2] > 0.5
    away = np.hypot(*(mesh.triangles_center[:, :2] - (x, y)).T)
    gone = np.argmin(np.where(up, away, np.inf))
    return trimesh.Trimesh(mesh.vertices, np.delete(mesh.faces, gone, axis=0), process=False)


def written(folder: Path, name: str, mesh: trimesh.Trimesh) -> Path:
    file = folder / f'{name}.stl'
    mesh.export(file)
    return file


def planned(part: Path, worn: Path, scale: float = 1e-3):
    """As `waam plan`."""
    surfaces = surfaces_of(load_part(part, scale, require_closed=False), worn, scale, S)
    return plan_restoration(surfaces.found, surfaces.nominal, S)


def planned_on_table(part: Path, worn: Path, scale: float = 1e-3):
    """As a job that scans, without an error, what lies in the simulated cell."""
    nominal = load_part(part, scale, require_closed=False)
    table = on_table(nominal, worn, scale, S, cell=0.5e-3)
    size = nominal.bounds[1] - nominal.bounds[0]
    m = S.margin
    spec = GridSpec.covering(-m, -m, size[0] + m, size[1] + m, S.grid)
    x, y = np.meshgrid(spec.x, spec.y)
    found = HeightGrid(spec, table.heights.sample(x, y))
    wanted = top_surface(nominal.mesh, spec, tuple(-nominal.bounds[0]))
    return plan_restoration(found, wanted, S)


@given(st.integers(0, 10**6), st.booleans(), st.booleans(), st.booleans())
@settings(max_examples=12, deadline=None)
def test_plan_and_cell_place_the_same_files_alike(tmp_path_factory, seed, hole, moved, metres):
    """Whatever of the worn part's own box is missing, and wherever both files lie."""
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp('part')
    nominal, worn = (body(h) for h in worn_plate(rng))
    whole = planned(written(folder, 'n', nominal), written(folder, 'w', worn))
    if hole:
        worn = without_face(worn, *(rng.uniform(0.3, 0.7, 2) * worn.extents[:2]))
    shift = rng.uniform(-200, 200, 3) if moved else np.zeros(3)
    scale = 1.0 if metres else 1e-3
    for mesh in (nominal, worn):
        mesh.apply_translation(shift)
        mesh.apply_scale(1e-3 / scale)
    files = written(folder, 'nominal', nominal), written(folder, 'worn', worn)
    plan, there = planned(*files, scale), planned_on_table(*files, scale)
    assert len(plan.layers) == len(there.layers) == len(whole.layers)
    assert there.volume == pytest.approx(plan.volume, rel=0.02)
    assert plan.volume == pytest.approx(whole.volume, rel=0.04)
    assert any('not seen' in w for w in plan.warnings) == hole


def test_a_worn_part_that_lacks_its_floor_or_an_end_is_not_moved(tmp_path):
    """The bounding box of the worn mesh is its own: it says nothing about the work zero."""
    nominal, worn = (body(h) for h in worn_plate(np.random.default_rng(3)))
    part = written(tmp_path, 'nominal', nominal)
    whole = planned(part, written(tmp_path, 'whole', worn))
    cut = worn.slice_plane((6, 0, 5), (0, 0, 1)).slice_plane((3, 0, 0), (1, 0, 0))
    file = written(tmp_path, 'cut', cut)
    for plan in (planned(part, file), planned_on_table(part, file)):
        assert len(plan.layers) == len(whole.layers)
        assert plan.volume == pytest.approx(whole.volume, rel=0.03)


# ---- what is missing


def test_a_hole_is_not_seen_and_told_with_place_and_area(tmp_path):
    worn = body(np.full((8, 6), 16.0), 6.0)
    file = written(tmp_path, 'worn', without_face(worn, 21.0, 13.0))
    part = written(tmp_path, 'nominal', body(np.full((8, 6), 20.0), 6.0))
    plan = planned(part, file)
    (told,) = (w for w in plan.warnings if 'not seen' in w)
    assert re.search(r'1\d mm2 at x = 2\d\.\d mm, y = 1\d\.\d mm', told)
    assert plan.layers[-1].planned.max() < 3e-3 and len(plan.layers) == 2
    (note,) = on_table(load_part(part), file, 1e-3, S, cell=1e-3).notes
    assert re.search(r'1\d(\.\d)? mm2 at x = 2', note)


@given(st.booleans(), st.integers(0, 2**20))
@settings(max_examples=10, deadline=None)
def test_a_hole_is_one_however_the_mesh_is_wound(inside_out, seed):
    rng = np.random.default_rng(seed)
    mesh = without_face(body(np.full((11, 9), 12.0)), 11.0, 9.0)
    if inside_out:
        mesh.invert()
    turned = rng.random(len(mesh.faces)) < 0.3 * (seed % 2)
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    mesh = trimesh.Trimesh(mesh.vertices, faces, process=False)
    spec = GridSpec.covering(0, 0, 20, 16, 0.5)
    assert 4 <= behind(mesh, spec).sum() <= 12
    assert not behind(body(np.full((11, 9), 12.0)), spec).any()
    z = top_surface(mesh, spec).z
    assert np.nanmin(z) == np.nanmax(z) == 12.0


def test_an_open_sheet_has_no_holes():
    sheet = body(np.full((5, 5), 3.0)).slice_plane((0, 0, 2.9), (0, 0, 1))
    spec = GridSpec.covering(0, 0, 8, 8, 0.5)
    assert not behind(sheet, spec).any()
    sheet.invert()
    assert not behind(sheet, spec).any() and top_surface(sheet, spec).coverage == 1.0


def test_a_nominal_part_open_above_is_refused(tmp_path):
    part = written(tmp_path, 'n', without_face(body(np.full((8, 6), 20.0), 6.0), 21.0, 13.0))
    worn = written(tmp_path, 'w', body(np.full((8, 6), 16.0), 6.0))
    for place in (planned, planned_on_table):
        with pytest.raises(PartError, match=r'open above.*1\d(\.\d)? mm2 at x = 2.*--repair'):
            place(part, worn)


# ---- what does not lie on the part


def sheared(rng: np.random.Generator) -> np.ndarray:
    """Corner heights (mm) of an L-shaped step, which is its own mirror image in no way."""
    heights = np.full((26, 20), 12.0)
    heights[:9] = 22.0
    heights[:, :6] = 18.0
    return heights + rng.uniform(0, 0.2, heights.shape)


@pytest.mark.parametrize(
    ('change', 'told'),
    [
        (lambda z: z - 20.0, r'wholly below.*covers 100% of the part and lies 2\d\.\d mm below'),
        (lambda z: z + 20.0, r'wholly above.*1\d\.\d mm above nominal'),
        (lambda z: z[::-1], 'mirrored in x'),
        (lambda z: z[:, ::-1], 'mirrored in y'),
        (lambda z: z[::-1, ::-1], 'turned by 180 deg'),
        (lambda z: 30.0 - z, 'z inverted'),
        (lambda z: -z, 'z inverted|wholly below'),
    ],
)
def test_a_scan_that_is_not_of_this_part_is_refused_by_what_was_found(change, told):
    rng = np.random.default_rng(11)
    spec = GridSpec(0.0, 0.0, 1e-3, 20, 26)
    wanted = sheared(rng).T * 1e-3
    worn = wanted - np.clip(rng.normal(2e-3, 0.3e-3, wanted.shape), 0, None)
    check(HeightGrid(spec, worn), HeightGrid(spec, wanted), S, 0.0)
    found = change(worn.T * 1e3).T * 1e-3
    with pytest.raises(PlanError, match=told) as refused:
        check(HeightGrid(spec, found), HeightGrid(spec, wanted), S)
    assert 'same coordinates' in str(refused.value)


@given(st.integers(0, 10**6))
@settings(max_examples=200, deadline=None)
def test_no_wear_is_taken_for_another_place(seed):
    """Any pocket, any slope of wear up to 12 mm, on any step: it is worn, and not misplaced."""
    rng = np.random.default_rng(seed)
    spec = GridSpec(0.0, 0.0, 1e-3, 24, 30)
    x, y = np.meshgrid(spec.x, spec.y)
    wanted = 0.03 + np.where(x > rng.uniform(0, 0.03), rng.uniform(-8e-3, 8e-3), 0.0)
    depth = rng.uniform(0, 6e-3) + rng.uniform(0, 6e-3) * np.sin(60 * (x + rng.uniform() * y)) ** 2
    worn = wanted - np.where(y > rng.uniform(-0.01, 0.02), depth, 0.0)
    worn += rng.normal(0, 0.1e-3, worn.shape)
    check(HeightGrid(spec, worn), HeightGrid(spec, wanted), S, 0.0)


def test_hardly_any_overlap_is_refused_with_what_was_found(tmp_path):
    nominal, worn = (body(h) for h in worn_plate(np.random.default_rng(5)))
    part = written(tmp_path, 'nominal', nominal)
    for shift, told in (
        (30.0, r'misses \d\d%.*covers \d+% of the part'),
        (900.0, 'no cell in common'),
    ):
        aside = worn.copy()
        aside.apply_translation((shift, 0, 0))
        for place in (planned, planned_on_table):
            with pytest.raises(PlanError, match=told):
                place(part, written(tmp_path, 'aside', aside))


def test_a_part_upside_down_shows_nothing_of_itself(tmp_path):
    part = written(tmp_path, 'nominal', body(np.full((21, 16), 12.0)))
    down = body(np.full((21, 16), 11.0))
    down.vertices[:, 2] *= -1
    with pytest.raises(PlanError, match='nothing of the part stands in the scan'):
        planned(part, written(tmp_path, 'down', down))


def test_so_much_wear_can_be_asked_for():
    spec = GridSpec(0.0, 0.0, 1e-3, 20, 26)
    found, wanted = HeightGrid.full(spec, 0.04), HeightGrid.full(spec, 0.06)
    with pytest.raises(PlanError, match=r'wear_limit \(now 15 mm\)'):
        check(found, wanted, S)
    check(found, wanted, PlanSettings(wear_limit=0.025))
