"""Statistics over the seeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_lab import LabMaps, LabResult, bands
from waam_process.grid import GridSpec

SPEC = GridSpec(0.0, 0.0, 1e-3, 2, 3)


def result(seed: int, rms: float = 1e-4, verdict: str = 'in tolerance', maps=None) -> LabResult:
    share = 0.99 if verdict == 'in tolerance' else 0.5
    return LabResult(seed, verdict, 0, '', rms=rms, share_in_tolerance=share, maps=maps)


def test_worst_and_best_know_which_way_is_good():
    results = [result(1, 1e-4), result(2, 3e-4, 'out of tolerance'), result(3, 2e-4)]
    rms = bands.band(results, 'rms')
    share = bands.band(results, 'share_in_tolerance', more_is_better=True)
    assert (rms.mean, rms.best, rms.worst, rms.worst_seed) == (pytest.approx(2e-4), 1e-4, 3e-4, 2)
    assert (share.best, share.worst, share.worst_seed) == (0.99, 0.5, 2)


def test_failed_jobs_have_no_figures_but_count_against_the_share():
    results = [result(1), LabResult(2, 'failed', 107, 'no map')]
    assert bands.band(results, 'rms').mean == 1e-4
    share = bands.in_tolerance(results)
    assert (share.count, share.of, share.value) == (1, 2, 0.5)
    assert bands.band([results[1]], 'rms') is None
    assert bands.maps([results[1]], 2e-4) is None
    assert not bands.judged_errors([results[1]]).size


def test_the_next_value_lies_in_its_interval_as_often_as_promised():
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(4000):
        values = rng.normal(5.0, 2.0, 9)
        low, high = bands.next_value(values[:8])
        inside += low <= values[8] <= high
    assert inside / 4000 == pytest.approx(0.95, abs=0.01)
    assert math.isnan(bands.next_value(np.array([1.0, 2.0]))[0])


@given(st.integers(0, 30), st.integers(1, 30))
def test_the_share_lies_in_its_interval(k, extra):
    n = k + extra - (k > 0)
    results = [result(i, verdict='in tolerance' if i < k else 'out of tolerance') for i in range(n)]
    share = bands.in_tolerance(results)
    assert 0.0 <= share.low <= share.value <= share.high <= 1.0


def test_nineteen_of_twenty():
    share = bands.in_tolerance(
        [result(i, verdict='in tolerance' if i else 'failed') for i in range(20)]
    )
    assert (share.low, share.high) == (
        pytest.approx(0.7513, abs=1e-4),
        pytest.approx(0.9987, abs=1e-4),
    )


def test_maps_keep_the_sign_of_the_largest_error():
    nan = math.nan
    errors = [[[1e-4, -3e-4, nan], [0, 0, 0]], [[2e-4, 1e-4, nan], [0, 0, nan]]]
    on = np.array([[True, True, True], [True, True, True]])
    off = np.array([[False, False, False], [True, True, True]])
    made = [LabMaps(SPEC, np.array(e, np.float32), on, off, np.zeros((2, 3))) for e in errors]
    maps = bands.maps([result(i, maps=m) for i, m in enumerate(made)], 2.5e-4)
    assert maps.worst[0, :2] == pytest.approx([2e-4, -3e-4])
    assert maps.mean[0, :2] == pytest.approx([1.5e-4, -1e-4])
    assert maps.within[0, :2] == pytest.approx([1.0, 0.5])
    assert np.isnan(maps.mean[0, 2])
    assert maps.within[1, 2] == 1.0
    assert bands.judged_errors([result(1, maps=made[0]), result(2, maps=made[1])]).size == 5
