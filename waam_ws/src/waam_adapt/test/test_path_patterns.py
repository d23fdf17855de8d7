"""Layers of different patterns: each has its own share of the efficiency, and one pattern alone has none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_adapt.identify.evidence import Layer
from waam_adapt.identify.identification import Identifier
from waam_adapt.identify.path_patterns import MAX_OFFSET, PathPatterns, pattern
from waam_adapt.types import CorrectionInput


def turned(points: list[tuple[float, float]], degrees: float) -> np.ndarray:
    a = np.radians(degrees)
    return np.array(points, float) @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])


RINGS = (turned([(0, 0), (50, 0), (50, 30), (0, 30), (0, 0)], 0),)
SLANTED = (turned([(0, 0), (30, 0), (30, 4), (0, 4)], 45),)
OTHER_WAY = (turned([(0, 0), (30, 0), (30, 4), (0, 4)], -45),)


def test_a_pattern_does_not_know_the_quadrant() -> None:
    assert pattern(SLANTED) == pytest.approx(pattern(OTHER_WAY), abs=0.2)
    known = PathPatterns().learn(RINGS, 0.0, 1e-3).learn(SLANTED, -0.1, 1e-3)
    assert len(known.patterns) == 2
    assert known.index(OTHER_WAY) == known.index(SLANTED) == 1
    assert known.index((turned([(0, 0), (50, 0)], 90),)) == 0
    assert known.index(()) is None and known.offset(()) == 0.0


def test_one_kind_alone_is_the_process() -> None:
    known = PathPatterns()
    for difference in (0.1, -0.2, 0.05):
        known = known.learn(RINGS, difference, 1e-3)
    assert known.offset(RINGS) == 0.0


def test_two_kinds_are_told_apart_while_the_process_drifts() -> None:
    """The believed process follows; the kinds settle at their distance."""
    rng, known, believed = np.random.default_rng(1), PathPatterns(), 1.0
    true = {'rings': 1.0, 'slanted': 0.9}
    paths = {'rings': RINGS, 'slanted': SLANTED}
    for n in range(24):
        kind = 'rings' if n % 4 in (0, 3) else 'slanted'
        ratio = true[kind] * (1 - 0.002 * n) * (1 + 0.01 * rng.standard_normal())
        expected = believed * (1 + known.offset(paths[kind]))
        known = known.learn(paths[kind], ratio / expected - 1, 1.5e-3)
        believed += 0.5 * (ratio / (1 + known.offset(paths[kind])) - believed)
    apart = (1 + known.offset(SLANTED)) / (1 + known.offset(RINGS))
    assert apart == pytest.approx(0.9, abs=0.03)


@given(
    st.lists(
        st.tuples(st.sampled_from((RINGS, SLANTED, ())), st.floats(-2, 2), st.floats(1e-6, 1.0)),
        max_size=30,
    )
)
@settings(max_examples=50, deadline=None)
def test_offsets_stay_bounded(layers) -> None:
    known = PathPatterns()
    for paths, difference, variance in layers:
        known = known.learn(paths, difference, variance)
    assert all(abs(o) <= MAX_OFFSET for o in known.offsets)
    assert len(known.patterns) == len(known.offsets) == len(known.variances) <= 2


@pytest.mark.parametrize('ratio_high', (0.0, 1.8))
def test_in_plans_of_our_own_another_pattern_is_the_process(ratio_high: float) -> None:
    """One layer of rings with its full height, then slanted ones that come out a tenth low."""
    known, z, last = Identifier(), np.zeros((60, 60)), None
    planned = np.full_like(z, 2e-3)
    for number, (paths, share) in enumerate([(RINGS, 1.0)] + 5 * [(SLANTED, 0.9)], 1):
        on_map = tuple(1e-3 * p + 5e-3 for p in paths)
        request = CorrectionInput(
            z, z + planned, planned, 1e-3, 6e-3, 0.3, paths=on_map, ratio_high=ratio_high
        )
        known.start('job', number)
        if last is not None:
            known.add(last)
        known.prepare(request)
        last = Layer(z, z + share * planned, planned, 1e-3, 6e-3)
        z = last.after
    flow = known.flow_factor(request)
    if ratio_high:  # half of it is the pattern's
        assert known.efficiency.state.patterns.offset(on_map) < -0.02 and flow < 1.08
    else:
        assert (
            flow == pytest.approx(1 / 0.9, rel=0.015)
            and not known.efficiency.state.patterns.patterns
        )
