"""Programs of others as plans: their path stays, their wire is the base feed, layers and surfaces follow from them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.fill.path import Pieces
from waam_plan.gcode.program import compact_gcode, gcode
from waam_plan.import_gcode.dialect import Dialect, dialect_of
from waam_plan.import_gcode.files import load_dialect, load_program
from waam_plan.import_gcode.layers import layers_of, moved
from waam_plan.import_gcode.motion import Program
from waam_plan.import_gcode.place import part_offset, path_box
from waam_plan.import_gcode.plan_of import plan_program
from waam_plan.import_gcode.reader import read_program
from waam_plan.import_gcode.regime import regime_problems
from waam_plan.import_gcode.words import ProgramError
from waam_plan.layers.allocate import unevenness
from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan, PlanError, base_feed
from waam_plan.settings import PlanSettings
from waam_process import materials
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, check_chain

OURS = load_dialect('waam')
S = PlanSettings()
SPEC = GridSpec.covering(-0.01, -0.01, 0.06, 0.04, 0.5e-3)
PLATE = HeightGrid.full(SPEC, 0.0)


def wall(heights=(0, 2), lift=12, dialect: Dialect = OURS, marks=True) -> Program:
    """Two beads side by side per layer, 4 mm apart."""
    text = ['W4646', 'S22', 'F600', f'G0 Z{lift}']
    for k, z in enumerate(heights, 1):
        text += [f'; layer {k}'] * marks
        for y in (0, 4):
            text += [f'G0 X0 Y{y}', f'G1 Z{z}', 'M3', 'G1 X40', 'M5', f'G0 Z{z + lift}']
    return read_program('\n'.join(text), dialect, 'wall.gcode')


def chained(plan: Plan) -> None:
    for layer in plan.layers:
        check_chain(layer.segments)
        assert {s.layer for s in layer.segments} == {layer.number}


def path_of(plan: Plan) -> list[np.ndarray]:
    """Corners (n, 3) of every stretch with the arc on."""
    out: list[list[tuple]] = []
    burning = False
    for s in (s for layer in plan.layers for s in layer.segments):
        if s.arc:
            if not burning:
                out.append([s.start])
            out[-1].append(s.end)
        burning = s.arc
    return [np.array(p) for p in out]


def test_layers_metal_and_surfaces_of_a_wall():
    plan = plan_program(wall(), S, PLATE)
    chained(plan)
    assert [layer.beads for layer in plan.layers] == [2, 2]
    for s in (s for layer in plan.layers for s in layer.deposits):
        assert base_feed(s, plan.settings) == pytest.approx(4.646 / 60, rel=1e-9)
        assert s.wire_feed_speed == pytest.approx(4.646 / 60) and s.voltage == 22
        assert s.length <= S.segment_length + 1e-9
    first, second = plan.layers
    on = first.footprint & second.footprint
    assert np.nanmax(np.abs(first.target_after[on] - 0.002)) < 1e-9
    assert first.planned[on] == pytest.approx(0.002) and (first.target_before[on] == 0).all()
    assert second.target_before[on] == pytest.approx(0.002)
    assert first.volume == pytest.approx(first.planned.sum() * SPEC.resolution**2, rel=0.15)
    assert plan.region[on].all() and plan.interior.sum() < plan.region.sum()
    assert abs(first.direction[0]) == pytest.approx(1)


def test_the_nominal_part_ends_the_last_layer_and_bounds_what_is_judged():
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    inside = (x > 0.005) & (x < 0.035) & (y > 0) & (y < 0.004)
    nominal = HeightGrid(SPEC, np.where(inside, 0.0035, np.nan))
    plan = plan_program(wall(), S, PLATE, nominal)
    last = plan.layers[-1]
    assert last.target_after[inside] == pytest.approx(0.0035)
    assert last.planned[inside] == pytest.approx(0.0015)
    assert (plan.region == inside).all()
    assert plan.final_target[inside] == pytest.approx(0.0035)
    elsewhere = HeightGrid(SPEC, np.where(inside, 0.03, np.nan))
    with pytest.raises(PlanError, match=r'wall\.gcode: the nominal part does not end where'):
        plan_program(wall(), S, PLATE, elsewhere)


def test_layers_by_height_where_nothing_marks_them():
    assert [len(layer.beads) for layer in layers_of(wall((0, 2, 4), marks=False))] == [2, 2, 2]
    with pytest.raises(ProgramError, match=r'line 20: a bead at z = 0\.00 mm after one at 2\.00'):
        layers_of(wall((2, 0), marks=False))
    rising = 'G0 X0 Y0 Z0\nW5000\nM3\nG1 X40 Z2 F600\nM5'
    with pytest.raises(ProgramError, match='line 4: the bead rises by 2.00 mm'):
        layers_of(read_program(rising, OURS))


def test_moves_of_the_program_between_beads_stay_unless_the_dialect_lifts_them():
    kept = plan_program(wall(lift=3), S, PLATE)
    assert highest_between(kept) == pytest.approx(0.003)
    lifting = dialect_of(
        {
            'arc_on': 'M3',
            'arc_off': 'M5',
            'wire': {'word': 'W', 'unit': 'mm/min'},
            'voltage': {'word': 'S'},
            'idle': 'lift',
        },
        'lifting',
    )
    lifted = plan_program(wall(lift=3, dialect=lifting, marks=False), S, PLATE)
    chained(lifted)
    assert highest_between(lifted) >= S.clearance


def highest_between(plan: Plan) -> float:
    """Of the moves between the first two beads, m."""
    segments = plan.layers[0].segments
    first, last = (i for i, s in enumerate(segments) if s.arc != segments[i - 1].arc and not s.arc)
    return max(s.end[2] for s in segments[first:last] if s.kind == Kind.IDLE)


def test_a_way_through_metal_is_refused_with_its_line():
    text = 'W4646 S22 F600\nG0 Z12\nG0 X0 Y0\nG1 Z0\nM3\nG1 X40\nM5\nG0 Y20\nG0 X20\nG0 Y-8\nG0 X0\nM3\nG1 X40\nM5'
    with pytest.raises(
        PlanError, match=r'line 8: the way to the bead of line 13 runs along the metal'
    ):
        plan_program(read_program(text, OURS), S, PLATE)
    low = text.replace('G0 Y20', 'G0 Z5\nG0 Y4\nG0 X20\nG0 Z1').replace('G0 X0\nM3', 'G0 X0 Z0\nM3')
    with pytest.raises(PlanError, match=r'line 13: the way .* \d\.\d mm deep in metal'):
        plan_program(read_program(low, OURS), S, PLATE)
    far = text.replace('G0 Y20\nG0 X20\nG0 Y-8\nG0 X0', 'G0 Z5\nG0 Y-90\nG0 X0 Y4\nG0 Z0')
    spec = GridSpec.covering(-0.01, -0.1, 0.06, 0.04, 1e-3)
    with pytest.raises(PlanError, match=r'line 9: Y-90: outside the machine.*y = -90'):
        plan_program(read_program(far, OURS), S, HeightGrid.full(spec, 0.0))


@pytest.mark.parametrize('heights', [(0, 0.2), (0, 2, 2.2, 4)])
def test_layers_too_thin_for_metal_are_refused_with_their_line(heights):
    with pytest.raises(PlanError, match=r'line \d+: layer \d lies 0.20 mm above the one before'):
        plan_program(wall(heights), S, PLATE)


def test_a_first_layer_in_the_air_is_refused():
    with pytest.raises(PlanError, match=r'line \d+: the first layer runs 8.0 mm above'):
        plan_program(wall((8, 10)), S, PLATE)
    with pytest.raises(PlanError, match='first layer lies beside'):
        plan_program(wall(), S, HeightGrid.full(SPEC, math.nan), mode='restore')
    plan = plan_program(moved(wall((8, 10)), (0, 0, -0.008)), S, PLATE)
    assert plan.layers[0].deposits[0].start[2] == pytest.approx(0)


def test_a_program_without_wire_gets_the_metal_of_its_layers():
    bare = dialect_of({'arc_on': 'M3', 'arc_off': 'M5', 'ignore': []}, 'bare')
    text = 'F600\nG0 Z12\nG0 X0 Y0\nG1 Z0\nM3\nG1 X40\nM5\nG0 Z12\nG0 X0\nG1 Z2\nM3\nG1 X40\nM5\n'
    plan = plan_program(read_program(text, bare), S, PLATE)
    for layer in plan.layers:
        assert layer.volume == pytest.approx(layer.planned.sum() * SPEC.resolution**2, rel=1e-6)


def test_regimes_beyond_the_material_are_refused_with_their_line():
    steel = materials.get('er70s-6')
    assert regime_problems(wall(), steel) == []
    text = 'G0 X0 Y0 Z0\nW100 S50\nM3\nG1 X40 F3000\nM5'
    speed, wire, volts = regime_problems(read_program(text, OURS), steel)
    assert speed == 'line 4: travel speed 50 mm/s, er70s-6 takes 3 to 20 mm/s'
    assert wire.startswith('line 4: wire 0.1 m/min') and volts.startswith('line 4: voltage 50 V')


def test_where_the_nominal_part_lies():
    box = np.array([[0.1, 0.1, 0], [0.14, 0.12, 0.006]])
    there = np.array([[0.098, 0.098, 0.001], [0.142, 0.122, 0.009]])
    assert part_offset(there, box)[0] == pytest.approx((0, 0, -0.001))
    offset, how = part_offset(there - [0.5, 0.3, 0], box)
    assert offset == pytest.approx((0.5, 0.3, -0.001)) and 'middle' in how
    at_zero = np.array([[0.002, 0.002, 0], [0.042, 0.022, 0.006]])
    assert 'lower corner' in part_offset(there + [0.3, 0.3, 0], at_zero)[1]


@pytest.mark.parametrize('name', ['cura_pad', 'slic3r_pad', 'prusaslicer_pad', 'prusaslicer_disc'])
def test_the_path_laid_equals_that_of_a_slicers_file(programs: Path, name: str):
    program = load_program(programs / f'{name}.gcode', 'slicer')
    (x0, y0, _), (x1, y1, top) = path_box(program)
    spec = GridSpec.covering(x0 - 0.01, y0 - 0.01, x1 + 0.01, y1 + 0.01, 1e-3)
    plan = plan_program(program, S, HeightGrid.full(spec, 0.0))
    chained(plan)
    laid = path_of(plan)
    beads = [b for layer in layers_of(program) for b in layer.beads]
    assert len(laid) == len(beads)
    for path, bead in zip(laid, beads, strict=True):
        corners = np.vstack([m.corners() for m in bead.motions])
        for c in corners:  # every corner is passed, nothing lies beside the lines
            assert np.linalg.norm(path - c, axis=1).min() < 1e-9
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        assert length == pytest.approx(sum(m.length for m in bead.motions), rel=1e-9)
    assert float(np.nanmax(plan.final_target)) == pytest.approx(top, abs=0.6e-3)


@given(st.floats(3, 30), st.floats(0.2, 6.0), st.booleans())
@settings(max_examples=25, deadline=None)
def test_the_path_laid_equals_the_arc_of_the_file_within_a_micrometre(radius, sweep, left):
    end = (radius * math.cos(sweep), radius * math.sin(sweep) * (1 if left else -1))
    text = (
        f'W5000 S22 F600\nG0 Z12\nG0 X{radius:.4f} Y0\nG1 Z0\nM3\n'
        f'{"G3" if left else "G2"} X{end[0]:.4f} Y{end[1]:.4f} I{-radius:.4f}\nM5'
    )
    spec = GridSpec.covering(-0.04, -0.04, 0.04, 0.04, 1e-3)
    (path,) = path_of(plan_program(read_program(text, OURS), S, HeightGrid.full(spec, 0.0)))
    both = np.vstack([path, 0.5 * (path[1:] + path[:-1])])
    assert np.abs(np.hypot(*both[:, :2].T) - radius * 1e-3).max() < 1e-6


def test_our_own_programs_come_back(worn_block, box_file):
    """Restoration and build, plain and compact: beads, metal and path of the plan that wrote them."""
    found, nominal = worn_block(lambda x, y: 0.003 + 0.002 * np.sin(x / 0.008))
    restored = plan_restoration(found, nominal, S)
    built = plan_build(load_part(box_file((40, 20, 4))), S)
    for plan, text, mode in (
        (restored, gcode(restored), 'restore'),
        (built, gcode(built), 'build'),
        (built, compact_gcode(built)[0], 'build'),
    ):
        back = plan_program(read_program(text, OURS), S, plan.as_found, plan.nominal, mode=mode)
        chained(back)
        assert len(back.layers) == len(plan.layers)
        assert back.arc_starts == plan.arc_starts
        assert back.length == pytest.approx(plan.length, rel=1e-4)
        assert back.volume == pytest.approx(plan.volume, rel=2e-3)
        same = back.region & plan.region
        assert same.sum() > 0.85 * plan.region.sum()
        assert back.final_target[same] == pytest.approx(plan.final_target[same], abs=0.2e-3)


def test_levelled_metal_evens_out_what_lines_that_lie_close_lay():
    """Lines 4 mm apart, two of them 2 mm: the path stays, and a layer with its metal shared out comes out level."""
    rows = (0, 4, 6, 10, 14)
    text = ['W4646', 'S22', 'F600', 'G0 Z12', '; layer 1']
    for y in rows:
        text += [f'G0 X0 Y{y}', 'G1 Z0', 'M3', 'G1 X40', 'M5', 'G0 Z12']
    program = read_program('\n'.join(text), OURS)
    as_is, level = (plan_program(program, S, PLATE, level=on).layers[0] for on in (False, True))
    assert [(s.start, s.end, s.speed) for s in level.segments] == [
        (s.start, s.end, s.speed) for s in as_is.segments
    ]
    off = []
    for layer in (as_is, level):
        deposits = layer.deposits
        bead = np.array([s.bead for s in deposits])
        pieces = Pieces(
            np.array([s.start for s in deposits]), np.array([s.end for s in deposits]), bead, bead
        )
        height = np.array([s.height for s in deposits])
        off.append(unevenness(pieces, height, layer.planned, SPEC, S))
        assert [base_feed(s, S) for s in deposits] == pytest.approx(
            [s.wire_feed_speed for s in deposits]
        )
    assert off[1] < 0.7 * off[0]
    of_line = [np.mean([s.height for s in level.deposits if s.bead == i + 1]) for i in range(5)]
    assert max(of_line[1:3]) < 0.85 * min(of_line[0], *of_line[3:])
    assert level.volume == pytest.approx(level.planned.sum() * SPEC.resolution**2, rel=0.02)


def test_a_thick_first_layer_gets_its_metal_though_the_others_are_thin():
    first = plan_program(wall((0, 2, 2.8, 3.6, 4.4, 5.2)), S, PLATE, level=True).layers[0]
    assert first.volume == pytest.approx(first.planned.sum() * SPEC.resolution**2, rel=0.03)
