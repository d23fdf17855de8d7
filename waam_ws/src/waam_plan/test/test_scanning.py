import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.layers.scanning import scan_lanes, scan_segments
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, check_chain

S = PlanSettings()


def seen(segments, x, y):
    """Whether points (m, work) lie in the field of view of some SCAN pass."""
    dx, dy, _ = S.scanner_offset
    out = np.zeros(np.shape(x), bool)
    for s in segments:
        if s.kind == Kind.SCAN:
            lo, hi = sorted((s.start[0] + dx, s.end[0] + dx))
            out |= (
                (x >= lo - 1e-9)
                & (x <= hi + 1e-9)
                & (abs(y - s.start[1] - dy) <= S.scanner_fov / 2 + 1e-9)
            )
    return out


@given(
    st.floats(0, 0.1),
    st.floats(0, 0.05),
    st.floats(0.005, 0.15),
    st.floats(0.005, 0.13),
    st.floats(0, 0.08),
)
@settings(max_examples=60, deadline=None)
def test_the_whole_rectangle_is_seen_from_a_safe_height(x0, y0, width, depth, top):
    start = (0.05, 0.05, 0.0)
    out = scan_segments((x0, y0, x0 + width, y0 + depth), top, S, start)
    check_chain(out)
    assert out[0].index == 0 and out[0].start == start
    x, y = np.meshgrid(
        np.linspace(x0 - S.margin, x0 + width + S.margin, 40),
        np.linspace(y0 - S.margin, y0 + depth + S.margin, 40),
    )
    assert seen(out, x, y).all()
    for s in out:
        assert not s.arc and s.kind in (Kind.IDLE, Kind.SCAN)
        if math.dist(s.start[:2], s.end[:2]) > 1e-9:
            assert min(s.start[2], s.end[2]) >= top + S.clearance - 1e-9
        if s.kind == Kind.SCAN:
            assert s.speed == S.scan_speed
            surface = top - (s.start[2] + S.scanner_offset[2])
            assert S.scanner_range[0] < surface < S.scanner_range[1]


def test_passes_overlap_and_alternate():
    lanes = scan_lanes(0.0, 0.120, S)
    assert np.diff(lanes).max() <= 0.8 * S.scanner_fov + 1e-12
    assert len(lanes) == 3
    out = [
        s for s in scan_segments((0, 0, 0.1, 0.12), 0.02, S, (0, 0, 0.05)) if s.kind == Kind.SCAN
    ]
    ways = [np.sign(s.end[0] - s.start[0]) for s in out]
    assert ways == [(-1.0) ** i for i in range(len(out))]


def test_a_rectangle_beyond_the_machine_is_refused():
    with pytest.raises(PlanError, match='x = '):
        scan_segments((-0.06, 0, 0.1, 0.05), 0.02, S, (0, 0, 0.05))


@pytest.mark.parametrize(
    ('rectangle', 'top'),
    [((0, 0, math.nan, 1), 0.0), ((0.1, 0, 0, 0.1), 0.0), ((0, 0, 1, 1), math.inf)],
)
def test_nonsense_is_refused(rectangle, top):
    with pytest.raises(PlanError, match='scan'):
        scan_segments(rectangle, top, S, (0, 0, 0.05))


@given(
    st.floats(0, 0.1),
    st.floats(0.02, 0.05),
    st.floats(0.005, 0.12),
    st.floats(0.005, 0.1),
    st.floats(0.0, 0.2),
)
@settings(max_examples=60, deadline=None)
def test_a_window_is_seen_from_the_nearer_end_on_without_a_margin_beside_the_passes(
    x0, y0, width, depth, from_x
):
    start = (from_x, 0.05, 0.05)
    out = scan_segments((x0, y0, x0 + width, y0 + depth), 0.02, S, start, window=True)
    check_chain(out)
    x, y = np.meshgrid(
        np.linspace(x0 - S.margin, x0 + width + S.margin, 40), np.linspace(y0, y0 + depth, 40)
    )
    assert seen(out, x, y).all()
    passes = [s for s in out if s.kind == Kind.SCAN]
    assert len(passes) == len(scan_lanes(y0, y0 + depth, S))
    ends = passes[0].start[0], passes[0].end[0]
    assert abs(from_x - ends[0]) <= abs(from_x - ends[1]) + 1e-12
