"""Compact programs keep the path, the metal and the order; Fanuc programs read back to the same path."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_line import sample
from robot_read_fanuc import read_ls

from waam_plan.gcode.compact import circle, compact, fragments, saving
from waam_plan.gcode.program import with_base_feed
from waam_plan.layers import build
from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan, PlannedLayer, hop
from waam_plan.robot.cell import FanucSettings, RobotCell
from waam_plan.robot.fanuc import write_ls
from waam_plan.robot.motion import RobotProgramError
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

S = PlanSettings(machine_max=(0.3, 0.22, 0.18))
TOLERANCE = 0.02e-3
PLAIN = RobotCell(fanuc=FanucSettings(registers=False))


def chain(points, height=2e-3):
    return [
        Segment(
            i, Kind.DEPOSIT, tuple(a), tuple(b), 0.01, arc=True, height=height, width=6e-3,
            speed_programmed=0.01,
        )
        for i, (a, b) in enumerate(zip(points, points[1:], strict=False))
    ]  # fmt: skip


def path_of(moves, start, step=0.1e-3):
    points = [start]
    for m in moves:
        points += sample(points[-1], m, step)
    return np.array(points)


def distance_to_polyline(points, corners):
    """Largest distance (m) of points from the polyline."""
    a, b = np.array(corners[:-1]), np.array(corners[1:])
    worst = 0.0
    for p in points:
        t = np.clip(np.sum((p - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1), 0, 1)
        worst = max(worst, float(np.linalg.norm(a + t[:, None] * (b - a) - p, axis=1).min()))
    return worst


def ring(radius, sweep, n, z=0.002):
    angles = np.linspace(0, sweep, n)
    return np.stack((radius * np.cos(angles), radius * np.sin(angles), np.full(n, z)), axis=1)


@given(st.floats(5e-3, 0.1), st.floats(0.5, 5.0), st.integers(30, 200))
@settings(max_examples=30, deadline=None)
def test_points_on_a_circle_become_few_arcs(radius, sweep, n):
    points = ring(radius, sweep, n)
    chord = radius * (1 - math.cos(sweep / (n - 1) / 2))
    moves = compact(chain(points), TOLERANCE + chord)
    assert len(moves) <= 3 and any(m.via for m in moves)
    assert (
        np.abs(np.linalg.norm(path_of(moves, tuple(points[0]))[:, :2], axis=1) - radius).max()
        < 2e-5
    )
    assert math.dist(moves[-1].end, points[-1]) < 1e-12
    assert sum(m.pieces for m in moves) == n - 1


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), min_size=2, max_size=25, unique=True),
    st.floats(1e-6, 2e-4),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_any_path_stays_within_the_tolerance(points, tolerance):
    corners = [(x, y, 0.001) for x, y in points]
    if any(math.dist(a, b) < 1e-6 for a, b in zip(corners, corners[1:], strict=False)):
        return
    moves = compact(chain(corners), tolerance)
    travelled = path_of(moves, corners[0], 2e-3)
    assert distance_to_polyline(travelled, corners) <= tolerance + 1e-9
    for c in corners:
        assert np.linalg.norm(travelled - c, axis=1).min() <= tolerance + 2e-3


def test_different_setpoints_and_idle_moves_are_not_joined():
    a, b = chain([(0, 0, 0), (1e-2, 0, 0)]), chain([(1e-2, 0, 0), (2e-2, 0, 0)], 1.5e-3)
    idle = Segment(0, Kind.IDLE, (2e-2, 0, 0), (3e-2, 0, 0), 0.05, speed_programmed=0.05)
    assert [m.pieces for m in compact([*a, *b, idle])] == [1, 1, 1]
    same = chain([(0, 0, 0), (1e-2, 0, 0), (2e-2, 0, 0)])
    assert [m.pieces for m in compact(same)] == [2]


def test_metal_is_kept():
    points = ring(0.03, 4.0, 80)
    pieces = [s.at(height=2e-3 * (1 + 0.01 * math.sin(i))) for i, s in enumerate(chain(points))]
    moves = compact(pieces)
    metal = sum(s.height * s.length for s in pieces)
    assert sum(m.segment.height * length(m) for m in moves) == pytest.approx(metal, rel=1e-3)


def length(move) -> float:
    return length_of(move.start, move)


def test_three_points_on_a_line_have_no_circle():
    assert circle(*np.array([(0.0, 0, 0), (1.0, 0, 0), (3.0, 0, 0)]))[1] == math.inf


@pytest.fixture(scope='module')
def prism(tmp_path_factory):
    """A rounded prism of 10 layers."""
    file = tmp_path_factory.mktemp('prism') / 'prism.stl'
    trimesh.creation.cylinder(radius=22, height=20, sections=96).export(file)
    return plan_build(load_part(file), S)


def test_prismatic_part_needs_a_fifth_of_the_points(prism):
    found = fragments(prism)
    assert [len(f.levels) for f in found] == [1, 5, 4]  # the base layer is slower than the others
    assert sorted(n for f in found for n, _ in f.levels) == list(range(1, 11))
    s = saving(prism, found)
    deposits = sum(len(p.deposits) for p in prism.layers)
    assert s.share >= 0.8 and s.before == deposits + 10 * 3  # start, way down, way up


def test_saving_counts_the_points_of_the_files(prism):
    written = sum(text.count('GP1:') for text in write_ls(prism, tolerance=TOLERANCE).values())
    assert saving(prism, fragments(prism, TOLERANCE)).after == written


def test_saving_of_nothing_but_idle_moves_and_single_pieces_is_none():
    way = hop((0.0, 0.0, 0.02), (0.05, 0.02, 0.02), 0.04, S)
    assert len(way) > 20
    layer = one_layer(way)
    assert saving(layer, fragments(layer)).share == 0.0


def test_repeated_layers_equal_layers_planned_one_by_one(prism, tmp_path, monkeypatch):
    monkeypatch.setattr(build, 'SAME_SECTION', -1.0)  # nothing is repeated
    file = tmp_path / 'prism.stl'
    trimesh.creation.cylinder(radius=22, height=20, sections=96).export(file)
    alone = plan_build(load_part(file), PlanSettings(machine_max=S.machine_max), 4)
    for a, b in zip(alone.layers, prism.layers, strict=False):
        for s, t in zip(a.deposits, b.deposits, strict=True):
            assert math.dist(s.start, t.start) < 1e-9 and math.dist(s.end, t.end) < 1e-9
            assert s.height == pytest.approx(t.height, rel=1e-9) and s.layer == t.layer


def test_a_straight_idle_leg_is_one_move_for_a_robot_only():
    start, end = (0.0, 0.0, 0.01), (0.05, 0.02, 0.002)
    way = hop(start, end, 0.04, S)
    moves = compact(way, legs=True)
    corners = [(0.0, 0.0, 0.04), (0.05, 0.02, 0.04), end]
    assert [m.end for m in moves] == corners and moves[0].start == start
    assert [m.segment.speed for m in moves] == [
        max(s.speed for s in way if on(s.end, a, b))
        for a, b in zip([start, *corners], corners, strict=False)
    ]
    assert [m.segment for m in compact(way)] == way


def on(point, a, b):
    """Beyond a, as far as b."""
    gap = math.dist(a, point) + math.dist(point, b) - math.dist(a, b)
    return gap < 1e-9 and math.dist(a, point) > 1e-9


@pytest.fixture(scope='module')
def waiting(tmp_path_factory):
    """Equal layers whose arc burns before it moves, is out before the end, and which wait after their beads."""
    file = tmp_path_factory.mktemp('box') / 'box.stl'
    trimesh.creation.box(extents=(30, 24, 8)).export(file)
    lit = replace(S, lead_on=0.5, lead_off=2e-3, bead_time=100.0, alternation='none')
    return plan_build(load_part(file), lit)


def test_repeated_layers_are_put_out_once(waiting, tmp_path, monkeypatch):
    monkeypatch.setattr(build, 'SAME_SECTION', -1.0)
    file = tmp_path / 'box.stl'
    trimesh.creation.box(extents=(30, 24, 8)).export(file)
    alone = plan_build(load_part(file), waiting.settings)
    for a, b in zip(alone.layers, waiting.layers, strict=True):
        for s, t in zip(a.segments, b.segments, strict=True):
            assert (s.kind, s.arc, s.layer) == (t.kind, t.arc, t.layer)
            assert math.dist(s.end, t.end) < 1e-9 and s.dwell == pytest.approx(t.dwell)


def test_repeated_layers_keep_their_dwells(waiting):
    files = write_ls(waiting, cell=PLAIN)
    main = files.pop('WAAM.LS')
    assert len(files) < len(waiting.layers)
    waits = {f: text.count('WAIT   0.50(sec)') for f, text in files.items()}
    called = [f'{name}.LS' for name in re.findall(r'CALL (\w+)', main)]
    assert sum(waits[name] for name in called) == waiting.arc_starts
    assert all(len(re.findall(r'WAIT +\d\d', text)) == waits[f] for f, text in files.items())


def test_the_arc_is_lit_with_wire_where_the_robot_stands(waiting):
    for name, text in write_ls(waiting, cell=PLAIN).items():
        feed, stands = 0.0, False
        for line in re.findall(r'^ *\d+:(.*?) *;?$', text, re.M):
            if line.startswith('AO[1]='):
                feed = float(line[6:])
            elif line == 'DO[1]=ON':
                assert feed > 0.5 and stands, name
            elif line.startswith(('L ', 'C ')):
                stands = 'FINE' in line


def test_a_bead_that_ends_with_a_dwell_burns_to_the_end_of_it(prism):
    bead = chain([(0, 0, 0), (0.01, 0, 0)])
    crater = bead[0].at(kind=Kind.DWELL, start=(0.01, 0, 0), end=(0.01, 0, 0), dwell=0.3)
    text = write_ls(one_layer([*bead, crater]), cell=PLAIN)['WAAM001.LS']
    lines = re.findall(r'^ *\d+:(.*?) *;?$', text, re.M)
    bead_end, *rest = lines[-5:]
    assert rest == ['WAIT   0.30(sec)', 'DO[1]=OFF', 'WAIT   1.00(sec)', 'DO[2]=OFF']
    assert bead_end.startswith('L ') and 'FINE' in bead_end and 'TB' not in bead_end


def one_layer(segments):
    """A plan that holds these only."""
    spec = GridSpec(0.0, 0.0, 1e-3, 2, 2)
    flat = np.zeros(spec.shape)
    layer = PlannedLayer(1, flat, flat, flat, segments, (1.0, 0.0, 0.0), flat > 0)
    ground = HeightGrid(spec, flat)
    return Plan(spec, ground, ground, flat > 0, flat > 0, [layer], 0.05, S)


@pytest.mark.parametrize('kind', ['prism', 'worn', 'waiting'])
def test_fanuc_paths_are_those_of_the_plan_within_the_tolerance(kind, request, worn_block):
    if kind == 'worn':
        plan = plan_restoration(*worn_block(lambda x, y: 0.004 + 0.002 * np.sin(x / 0.008)), S)
    else:
        plan = request.getfixturevalue(kind)
    moves = read_ls(write_ls(plan))
    planned = [
        with_base_feed(list(group), plan.settings)
        for layer in plan.layers
        for arc, group in groupby(layer.segments, key=lambda s: s.arc)
        if arc
    ]
    laid = stretches(moves)
    assert len(laid) == len(planned)
    for bead, (start, stretch) in zip(planned, laid, strict=True):
        pieces = [s for s in bead if s.kind == Kind.DEPOSIT]
        corners = [pieces[0].start, *(s.end for s in pieces)]
        path = path_of(stretch, start, 0.4e-3)
        assert distance_to_polyline(path, corners) < TOLERANCE + 1e-6
        assert distance_to_polyline(np.array(corners), path) < TOLERANCE + 1e-6
        metal = sum(s.wire_feed_speed * s.duration for s in pieces)
        assert sum(m.feed * length_of(a, m) / m.speed for a, m in steps(start, stretch)) == (
            pytest.approx(metal, rel=5e-3)
        )


def stretches(moves):
    """(start, moves) of every way with the arc on."""
    out, here = [], None
    for arc, group in groupby(moves, key=lambda m: m.arc):
        found = list(group)
        if arc:
            out.append((here, found))
        here = found[-1].end
    return out


def steps(start, moves):
    """Each move with the place where it begins."""
    return zip([start, *(m.end for m in moves)], moves, strict=False)


def length_of(start, move) -> float:
    points = np.array([start, *sample(start, move, 0.05e-3)])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def test_fanuc_idle_ways_are_those_of_the_plan(worn_block):
    """Layers that are not repeated: every corner, nothing between, never faster than planned."""
    plan = plan_restoration(*worn_block(lambda x, y: 0.004 + 0.002 * np.sin(x / 0.008)), S)
    assert all(len(f.levels) == 1 for f in fragments(plan))
    idle = [m for m in read_ls(write_ls(plan)) if not m.arc]
    corners = [
        p
        for layer in plan.layers
        for p in (layer.segments[0].start, *(m.end for m in ways(layer.segments)))
    ]
    assert np.array([m.end for m in idle]) == pytest.approx(np.array(corners), abs=1e-7)
    assert max(m.speed for m in idle) <= S.idle_speed


def ways(segments):
    """Ends of straight idle ways."""
    pairs = zip(segments, [*segments[1:], None], strict=True)
    return [s for s, t in pairs if s.kind == Kind.IDLE and not (t and goes_on(s, t))]


def goes_on(s, t):
    """t is idle and in the direction of s."""
    u, v = (np.subtract(m.end, m.start) / m.length for m in (s, t))
    return t.kind == Kind.IDLE and float(u @ v) > 0.999


@pytest.mark.parametrize('kind', ['prism', 'worn'])
def test_fanuc_program_reads_back_to_the_same_path(kind, prism, worn_block):
    if kind == 'prism':
        plan = prism
    else:
        plan = plan_restoration(*worn_block(lambda x, y: 0.004 + 0.002 * np.sin(x / 0.008)), S)
    files = write_ls(plan, 'WAAM')
    moves = read_ls(files, 'WAAM')
    deposits = [s for p in plan.layers for s in p.segments if s.kind == Kind.DEPOSIT]
    laid, here = [], None
    for m in moves:
        if m.arc:
            laid.append(np.array([here, *sample(here, m, 0.5e-3)]))
        here = m.end
    places = np.concatenate(laid)
    for s in deposits[:: max(1, len(deposits) // 60)]:
        assert np.linalg.norm(places - s.end, axis=1).min() < 0.3e-3
    arcs = [m for m in moves if m.arc]
    for m, points in list(zip(arcs, laid, strict=True))[:: max(1, len(arcs) // 60)]:
        assert m.feed > 0
        middle = points[len(points) // 2]
        near = min(deposits, key=lambda s: math.dist(s.midpoint, middle))
        corners = [near.start, near.end]
        assert distance_to_polyline([middle], corners) < 1.2e-3
    starts = sum(b.arc and not a.arc for a, b in zip(moves, moves[1:], strict=False))
    assert starts == plan.arc_starts
    main = files['WAAM.LS']
    assert main.index('DO[1]=OFF') < main.index('AO[1]=0') < main.rindex('DO[2]=OFF')
    assert all(len(t) <= 600_000 and t.isascii() for t in files.values())


def test_fragments_hold_at_most_two_thousand_points(prism):
    for name, text in write_ls(prism).items():
        assert text.count('GP1:') <= 2000, name


def test_bad_names_and_broken_programs_are_named(prism):
    with pytest.raises(RobotProgramError, match='lower'):
        write_ls(prism, 'lower')
    files = write_ls(prism)
    missing = {k: v for k, v in files.items() if k != 'WAAM001.LS'}
    with pytest.raises(RobotProgramError, match='WAAM001.LS is called'):
        read_ls(missing)
    files['WAAM001.LS'] = files['WAAM001.LS'].replace('mm/sec', 'furlongs', 1)
    with pytest.raises(RobotProgramError, match='WAAM001.LS, line'):
        read_ls(files)
