"""The expected RMS of the coming surface: how often it holds, and what it says of a loop that diverges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_adapt.identify.outcome import OutcomeForecast, basis


def covered(measured: np.ndarray, of: np.ndarray) -> tuple[float, list[float]]:
    """Share of the layers inside of their interval, and the ratio of the ends of the intervals."""
    known, inside, wide = OutcomeForecast(), [], []
    for b, m in zip(of, measured, strict=True):
        told = known.expect(b)
        inside.append(told.low <= m <= told.high)
        wide.append(told.high / told.low)
        known = known.after(b, m)
    return float(np.mean(inside)), wide


def test_nine_layers_of_ten_lie_inside_whatever_the_scatter_of_the_job():
    rng, shares = np.random.default_rng(3), []
    for sigma in (0.1, 0.2, 0.35):
        for _ in range(40):
            bias = rng.normal(0, 0.35) + np.cumsum(rng.normal(0, 0.1, 12))
            of = np.full(12, 1e-4)
            shares.append(covered(of * np.exp(bias + sigma * rng.standard_normal(12)), of)[0])
    assert 0.85 < np.mean(shares) < 0.98


def test_a_loop_that_diverges_is_foretold_larger_errors():
    """Every layer a third worse: the surface before it says so."""
    measured = 1e-4 * 1.35 ** np.arange(14)
    of = np.array([basis(m, 1.5e-3) for m in np.concatenate([[1e-4], measured[:-1]])])
    share, wide = covered(measured, of)
    assert share >= 0.75
    assert max(wide) < 12


def test_the_interval_gets_narrower_as_layers_come_out_as_foretold():
    of = np.full(8, 1e-4)
    share, wide = covered(1.4 * of, of)
    assert share > 0.8 and wide[-1] < 0.6 * wide[0]


def test_the_network_moves_the_basis_and_silence_does_not():
    alone = basis(2e-4, 1.5e-3)
    assert basis(2e-4, 1.5e-3, 0.5 * alone) < alone < basis(2e-4, 1.5e-3, 2 * alone)
    assert alone == pytest.approx(math.hypot(0.6 * 2e-4, 0.07 * 1.5e-3))


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(allow_nan=True)), max_size=30))
def test_whatever_is_measured_the_interval_is_one(layers):
    known = OutcomeForecast()
    for of, measured in layers:
        known = known.after(of, measured)
        told = known.expect(1e-4)
        assert 0 < told.low < told.rms < told.high < math.inf
