"""Layers of different patterns: each has its own share of the efficiency, and one pattern alone has none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_adapt.identify.kinds import MOST, Kinds, pattern


def turned(points: list[tuple[float, float]], degrees: float) -> np.ndarray:
    a = np.radians(degrees)
    return np.array(points, float) @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])


RINGS = (turned([(0, 0), (50, 0), (50, 30), (0, 30), (0, 0)], 0),)
SLANTED = (turned([(0, 0), (30, 0), (30, 4), (0, 4)], 45),)
OTHER_WAY = (turned([(0, 0), (30, 0), (30, 4), (0, 4)], -45),)


def test_a_pattern_does_not_know_the_quadrant() -> None:
    assert pattern(SLANTED) == pytest.approx(pattern(OTHER_WAY), abs=0.2)
    known = Kinds().learn(RINGS, 0.0, 1e-3).learn(SLANTED, -0.1, 1e-3)
    assert len(known.patterns) == 2
    assert known.index(OTHER_WAY) == known.index(SLANTED) == 1
    assert known.index((turned([(0, 0), (50, 0)], 90),)) == 0
    assert known.index(()) is None and known.offset(()) == 0.0


def test_one_kind_alone_is_the_process() -> None:
    known = Kinds()
    for difference in (0.1, -0.2, 0.05):
        known = known.learn(RINGS, difference, 1e-3)
    assert known.offset(RINGS) == 0.0


def test_two_kinds_are_told_apart_while_the_process_drifts() -> None:
    """The believed process follows; the kinds settle at their distance."""
    rng, known, believed = np.random.default_rng(1), Kinds(), 1.0
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
    known = Kinds()
    for paths, difference, variance in layers:
        known = known.learn(paths, difference, variance)
    assert all(abs(o) <= MOST for o in known.offsets)
    assert len(known.patterns) == len(known.offsets) == len(known.variances) <= 2
