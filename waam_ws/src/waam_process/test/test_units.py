import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_process import units

PAIRS = [
    (units.m_min, units.to_m_min, 60.0, 1.0),
    (units.mm, units.to_mm, 1e3, 1.0),
]


@pytest.mark.parametrize(('to_si', 'from_si', 'value', 'si'), PAIRS)
def test_known_value(to_si, from_si, value, si):
    assert to_si(value) == pytest.approx(si)
    assert from_si(si) == pytest.approx(value)


def test_feed_of_a_program():
    assert units.to_mm_min(0.01) == pytest.approx(600.0)


@given(st.floats(-1e6, 1e6))
def test_there_and_back(value):
    for to_si, from_si, _, _ in PAIRS:
        assert from_si(to_si(value)) == pytest.approx(value, rel=1e-12, abs=1e-12)
        assert to_si(from_si(value)) == pytest.approx(value, rel=1e-12, abs=1e-12)
