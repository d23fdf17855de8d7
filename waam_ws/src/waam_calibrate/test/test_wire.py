"""The wire wheel: its geometry, the threshold of underfeed, and measurements that do not tell it."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_calibrate import outcome, pictures, report, results
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.lead import WireRecord
from waam_calibrate.wire import Feed, Wheel, calibrate, normal_feed

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
WHEEL = Wheel(35.0, 4096)


def test_the_wheel_of_the_source() -> None:
    """109.96 mm per turn, not the 88.91 that are printed; 20 slots are 5.5 mm each."""
    assert Wheel(35.0, 20).per_turn == pytest.approx(109.96, abs=5e-3)
    assert Wheel(35.0, 20).per_count == pytest.approx(5.498, abs=1e-3)
    assert Wheel(28.3, 20).per_turn == pytest.approx(88.91, abs=5e-3)


def test_the_wheel_of_the_source_is_too_coarse_for_slow_wire() -> None:
    """At 33 mm/s it counts three slots in the half second after which the controller stops."""
    lengths = [1000.0, 1000.0, 1000.0]
    counts = [182.0, 182.0, 182.0]
    with pytest.raises(EvidenceError, match=r'counts 3\.0 in 0\.5 s.*needs 10'):
        calibrate(Wheel(35.0, 20), lengths, counts, 33.0)
    assert calibrate(Wheel(35.0, 20), lengths, counts, 115.0).resolution < 0.1


@given(st.floats(0.9, 1.1), st.floats(0.0, 1e-3))
@settings(max_examples=30, deadline=None)
def test_counts_per_mm(slip, scatter) -> None:
    lengths = np.array([500.0, 700.0, 900.0])
    counts = slip * lengths / WHEEL.per_count * (1 + scatter * np.array([1.0, -1.0, 0.5]))
    found = calibrate(WHEEL, list(lengths), list(counts), 33.0)
    assert found.per_mm * WHEEL.per_count == pytest.approx(slip, rel=2e-3)
    assert found.threshold == 0.9


@pytest.mark.parametrize(
    ('wheel', 'lengths', 'counts', 'text'),
    [
        (WHEEL, [500, 500], [18600, 18600], 'at least 3'),
        (WHEEL, [500, 500, 500], [18600, 18600], 'one for each'),
        (WHEEL, [100, 500, 500], [3725, 18600, 18600], 'too short'),
        (WHEEL, [500, 500, 500], [18600, 17600, 19600], 'does the wheel slip'),
        (WHEEL, [500, 500, 500], [14000, 14000, 14000], 'wrong diameter'),
        (WHEEL, [500, 500, 500], [0, 18600, 18600], 'above 0'),
        (WHEEL, [500, 500, float('nan')], [18600] * 3, 'above 0'),
        (Wheel(1.0, 4096), [500] * 3, [18600] * 3, '5 to 200 mm'),
        (Wheel(35.0, 1), [500] * 3, [18600] * 3, '4 to 100000'),
    ],
)
def test_poor_measurements_are_refused(wheel, lengths, counts, text) -> None:
    with pytest.raises(EvidenceError, match=text):
        calibrate(wheel, lengths, counts, 33.0)


def fed(sigma: float, mean: float = 1.0, seconds: float = 20.0) -> WireRecord:
    at = np.arange(0, seconds, 0.01)
    command = np.full(len(at), 0.08)
    each = np.repeat(np.random.default_rng(1).normal(mean, sigma, len(at) // 50 + 1), 50)
    return WireRecord(at, command, command * each[: len(at)], np.ones(len(at), bool))


def test_the_threshold_must_clear_normal_feed() -> None:
    feed = normal_feed(fed(0.01))
    assert feed.mean == pytest.approx(1.0, abs=0.01) and feed.sigma == pytest.approx(0.01, rel=0.4)
    args = (WHEEL, [500.0] * 3, [18600.0] * 3, 33.0)
    assert calibrate(*args, feed=feed).feed is feed
    with pytest.raises(EvidenceError, match='without underfeed'):
        calibrate(*args, feed=normal_feed(fed(0.05)))
    with pytest.raises(EvidenceError, match='without underfeed'):
        calibrate(*args, feed=Feed(np.array([0.91, 0.92, 0.93])))
    with pytest.raises(EvidenceError, match='windows'):
        normal_feed(fed(0.01, seconds=3.0))


def test_result_and_its_page() -> None:
    found = calibrate(WHEEL, [500.0] * 3, [18600.0] * 3, 33.0, feed=normal_feed(fed(0.01)))
    good = outcome.of_wire(found, 37.25, 'threshold').of(NOW)
    assert not good.refuses and good.settings == [('threshold', 0.9)]
    bad = outcome.of_wire(found, 40.0, '').of(NOW)
    assert 'reads -7.0 % wrong' in bad.refuses and not bad.settings
    assert results.refusals([good]) == [] and results.refusals([bad])[0].startswith('wire: ')
    page = report.page(bad, [pictures.wire_lengths(found)])
    assert 'A job will refuse' in page and 'data:image/png' in page
    assert results.from_data(results.to_data(good)) == good
