"""Segments -> lines: the path survives, and nothing wrong passes."""

import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_bridge.program import (
    BAD_SEGMENT,
    GAP,
    WRONG_STATE,
    Limits,
    Modal,
    Permit,
    Refusal,
    number,
    prepare,
)
from waam_process.segment import Kind, Segment

LIMITS = Limits(
    low=(0.0, 0.0, 0.0),
    high=(0.4, 0.3, 0.2),
    speed_max=0.5,
    arc_speed=(0.003, 0.02),
    wire_feed_speed=(1 / 30, 0.2),
    voltage=(12.0, 36.0),
)
OFFSET = (0.1, 0.08, 0.02)
NOT_SET = object()


def permit(modal=None, known=-1, here=(0.0, 0.0, 0.0)):
    return Permit(0, modal or Modal(job='j'), known, here, OFFSET, LIMITS)


def chain(points, arc=False, first=0, **fields):
    """Segments through the points (m)."""
    more = (
        {'wire_feed_speed': 0.083, 'voltage': 22.0, 'kind': Kind.DEPOSIT}
        if arc
        else {'kind': Kind.IDLE}
    )
    more = {'speed': 0.01, 'arc': arc, **more, **fields}
    pairs = zip(points, points[1:], strict=False)
    return [Segment(index=first + i, start=a, end=b, **more) for i, (a, b) in enumerate(pairs)]


def texts(batch):
    return [gcode.decode() for gcode, _ in batch.lines]


class Reader:
    """What a controller makes of the lines: modal words, end points in mm, arc."""

    def __init__(self):
        self.words, self.arc, self.moves = {}, False, []

    def read(self, line):
        words = re.findall(r'([A-Z])(-?[\d.]+)', line)
        self.words.update({k: float(v) for k, v in words if k in 'XYZFWS'})
        codes = {k + v for k, v in words if k in 'GM'}
        self.arc = ('M3' in codes) or (self.arc and 'M5' not in codes)
        if 'G1' in codes:
            self.moves.append((dict(self.words), self.arc))


coordinate = st.floats(0.0, 0.15)
segments = st.lists(
    st.tuples(
        coordinate,
        coordinate,
        coordinate,
        st.booleans(),
        st.floats(0.003, 0.02),
        st.floats(0.034, 0.2),
        st.floats(12, 36),
    ),
    min_size=1,
    max_size=30,
)


@settings(deadline=None)
@given(segments, st.integers(1, 5))
def test_the_lines_read_back_to_the_same_path_and_setpoints(data, pieces):
    here, made = (0.0, 0.0, 0.0), []
    for i, (x, y, z, arc, speed, wire, volt) in enumerate(data):
        made += chain([here, (x, y, z)], arc, i, speed=speed, wire_feed_speed=wire, voltage=volt)
        here = (x, y, z)
    reader, modal, known = Reader(), Modal(job='j'), -1
    for piece in range(pieces):  # in several batches: the modal state goes on
        part = made[len(made) * piece // pieces : len(made) * (piece + 1) // pieces]
        batch = prepare(permit(modal, known), part, piece == pieces - 1)
        modal, known = batch.after, batch.after.index if batch.after.index is not None else -1
        for text in texts(batch):
            reader.read(text)
    assert len(reader.moves) == len(made) and not reader.arc
    for (words, arc), s in zip(reader.moves, made, strict=True):
        assert arc == s.arc
        assert math.dist([words[k] for k in 'XYZ'], [v * 1e3 for v in s.end]) < 1e-4
        assert words['F'] == pytest.approx(s.speed * 6e4, abs=0.01)
        if s.arc:
            assert words['W'] == pytest.approx(s.wire_feed_speed * 6e4, abs=0.01)
            assert words['S'] == pytest.approx(s.voltage, abs=0.001)


def test_arc_frame_and_modal_words():
    a, b, c, d = (0, 0, 0), (0.01, 0, 0), (0.02, 0, 0), (0.02, 0.01, 0)
    made = chain([a, b, c], arc=True) + chain([c, d], first=2, speed=0.05)
    batch = prepare(permit(), made, True)
    assert texts(batch) == [
        'G21 G90',
        'M7',
        'M3 W4980 S22',
        'G1 X10 Y0 Z0 F600',
        'G1 X20',
        'M5',
        'M9',
        'G1 Y10 F3000',
    ]
    assert [m.index for _, m in batch.lines if m] == [0, 1, 2]


def test_the_arc_goes_on_over_batches_until_last():
    a, b, c = (0, 0, 0), (0.01, 0, 0), (0.02, 0, 0)
    made = chain([a, b, c], arc=True)
    first = prepare(permit(), made[:1], False)
    second = prepare(permit(first.after, 0), made[1:], True)
    assert 'M5' not in texts(first) and texts(second) == ['G1 X20', 'M5', 'M9']


def test_a_repeated_batch_is_only_counted():
    made = chain([(0, 0, 0), (0.01, 0, 0), (0.02, 0, 0)])
    first = prepare(permit(), made, True)
    again = prepare(permit(first.after, 1), made, True)
    assert (again.accepted, again.duplicates, again.lines) == (0, 2, [])
    assert again.after == first.after


def refused(made, **kwargs):
    with pytest.raises(Refusal) as e:
        prepare(permit(**kwargs), made, False)
    return e.value.code, str(e.value)


def test_gaps_and_broken_chains():
    made = chain([(0, 0, 0), (0.01, 0, 0), (0.02, 0, 0), (0.03, 0, 0)])
    assert refused([made[0], made[2]])[0] == GAP
    code, text = refused([made[0], made[2].at(index=1)])
    assert code == BAD_SEGMENT and '10.000 mm from the end of segment 0' in text
    code, text = refused(made, here=(0.001, 0, 0))
    assert code == BAD_SEGMENT and 'position of the machine' in text
    assert refused(made, here=None)[0] == WRONG_STATE


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'speed': math.nan}, ['segment 0', 'speed']),
        ({'end': (math.inf, 0, 0)}, ['end']),
        ({'psi': math.nan}, ['psi']),
        ({'speed': 0.6}, ['speed', '0.5']),
        ({'end': (0.31, 0, 0)}, ['end.x', '410.000', '400']),
        ({'end': (0.0, 0, -0.021)}, ['end.z', '-1.000']),
        ({'tool_axis': (0.6, 0.0, 0.8)}, ['tool_axis']),
        ({'kind': Kind.DEPOSIT, 'arc': True, 'voltage': 22.0}, ['wire_feed_speed', '0.0333']),
        (
            {'kind': Kind.DEPOSIT, 'arc': True, 'wire_feed_speed': 0.1, 'voltage': 50.0},
            ['voltage', '36'],
        ),
        (
            {
                'kind': Kind.DEPOSIT,
                'arc': True,
                'wire_feed_speed': 0.1,
                'voltage': 20.0,
                'speed': 0.03,
            },
            ['speed', '0.02'],
        ),
        ({'kind': Kind.DWELL, 'dwell': 1.0}, ['end differs from start']),
        ({'kind': Kind.DWELL, 'end': (0.0, 0, 0), 'dwell': 1e4}, ['dwell', '600']),
    ],
)
def test_a_bad_segment_is_refused_by_field_and_limit(change, words):
    made = chain([(0, 0, 0), (0.01, 0, 0)])[0].at(**change)
    code, text = refused([made])
    assert code == BAD_SEGMENT
    for word in words:
        assert word in text


def test_a_dwell_waits_and_keeps_the_chain():
    a, b = (0, 0, 0), (0.01, 0, 0)
    wait = Segment(index=0, kind=Kind.DWELL, start=a, end=a, speed=0.0, dwell=2.5)
    assert texts(prepare(permit(), [wait, *chain([a, b], first=1)], True))[1:] == [
        'G4 P2.5',
        'G1 X10 Y0 Z0 F600',
    ]


@given(st.floats(-1e4, 1e4), st.integers(0, 6))
def test_numbers_are_short_and_near(value, digits):
    text = number(value, digits)
    assert abs(float(text) - value) <= 0.5000001 * 10**-digits
    assert text != '-0' and 'e' not in text


def test_an_axis_that_stands_on_the_step_beyond_its_limit_may_leave_it_and_no_other():
    """The top of an axis is seldom a whole number of steps, and homing ends on one."""
    steps = (327.0, 313.0, 321.922)
    top = (0.2 - OFFSET[2]) + 1.5e-6
    assert 0.5e-3 / steps[2] > 1.5e-6
    limits = LIMITS.reached(steps)
    moves = chain([(0.0, 0.0, top), (0.05, 0.0, top)])
    prepare(Permit(0, Modal(job='j'), -1, (0.0, 0.0, top), OFFSET, limits), moves, False)
    with pytest.raises(Refusal, match='z'):
        prepare(Permit(0, Modal(job='j'), -1, (0.0, 0.0, top), OFFSET, LIMITS), moves, False)
    high = chain([(0.0, 0.0, 0.18), (0.05, 0.0, 0.180003)])
    with pytest.raises(Refusal, match='z'):
        prepare(Permit(0, Modal(job='j'), -1, (0.0, 0.0, 0.18), OFFSET, limits), high, False)
