"""Compact programs keep the path, the metal and the order; Fanuc programs read back to the same path."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.build import plan_build
from waam_plan.compact import circle, compact, fragments, saving
from waam_plan.fanuc import FanucError, read_ls, sample, write_ls
from waam_plan.part import load_part
from waam_plan.restore import plan_restoration
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, Segment

S = PlanSettings(machine_max=(0.3, 0.22, 0.18))
TOLERANCE = 0.02e-3


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
    points = np.array([move.start, *sample(move.start, move, 0.05e-3)])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


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
    assert s.share >= 0.8 and s.before == sum(len(p.deposits) for p in prism.layers)


def test_repeated_layers_equal_layers_planned_one_by_one(prism, tmp_path):
    file = tmp_path / 'prism.stl'
    trimesh.creation.cylinder(radius=22, height=20, sections=96).export(file)
    alone = plan_build(load_part(file), PlanSettings(machine_max=S.machine_max, growth_step=0.0), 4)
    for a, b in zip(alone.layers, prism.layers, strict=False):
        for s, t in zip(a.deposits, b.deposits, strict=True):
            assert math.dist(s.start, t.start) < 1e-9 and math.dist(s.end, t.end) < 1e-9
            assert s.height == pytest.approx(t.height, rel=1e-9) and s.layer == t.layer


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
    with pytest.raises(FanucError, match='lower'):
        write_ls(prism, 'lower')
    files = write_ls(prism)
    missing = {k: v for k, v in files.items() if k != 'WAAM001.LS'}
    with pytest.raises(FanucError, match='WAAM001.LS is called'):
        read_ls(missing)
    files['WAAM001.LS'] = files['WAAM001.LS'].replace('mm/sec', 'furlongs', 1)
    with pytest.raises(FanucError, match='WAAM001.LS, line'):
        read_ls(files)
