"""Programs read back are the path that was written."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.plan import hop, numbered
from waam_plan.posts import ProgramError, base_feed, gcode, read_gcode, to_csv, with_base_feed
from waam_plan.restore import plan_restoration
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, Segment

S = PlanSettings()


@pytest.fixture(scope='module')
def plan(worn_block):
    found, nominal = worn_block(lambda x, y: 0.003 + 0.002 * np.sin(x / 0.008))
    return plan_restoration(found, nominal, S)


def test_read_back_is_the_path_within_a_micrometre(plan):
    segments = [s for p in plan.layers for s in p.segments]
    points = read_gcode(gcode(plan))
    moves = [p for p in points if np.isfinite(p.position).all()]
    ends = np.array([s.end for s in segments])
    read = np.array([p.position for p in moves])
    at = 0
    for i, end in enumerate(ends):
        while np.linalg.norm(read[at] - end) > 1e-6:
            at += 1
            assert at < len(read), f'segment {i} is not in the program'
        assert moves[at].arc == segments[i].arc
        assert moves[at].speed == pytest.approx(segments[i].speed, abs=2e-6)
        at += 1


@given(st.lists(st.tuples(*[st.floats(-0.3, 0.3)] * 3), min_size=2, max_size=20, unique=True))
@settings(max_examples=50, deadline=None)
def test_any_chain_reads_back(points):
    segments = [
        Segment(
            i, Kind.DEPOSIT, a, b, 0.01, arc=True, height=0.002, width=0.006, speed_programmed=0.01
        )
        for i, (a, b) in enumerate(zip(points, points[1:], strict=False))
    ]
    read = [p for p in read_gcode(gcode(segments)) if p.arc]
    assert len(read) == len(segments)
    np.testing.assert_allclose([p.position for p in read], [s.end for s in segments], atol=0.51e-6)


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
            assert not arc
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


def test_a_start_elsewhere_is_approached_height_first():
    out = numbered(hop((0.0, 0.0, 0.05), (0.1, 0.0, 0.0), 0.05, S))
    body = [line for line in gcode(out).splitlines() if line.startswith('G0')]
    assert body[0] == 'G0 Z50.000' and body[1] == 'G0 X0.000 Y0.000'


def test_dwell_is_written_in_seconds():
    wait = Segment(0, Kind.DWELL, (0, 0, 0.01), (0, 0, 0.01), 0.0, dwell=2.5)
    assert 'G4 P2.500' in gcode([wait])


@pytest.mark.parametrize(
    ('text', 'word'),
    [
        ('G1 X1 Q2', 'line 1'),
        ('G21\nG1 X', 'line 2'),
        ('G91', 'G91'),
        ('hello', 'line 1'),
        ('G2 X1 I3', 'G2'),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(text, word):
    with pytest.raises(ProgramError, match=word):
        read_gcode(text)


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
