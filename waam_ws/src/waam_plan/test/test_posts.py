"""Programs read back are the path that was written."""

import csv
import io
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from waam_plan.gcode.program import (
    compact_gcode,
    gcode,
    to_csv,
    with_base_feed,
)
from waam_plan.import_gcode.files import load_dialect
from waam_plan.import_gcode.motion import Motion
from waam_plan.import_gcode.reader import read_program
from waam_plan.layers.restore import plan_restoration
from waam_plan.plan import base_feed, hop, numbered
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, Segment

S = PlanSettings()
OURS = load_dialect('waam')


def read(text: str) -> list[Motion]:
    return read_program(text, OURS).motions


@pytest.fixture(scope='module')
def plan(worn_block):
    found, nominal = worn_block(lambda x, y: 0.003 + 0.002 * np.sin(x / 0.008))
    return plan_restoration(found, nominal, S)


def test_read_back_is_the_path_within_a_micrometre(plan):
    segments = [s for p in plan.layers for s in p.segments]
    moves = [m for m in read(gcode(plan)) if np.isfinite(m.end).all()]
    ends = np.array([s.end for s in segments])
    points = np.array([m.end for m in moves])
    at = 0
    for i, end in enumerate(ends):
        while np.linalg.norm(points[at] - end) > 1e-6:
            at += 1
            assert at < len(points), f'segment {i} is not in the program'
        assert moves[at].arc == segments[i].arc
        assert moves[at].speed == pytest.approx(segments[i].speed, abs=2e-6)
        at += 1


@given(st.lists(st.tuples(*[st.floats(-0.3, 0.3)] * 3), min_size=2, max_size=20, unique=True))
@settings(max_examples=50, deadline=None)
def test_any_chain_reads_back(points):
    assume(
        math.dist(points[0], points[1]) > 1e-5
    )  # else a program of one bead never lights its arc
    segments = [
        Segment(
            i, Kind.DEPOSIT, a, b, 0.01, arc=True, height=0.002, width=0.006, speed_programmed=0.01
        )
        for i, (a, b) in enumerate(zip(points, points[1:], strict=False))
    ]
    moves = [m for m in read(gcode(segments)) if m.arc]
    ends = [s.end for s in segments if math.dist(s.start, s.end) > 1e-5]
    moves = [m for m in moves if m.length > 0.9e-5]
    assert len(moves) == len(ends)
    np.testing.assert_allclose([m.end for m in moves], ends, atol=0.51e-6)


def test_arc_goes_on_after_setpoints_and_off_before_idle_moves(plan):
    lines = [line for line in gcode(plan).splitlines() if not line.startswith(';')]
    assert all(len(line) < 140 and line.isascii() for line in lines)
    assert lines[-1] == 'M30'
    arc, wire = False, False
    for line in lines:
        words = line.split(';')[0].split()
        wire |= any(w.startswith('W') for w in words)
        if 'M3' in words:
            assert wire and not arc
            arc = True
        if 'M5' in words:
            arc = False
        if 'G0' in words:
            assert not arc and 'F' not in line
    assert not arc
    assert lines.count('M3') == lines.count('M5') == plan.arc_starts


def test_base_feed_is_eq_2_17_and_keeps_given_setpoints():
    s = Segment(
        0,
        Kind.DEPOSIT,
        (0, 0, 0),
        (0.01, 0, 0),
        0.012,
        arc=True,
        height=0.002,
        width=0.006,
        speed_programmed=0.010,
    )
    section = base_feed(s, S) * S.wire_area * S.efficiency / s.speed_programmed
    assert section == pytest.approx(0.73 * 0.006 * 0.002)
    (filled,) = with_base_feed([s], S)
    assert filled.wire_feed_speed == base_feed(s, S) and filled.voltage == S.voltage
    kept = s.at(wire_feed_speed=0.05, voltage=20.0)
    assert with_base_feed([kept], S) == [kept]


def burning(kind, **values):
    return Segment(0, kind, (0, 0, 0), (0, 0, 0), 0.01, arc=True, **values)


def test_dwells_with_the_arc_burn_like_the_deposit_beside_them():
    bead = dict(height=0.002, width=0.006, speed_programmed=0.01)
    thin = burning(Kind.DEPOSIT, **bead | {'height': 0.001})
    thick = burning(Kind.DEPOSIT, **bead)
    wait = burning(Kind.DWELL, dwell=0.5)
    away = Segment(0, Kind.IDLE, (0, 0, 0), (0, 0, 0.01), 0.05)
    rest = Segment(0, Kind.DWELL, (0, 0, 0), (0, 0, 0), 0.05, dwell=3.0)
    out = with_base_feed([wait, thin, thick, wait, wait, away, rest, wait, thin], S)
    feed = [s.wire_feed_speed for s in out]
    low, high = base_feed(thin, S), base_feed(thick, S)
    assert feed == [low, low, high, high, high, 0, 0, low, low]
    assert [s.voltage for s in out] == [S.voltage if f else 0.0 for f in feed]
    given = wait.at(wire_feed_speed=0.03, voltage=19.0)
    assert with_base_feed([given, thin], S)[0] == given


def test_wire_is_told_before_an_arc_that_waits_is_lit(worn_block):
    lit = replace(S, lead_on=0.5, lead_off=2e-3)
    out = gcode(plan_restoration(*worn_block(0.003), lit))
    starts = re.findall(r'(.*)\nM3\n(.*)\n(.*)\n(.*)', out)
    assert starts and all(before.startswith('W') for before, *_ in starts)
    assert all(wait == 'G4 P0.500' for _, wait, *_ in starts)


def test_planned_idle_moves_have_their_speed(plan):
    """The controller takes no speed for G0."""
    lines = gcode(plan).splitlines()
    speeds = [float(line.split('F')[1]) for line in lines if line.startswith('G1')]
    moves = [s for p in plan.layers for s in p.segments if s.kind != Kind.DWELL]
    assert speeds == pytest.approx([s.speed * 60e3 for s in moves], abs=0.06)
    assert all('F' not in line for line in lines if line.startswith('G0'))


@pytest.mark.parametrize(('word', 'turn'), [('G3', 1), ('G2', -1)])
def test_compact_program_has_arcs_with_their_centre_from_the_start(plan, word, turn):
    angles = np.linspace(0.3, 3.0, 60)[::turn]
    points = np.stack((50 * np.cos(angles), 50 * np.sin(angles), np.full(60, 2.0)), axis=1)
    corners = [tuple(p) for p in (points * 1e-3).tolist()]
    bead = burning(Kind.DEPOSIT, height=0.002, width=0.006, speed_programmed=0.01)
    chords = [bead.at(start=a, end=b) for a, b in zip(corners, corners[1:], strict=False)]
    ring = replace(plan, layers=[replace(plan.layers[0], segments=chords)])
    text, saved = compact_gcode(ring, 0.05e-3)
    assert (saved.before, saved.after) == (59, 1)
    (move,) = (line.split() for line in text.splitlines() if line.startswith(f'{word} '))
    assert [w[0] for w in move] == list('GXYZIJF')
    numbers = [float(w[1:]) for w in move[1:]]
    assert numbers == pytest.approx([*points[-1], *-points[0][:2], 600.0], abs=1e-3)
    (arc,) = (m for m in read(text) if m.arc)
    assert arc.round is not None and np.sign(arc.round.sweep) == turn
    assert arc.length == pytest.approx(0.05 * 2.7, rel=1e-4)


def test_a_start_elsewhere_is_approached_height_first():
    out = numbered(hop((0.0, 0.0, 0.05), (0.1, 0.0, 0.0), 0.05, S))
    body = [line for line in gcode(out).splitlines() if line.startswith('G0')]
    assert body[0] == 'G0 Z50.000' and body[1] == 'G0 X0.000 Y0.000'


def test_dwell_is_written_in_seconds():
    wait = Segment(0, Kind.DWELL, (0, 0, 0.01), (0, 0, 0.01), 0.0, dwell=2.5)
    assert 'G4 P2.500' in gcode([wait])


def test_words_around_a_program_are_read_as_the_controller_does():
    plain = 'G21 G90\nG0 Z5\nG0 X1 Y2\nW5000 S22\nM3\nG1 X3 F600\nM5\n'
    framed = (
        '%\nG90 G94 G17 G21 G40 G49 G80\nG64 P0.01 Q0.02\nG0 Z5\n'
        '/G0 X1 Y2 M8\nW5000 S22\nM3\nG1 X3.0000000000000000000000 F600 M9\nM5\nM30\n%\n'
    )
    assert [m.end for m in read(framed)[1:]] == [m.end for m in read(plain)[1:]]


def test_csv_has_one_line_per_segment(plan):
    rows = list(csv.DictReader(io.StringIO(to_csv(plan))))
    segments = [s for p in plan.layers for s in p.segments]
    assert len(rows) == len(segments)
    middle = len(rows) // 2
    assert float(rows[middle]['x1_mm']) == pytest.approx(segments[middle].end[0] * 1e3, abs=1e-4)
    assert rows[middle]['kind'] == segments[middle].kind.name


def test_csv_reads_back_to_the_same_path(plan):
    """Points to a micrometre, in order, with what the torch does on the way and how fast."""
    rows = list(csv.DictReader(io.StringIO(to_csv(plan))))
    segments = [s for p in plan.layers for s in p.segments]
    for number, end in ((0, 'start'), (1, 'end')):
        read = np.array([[float(r[f'{axis}{number}_mm']) for axis in 'xyz'] for r in rows])
        assert read == pytest.approx(np.array([getattr(s, end) for s in segments]) * 1e3, abs=1e-3)
    speeds = [float(r['speed_mm_s']) for r in rows]
    assert speeds == pytest.approx([s.speed * 1e3 for s in segments], abs=1e-3)
    assert [(r['kind'], int(r['arc'])) for r in rows] == [(s.kind.name, s.arc) for s in segments]
