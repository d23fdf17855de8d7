import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_process.segment import Kind, Segment, SegmentError, check_chain

coordinate = st.floats(-0.5, 0.5)
point = st.tuples(coordinate, coordinate, coordinate)


def deposit(index=1, start=(0.0, 0.0, 0.0), end=(0.003, 0.004, 0.0), **changes):
    return Segment(index, Kind.DEPOSIT, start, end, 0.01, arc=True).at(**changes)


def test_length_and_duration():
    assert deposit().length == pytest.approx(0.005)
    assert deposit().duration == pytest.approx(0.5)
    assert deposit(kind=Kind.DWELL, dwell=1.5).duration == 1.5


@given(point, point)
def test_the_middle_is_equally_far_from_both_ends(start, end):
    s = deposit(start=start, end=end)
    assert math.dist(s.start, s.midpoint) == pytest.approx(math.dist(s.midpoint, s.end), abs=1e-12)
    assert s.length == pytest.approx(2 * math.dist(s.start, s.midpoint), abs=1e-12)


@pytest.mark.parametrize(
    ('changes', 'word'),
    [
        ({'speed': math.nan}, 'speed'),
        ({'speed': 0.0}, 'speed'),
        ({'end': (0.0, math.inf, 0.0)}, 'end'),
        ({'psi': math.nan}, 'psi'),
        ({'dwell': -1.0}, 'dwell'),
        ({'kind': Kind.IDLE}, 'arc'),
        ({'kind': Kind.SCAN}, 'arc'),
        ({'wire_feed_speed': -0.1}, 'wire_feed_speed'),
        ({'tool_axis': (0.0, 0.0, 2.0)}, 'tool_axis'),
    ],
)
def test_a_segment_that_must_not_reach_a_machine(changes, word):
    deposit().check()
    with pytest.raises(SegmentError, match=f'segment 1: {word}'):
        deposit(**changes).check()


def test_chain():
    a, b = deposit(1), deposit(2, start=(0.003, 0.004, 0.0), end=(0.0, 0.0, 0.0))
    check_chain([a, b])
    with pytest.raises(SegmentError, match='segment 3 follows segment 1'):
        check_chain([a, b.at(index=3)])
    with pytest.raises(SegmentError, match='1.000 mm from the end of segment 1'):
        check_chain([a, b.at(start=(0.003, 0.005, 0.0))])
