"""Programs of waam_plan through the controller's own parser and interpolator: path, arc, wire, speeds and time."""

from __future__ import annotations

import math
import re
import subprocess
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
import trimesh
from ament_index_python.packages import get_package_prefix

from waam_plan.gcode.program import compact_gcode, gcode, with_base_feed
from waam_plan.gcode.skew import AxisErrors
from waam_plan.gcode.skew_program import correct_gcode
from waam_plan.harmonic import HarmonicLaw
from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

MICROMETRE = 1e-3  # mm
PLANS = ('box', 'leads', 'rings', 'restoration')


@dataclass(frozen=True)
class Row:
    """A move as the controller understood it: mm and mm/s; wire (mm/s) is 0 while the arc is off."""

    line: int
    kind: str
    speed: float
    points: np.ndarray
    wire: float

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


def tool(text: str, *options: str) -> str:
    """What gcode_path prints; a program that the controller refuses fails the test with its answer."""
    program = Path(get_package_prefix('waam_firmware')) / 'lib/waam_firmware/gcode_path'
    command = [str(program), '--no-limits', '--start', '0,0,100', *options, '-']
    result = subprocess.run(command, input=text, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    return result.stdout


def wire_of_lines(text: str) -> list[float]:
    """Wire feed (mm/s) in force in every line of a program, from 1; 0 between M5 and M3."""
    out, arc, feed = [0.0], False, 0.0
    for raw in text.splitlines():
        line = raw.split(';')[0]
        if match := re.search(r'W([\d.]+)', line):
            feed = float(match[1]) / 60
        words = line.split()
        arc = 'M3' in words or (arc and 'M5' not in words)
        out.append(feed if arc else 0.0)
    return out


def rows_of(text: str, every: float = 0.5) -> list[Row]:
    wire = wire_of_lines(text)
    out = []
    for raw in tool(text, '--every', str(every)).splitlines():
        line, kind, speed, *values = raw.split()
        points = np.array(values, float).reshape(-1, 3)
        out.append(Row(int(line), kind, float(speed), points, wire[int(line)]))
    return out


def box(folder: Path, settings: PlanSettings) -> Plan:
    trimesh.creation.box(extents=(30, 24, 4)).export(folder / 'box.stl')
    return plan_build(load_part(folder / 'box.stl'), settings)


def rings(folder: Path) -> Plan:
    trimesh.creation.cylinder(radius=34, height=4, sections=256).export(folder / 'disc.stl')
    return plan_build(load_part(folder / 'disc.stl'), PlanSettings(strategy='contour'))


def restoration() -> Plan:
    spec = GridSpec.covering(-0.005, -0.005, 0.045, 0.035, 0.5e-3)
    x, y = np.meshgrid(spec.x, spec.y)
    part = (x > 0) & (x < 0.040) & (y > 0) & (y < 0.030)
    nominal = np.where(part, 0.03, np.nan)
    worn = nominal - 0.003 - 0.001 * np.sin(x / 0.008)
    return plan_restoration(HeightGrid(spec, worn), HeightGrid(spec, nominal), PlanSettings())


@pytest.fixture(scope='module')
def plans(tmp_path_factory) -> dict[str, Plan]:
    folder = tmp_path_factory.mktemp('parts')
    leads = PlanSettings(lead_on=0.5, lead_off=3e-3, bead_time=30.0)
    return {
        'box': box(folder, PlanSettings()),
        'leads': box(folder, leads),
        'rings': rings(folder),
        'restoration': restoration(),
    }


def segments(plan: Plan) -> list[Segment]:
    return [s for layer in plan.layers for s in layer.segments]


def motions(plan: Plan) -> list[Segment]:
    """With the setpoints of a program that runs alone."""
    return [s for s in with_base_feed(segments(plan), plan.settings) if s.kind != Kind.DWELL]


@pytest.mark.parametrize('name', PLANS)
def test_the_controller_makes_the_path_of_the_plan(plans, name):
    rows = rows_of(gcode(plans[name]))
    assert all(r.wire == 0 for r in rows if r.kind == 'rapid')
    planned, moves = motions(plans[name]), [r for r in rows if r.kind != 'rapid']
    assert len(moves) == len(planned)
    for s, r in zip(planned, moves, strict=True):
        assert r.points[0] == pytest.approx(np.array(s.start) * 1e3, abs=MICROMETRE)
        assert r.points[-1] == pytest.approx(np.array(s.end) * 1e3, abs=MICROMETRE)
        assert r.speed == pytest.approx(s.speed * 1e3, abs=1e-3)
        assert r.wire == pytest.approx(s.wire_feed_speed * 1e3 if s.arc else 0.0, abs=1e-3)
        assert (r.wire > 0) == s.arc


@pytest.mark.parametrize('name', PLANS)
def test_rapids_are_only_ways_between_layers_above_everything(plans, name):
    plan = plans[name]
    rapids = [r for r in rows_of(gcode(plan)) if r.kind == 'rapid']
    assert len(rapids) <= 1 + len(plan.layers)
    assert min(r.points[-1][2] for r in rapids) >= plan.safe_z * 1e3 - MICROMETRE


def legs_of(rows: list[Row]) -> list[list[Row]]:
    """Straight idle ways from rest to rest."""
    out: list[list[Row]] = []
    way = None
    for r in rows:
        if r.kind != 'line' or r.wire:
            way = None
            continue
        unit = (r.points[-1] - r.points[0]) / r.length
        if way is None or unit @ way < 0.999:
            out.append([])
        out[-1].append(r)
        way = unit
    return out


def law_time(length: float, settings: PlanSettings) -> float:
    """s, from rest to rest by R = L (u - sin(2 pi u) / (2 pi)): peak speed 2 L / T, acceleration 2 pi L / T^2."""
    speed, acceleration = settings.idle_speed * 1e3, settings.idle_acceleration * 1e3
    return max(2 * length / speed, math.sqrt(2 * math.pi * length / acceleration))


@pytest.mark.parametrize('name', ['box', 'rings', 'restoration'])
def test_idle_moves_are_told_the_harmonic_law(plans, name):
    plan = plans[name]
    legs = legs_of(rows_of(gcode(plan)))
    assert len(legs) >= 2 * len(plan.layers)
    for leg in legs:
        length = sum(r.length for r in leg)
        times = [r.length / r.speed for r in leg]
        duration = law_time(length, plan.settings)
        # the first and the last piece may be shorter than the coordinates are exact
        assert sum(times) == pytest.approx(duration, abs=2e-3 + 2.5 * duration / len(leg))
        u = np.linspace(0, 1, 4001)
        place = length * (u - np.sin(2 * np.pi * u) / (2 * np.pi))
        speed = length / duration * (1 - np.cos(2 * np.pi * u))
        lengths = np.array([r.length for r in leg])
        expected = np.interp(np.cumsum(lengths) - lengths / 2, place, speed)
        assert [r.speed for r in leg] == pytest.approx(expected, rel=0.05, abs=0.5)


def steps_of(places: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """x of the motor in mm, one value per ms, while the pieces of a motion along x (m, m/s) are executed."""
    moves = zip(places * 1e3, speeds * 6e4, strict=True)
    text = '\n'.join(['G21 G90', *(f'G1 X{x:.4f} F{f:.2f}' for x, f in moves)])
    return (
        np.array([float(row.split()[1]) for row in tool(text + '\n', '--ticks').splitlines()]) / 320
    )


def moved_by(x: np.ndarray, half: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Speed and acceleration (mm/s, mm/s2) of a motion x (mm, one value per ms): parabolas fitted over 41 ms, for one
    step in one ms is an acceleration of 3 m/s2."""
    t = np.arange(-half, half + 1) * 1e-3
    fit = np.linalg.pinv(np.vander(t, 3, increasing=True))
    padded = np.pad(x, half, mode='edge')
    return tuple(np.convolve(padded, w[::-1], 'valid') for w in (fit[1], 2 * fit[2]))


def jerk(x: np.ndarray, over: int = 40) -> float:
    """Largest change of the acceleration, mm/s3, over `over` ms."""
    acceleration = moved_by(x)[1]
    return float(np.abs(acceleration[over:] - acceleration[:-over]).max()) / (over * 1e-3)


def test_motors_follow_the_law_where_it_has_enough_pieces():
    """Measured at the steps: 50 pieces have a twentieth of the jerk of a move with one speed; 8 have all of it."""
    law = HarmonicLaw.within(0.05, 0.05, 0.5)
    plain = jerk(steps_of(np.array([0.05]), np.array([0.05])))
    found = {n: law.pieces(n) for n in (8, 50, 100)}
    smooth = {n: jerk(steps_of(at[1:], v)) for n, (at, v) in found.items()}
    assert smooth[8] > 0.8 * plain
    assert smooth[50] < plain / 15 and smooth[100] < plain / 15
    at, speeds = found[100]
    x = steps_of(at[1:], speeds)
    t = np.arange(len(x)) * 1e-3
    late = np.interp(0.025, x * 1e-3, t) - 0.5 * law.duration  # rounding between pieces
    inside = (t > 0.1) & (t < law.duration - 0.1)
    acceleration = moved_by(x)[1][inside] * 1e-3
    np.testing.assert_allclose(acceleration, law.acceleration(t[inside] - late), atol=0.03)


@dataclass(frozen=True)
class Run:
    """A program executed in simulated time: s, mm/s; `line` is the last one executed."""

    time: np.ndarray
    speed: np.ndarray
    wire: np.ndarray
    line: np.ndarray

    @classmethod
    def of(cls, text: str) -> Run:
        rows = [raw.split() for raw in tool(text, '--ticks').splitlines()]
        table = np.array([[float(row[k]) for k in (0, 4, 5, 6)] for row in rows])
        return cls(table[:, 0] * 1e-3, *table[:, 1:].T)

    def during(self, rows: list[Row]) -> np.ndarray:
        """Bool: these moves, one after the other, are executed."""
        return (self.line >= rows[0].line - 1) & (self.line < rows[-1].line)


@pytest.mark.parametrize('name', ['box', 'leads'])
def test_executed_the_wire_runs_with_the_arc_and_idle_moves_take_their_time(plans, name):
    plan = plans[name]
    text = gcode(plan)
    run, rows = Run.of(text), rows_of(text)
    burning = [s for s in with_base_feed(segments(plan), plan.settings) if s.arc]
    asked = sum(s.wire_feed_speed * s.duration for s in burning)
    assert run.wire.sum() * 1e-3 == pytest.approx(asked * 1e3, rel=0.05)
    legs = legs_of(rows)
    assert legs
    for leg in legs:
        now = run.during(leg)
        assert not run.wire[now & (run.speed > 0)].any()
        time = np.count_nonzero(now) * 1e-3
        if name == 'box':  # in the other one legs end with the wait for the bead's time
            assert 1 <= time / law_time(sum(r.length for r in leg), plan.settings) < 1.25


def stretches(rows: list[Row]) -> list[np.ndarray]:
    """(n, 3) mm, the path from every arc start to its end."""
    burning = groupby(rows, key=lambda r: r.wire > 0)
    return [np.concatenate([r.points for r in group]) for on, group in burning if on]


def apart(points: np.ndarray, corners: np.ndarray) -> float:
    """Largest distance of points (n, 3) from the polyline through corners (m, 3)."""
    a, along = corners[:-1], np.diff(corners, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-18)
    worst = 0.0
    for p in points:
        t = np.clip(((p - a) * along).sum(axis=1) / square, 0, 1)
        worst = max(worst, float(np.linalg.norm(a + t[:, None] * along - p, axis=1).min()))
    return worst


@pytest.mark.parametrize('name', PLANS)
def test_compact_programs_keep_within_their_tolerance(plans, name):
    plan = plans[name]
    text, saved = compact_gcode(plan, 0.02e-3)
    plain, compact = rows_of(gcode(plan)), rows_of(text, every=0.2)
    dwells = sum(s.kind == Kind.DWELL for s in segments(plan))
    assert saved.after == dwells + sum(r.kind != 'rapid' for r in compact)
    assert any(r.kind == 'arc' for r in compact) == (name == 'rings')
    pairs = list(zip(stretches(plain), stretches(compact), strict=True))
    assert len(pairs) == plan.arc_starts
    for before, after in pairs:
        assert apart(after, before) < 0.02 + MICROMETRE
        assert apart(before, after) < 0.02 + MICROMETRE
    metal = [sum(r.wire * r.length / r.speed for r in rows) for rows in (plain, compact)]
    assert metal[1] == pytest.approx(metal[0], rel=2e-3)
    idle = [[r.points[-1] for r in rows if not r.wire] for rows in (plain, compact)]
    assert np.array(idle[1]) == pytest.approx(np.array(idle[0]), abs=1e-6)


@pytest.mark.parametrize('name', PLANS)
def test_corrected_programs_reach_the_plan_on_leaning_axes(plans, name):
    errors = AxisErrors(
        *(math.radians(a) for a in (0.3, -0.2, 0.5, -0.4)), scale_x=1.002, scale_z=0.997
    )
    rows = rows_of(correct_gcode(gcode(plans[name]), errors.correction))
    real = [r.points[-1] @ errors.axes.T for r in rows if r.kind != 'rapid']
    wanted = [np.array(s.end) * 1e3 for s in motions(plans[name])]
    assert np.array(real) == pytest.approx(np.array(wanted), abs=MICROMETRE)
