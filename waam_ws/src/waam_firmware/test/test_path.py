"""Execution in simulated time, tick by tick: steps, circles, limits, wire."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

STEPS_PER_MM = 320
SPEED = np.array([200.0, 200.0, 100.0])  # mm/s
ACCEL = np.array([500.0, 500.0, 300.0])  # mm/s^2
TICK = 1e-3  # s


class Ticks:
    """What was executed: time (n,) in s, steps (n, 3), speed and wire (n,) in mm/s, last line done (n,), state (n,)."""

    def __init__(self, text: str, summary: str) -> None:
        rows = [line.split() for line in text.splitlines()]
        table = np.array([[float(v) for v in row[:7]] for row in rows])
        self.t, self.steps = table[:, 0] * 1e-3, table[:, 1:4]
        self.speed, self.wire, self.line = table[:, 4], table[:, 5], table[:, 6]
        self.state = [row[7] for row in rows]
        self.pulses = [int(v) for v in summary.split()[-3:]]

    @property
    def moving(self) -> np.ndarray:
        return self.speed > 0


@pytest.fixture
def execute(gcode_path):
    def execute(*lines: str, start: str = '100,100,100', override: float = 1.0) -> Ticks:
        result = subprocess.run(
            [gcode_path, '--start', start, '--ticks', '--override', str(override), '-'],
            input='\n'.join(lines) + '\n',
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert result.returncode == 0, result.stderr
        return Ticks(result.stdout, result.stderr)

    return execute


@pytest.fixture
def geometry(gcode_path):
    """Points (n, 3) in mm along the path of a program, every 0.02 mm or closer."""

    def geometry(*lines: str) -> np.ndarray:
        result = subprocess.run(
            [gcode_path, '--start', '100,100,100', '--every', '0.02', '-'],
            input='\n'.join(lines) + '\n',
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        rows = [[float(v) for v in row.split()[3:]] for row in result.stdout.splitlines()]
        points = np.array([v for row in rows for v in row]).reshape(-1, 3)
        pairs = zip(points, points[1:], strict=False)
        dense = [np.linspace(a, b, 2 + int(math.dist(a, b) / 0.02)) for a, b in pairs]
        path = np.concatenate(dense)
        return path[np.linalg.norm(np.diff(path, axis=0, prepend=np.inf), axis=1) > 0]

    return geometry


# ---- circles ----


@pytest.mark.parametrize(('feed', 'override'), [(600, 1.0), (1200, 0.5), (6000, 2.0), (60000, 1.0)])
@pytest.mark.parametrize('motion', ['G2', 'G3'])
def test_circle_of_50_mm_closes_with_the_theoretical_pulses(execute, motion, feed, override):
    """The check of the specification: 157.08 mm, 4 R steps/mm pulses on each axis, no step left over."""
    ticks = execute(f'{motion} I-25 F{feed}', start='125,100,50', override=override)
    assert ticks.pulses == [4 * 25 * STEPS_PER_MM] * 2 + [0]
    assert (ticks.steps[-1] == [125 * STEPS_PER_MM, 100 * STEPS_PER_MM, 50 * STEPS_PER_MM]).all()
    assert np.sum(ticks.speed) * TICK == pytest.approx(math.pi * 50, abs=0.05)
    x, y = ticks.steps[:, 0] - 100 * STEPS_PER_MM, ticks.steps[:, 1] - 100 * STEPS_PER_MM
    off = np.abs(np.hypot(x, y) - 25 * STEPS_PER_MM)
    assert off.max() <= 1 / math.sqrt(2) + 1e-9  # half a step in each of two axes
    assert (x.min(), x.max(), y.min(), y.max()) == tuple([-8000, 8000] * 2)


def test_arc_runs_at_the_feed_and_takes_its_time(execute):
    ticks = execute('G2 I-25 F600', start='125,100,50')
    assert ticks.speed.max() == pytest.approx(10.0, abs=1e-6)
    assert ticks.t[-1] == pytest.approx(math.pi * 50 / 10 + 10 / 500, abs=0.01)


@pytest.mark.parametrize('radius', [0.05, 0.5, 5.0, 50.0])
def test_centripetal_acceleration_is_limited(execute, radius):
    """v^2 / R and the change of speed together stay within what the axes can do; a greater circle may be faster."""
    ticks = execute(f'G2 I-{radius} F60000', start=f'{100 + radius},100,50')
    v = ticks.speed[ticks.moving]
    tangential = np.abs(np.diff(v, prepend=0.0)) / TICK
    total = np.hypot(v**2 / radius, tangential[: len(v)])
    assert total.max() <= ACCEL[0] * 1.02
    reached = min(0.8 * ACCEL[0] * radius, SPEED[0] ** 2) ** 0.5
    assert v.max() <= reached + 1e-6
    if radius <= 5.0:  # there is room to get that fast
        assert v.max() == pytest.approx(reached, rel=0.02)


def test_curve_of_short_chords_is_no_faster_than_the_arc(execute):
    """Junction deviation alone would let 1000 chords round a corner of 1 mm radius at any speed."""
    points = [(101 + math.cos(a), 100 + math.sin(a)) for a in np.linspace(math.pi, -math.pi, 1001)]
    chords = execute('F6000', *(f'G1 X{x:.4f} Y{y:.4f}' for x, y in points))
    arc = execute('G2 I1 F6000')
    assert arc.speed.max() == pytest.approx(math.sqrt(0.8 * 500), rel=0.02)
    assert chords.speed.max() <= math.sqrt(500 * 1.0) * 1.1


# ---- any program ----

MOVES = st.one_of(
    st.builds(
        'G1 X{:.3f} Y{:.3f} Z{:.3f} F{}'.format,
        *[st.floats(-3, 3)] * 3,
        st.sampled_from([120, 600, 3000, 12000]),
    ),
    st.builds(
        'G{} I{:.3f} J{:.3f} Z{:.3f} F{}'.format,
        st.sampled_from([2, 3]),
        st.floats(0.2, 2),
        st.floats(-2, 2),
        st.floats(-1, 1),
        st.sampled_from([300, 3000]),
    ),
    st.sampled_from(['G4 P0.01', 'G0 X0.5 Y-0.5', 'G91', 'G1 Z0.2', 'M7', '; nothing']),
)


def distances(points: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distance (n,) of each point to a polyline (m, 3) whose vertices are close together."""
    _, nearest = cKDTree(path).query(points, k=min(8, len(path)))
    found = []
    for first in np.clip(np.hstack([nearest - 1, nearest]), 0, len(path) - 2).T:
        a, d = path[first], path[first + 1] - path[first]
        squares = np.maximum((d**2).sum(axis=1), 1e-18)
        share = np.clip(((points - a) * d).sum(axis=1) / squares, 0.0, 1.0)
        found.append(np.linalg.norm(a + share[:, None] * d - points, axis=1))
    return np.min(found, axis=0)


def test_no_step_is_lost_and_no_axis_overdone(execute, geometry):
    """Random programs: every position lies on the path, the last one is its end, no axis exceeds its speed."""

    @settings(
        max_examples=50,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )
    @given(
        st.lists(MOVES, min_size=1, max_size=8).map(lambda m: ['G91 F600', *m, 'G1 X0.01']),
        st.sampled_from([0.3, 1.0, 2.0]),
    )
    def steps(lines: list[str], override: float) -> None:
        ticks, path = execute(*lines, override=override), geometry(*lines)
        assert (ticks.steps[-1] == np.rint(path[-1] * STEPS_PER_MM)).all()
        assert ticks.speed[-1] == 0 and ticks.state[-1] == 'IDLE'
        change = np.abs(np.diff(ticks.steps, axis=0))
        assert (change <= SPEED * TICK * STEPS_PER_MM + 1).all()
        # half a step in each of three axes, and the polyline's own error
        off = distances(np.unique(ticks.steps, axis=0) / STEPS_PER_MM, path)
        assert off.max() <= math.sqrt(0.75) / STEPS_PER_MM + 5e-4
        assert ticks.pulses == [int(v) for v in change.sum(axis=0)] or len(change) == 0

    steps()


def built(name: str) -> Path:
    """A C program of this folder, or a skip that says so."""
    program = Path(__file__).parents[3] / 'build/waam_firmware' / name
    if not program.exists():
        pytest.skip(f'{name} was not built (BUILD_TESTING)')
    return program


def test_planner_keeps_its_invariants():
    """The C program that checks planner, interpolator and look ahead on random paths of lines and arcs."""
    result = subprocess.run(
        [built('planner_properties'), '30'], capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('30 random paths')


# ---- wire ----


def test_wire_feeder_keeps_its_invariants():
    """The C program that jogs, stops and orders at random: lengths, bounds, direction, no overshoot of the lead."""
    result = subprocess.run([built('wire_properties')], capture_output=True, text=True, timeout=100)
    assert result.returncode == 0, result.stdout
    assert result.stdout == '12000 jogs, stops and orders\n'


def feeder(command: np.ndarray, delay: float = 0.030, lag: float = 0.065) -> np.ndarray:
    """Wire at the arc (n,): the command through transport delay and first-order lag."""
    late = np.concatenate([np.zeros(round(delay / TICK)), command])[: len(command)]
    out, now = np.empty_like(late), 0.0
    for k, u in enumerate(late):
        now += (u - now) * (1 - math.exp(-TICK / lag))
        out[k] = now
    return out


def test_wire_is_led_so_that_it_changes_where_the_program_says(execute):
    """W steps from block to block; what gets to the arc is compared with the feeder on a command without lead."""
    ticks = execute('M3 W5000 S22', 'G1 F600 X110', 'X115 W7000', 'X120 W4000', 'X125 W6000', 'M5')
    x = ticks.steps[:, 0] / STEPS_PER_MM
    wanted = np.select([x < 110, x < 115, x < 120], [5000, 7000, 4000], 6000) / 60
    bead = ticks.moving & (x > 101) & (x < 124)
    led = np.abs(feeder(ticks.wire) - wanted)[bead].sum() * TICK
    plain = np.abs(feeder(np.where(ticks.line >= 1, wanted, 0.0)) - wanted)[bead].sum() * TICK
    assert led < 0.35 * plain
    assert ticks.wire.max() <= 300.0 and ticks.wire.min() >= 0.0
    assert np.abs(np.diff(ticks.wire)).max() <= 2000.0 * TICK + 1e-3
    steady = (x > 112) & (x < 114.3)
    assert np.ptp(ticks.wire[steady]) < 1e-3


def test_wire_speed_does_not_follow_the_travel_speed(execute):
    """The default: W is a velocity, whatever the override of the travel is."""
    runs = [execute('M3 W5000 S22', 'G1 F600 X110', 'M5', override=o) for o in (0.5, 1.0, 2.0)]
    for ticks in runs:
        assert np.median(ticks.wire[ticks.moving]) == pytest.approx(5000 / 60)
