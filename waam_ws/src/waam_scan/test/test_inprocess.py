from pathlib import Path

import numpy as np
import pytest

from waam_scan.commands.inprocess_report import compared, filter_file
from waam_scan.recordings.files import InprocessScan
from waam_scan.recordings.inprocess import (  # fmt: skip
    FilterLimits,
    delay_of,
    filter_scan,
    median_filter,
    pieces,
    quality,
)

DATA = Path(__file__).parents[5] / 'shared/data/inprocess_profiles'


def top_at(t):
    """m, distance of the crown over time"""
    return 143e-3 + 0.8e-3 * np.sin(3 * t)


def recorded(seed=0, n=300, spatter=0.1, blind=0.05):
    """A bead 3 mm wide, 30 points at 43 Hz: flicker, spatter clusters as large as the bead, blind profiles."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 43.0
    x = np.full((n, 60), np.nan)
    z = np.full((n, 60), np.nan)
    for k in range(n):
        if rng.random() < blind:
            continue
        across = np.linspace(-1.5e-3, 1.5e-3, 30) + rng.normal(0, 5e-6, 30)
        x[k, :30] = 4.5e-3 + across
        level = top_at(t[k]) + rng.normal(0, 20e-6)  # ripples
        z[k, :30] = level + 0.15 * across**2 / 1e-3 + rng.normal(0, 15e-6, 30)
        if rng.random() < spatter:
            count = 30
            x[k, 30:60] = 7e-3 + np.linspace(0, 1.7e-3, count)
            z[k, 30:60] = top_at(t[k]) + rng.uniform(3e-3, 8e-3) + rng.normal(0, 15e-6, count)
    order = np.argsort(rng.random(60))
    return InprocessScan(np.ones(n, int), t, x[:, order], z[:, order])


def test_the_crown_is_followed_through_spatter_and_blind_profiles():
    scan = recorded()
    s = filter_scan(scan)
    error = (s.height - top_at(s.t))[5:]
    assert np.isfinite(error).all(), 'blind profiles are bridged'
    assert np.sqrt(np.mean(error**2)) < 25e-6
    assert np.abs(error).max() < 0.12e-3
    seen = np.isfinite(scan.z).any(axis=1)
    assert s.used[seen].mean() > 0.97 and not s.used[~seen].any()
    assert 0.6 < np.sqrt(np.mean((error / s.u[5:]) ** 2)) < 1.6, 'its uncertainty is true'


def test_it_beats_the_plain_median_filter_in_all_that_is_compared():
    found = compared(filter_scan(recorded()))
    ours, median, raw = (
        found[k] for k in ('filtered', 'running median of 5', 'median of each profile')
    )
    assert raw.spikes > 10 and ours.spikes == 0
    assert ours.noise <= median.noise
    assert abs(ours.delay) <= 0.021 and median.delay >= ours.delay + 0.02
    assert ours.lag1 > raw.lag1, 'spatter and flicker are gone'


def test_a_step_of_the_surface_is_believed_after_a_few_profiles():
    scan = recorded(spatter=0.0, blind=0.0)
    z = scan.z.copy()
    z[150:] += 5e-3
    s = filter_scan(InprocessScan(scan.layer, scan.t, scan.x, z), FilterLimits(lost=4))
    true = top_at(s.t) + np.where(np.arange(len(s.t)) >= 150, 5e-3, 0.0)
    assert not s.used[150:154].any() and s.used[154:].mean() > 0.95
    assert np.abs(s.height - true)[160:].max() < 0.12e-3


def test_heights_and_distances_are_the_same_but_for_the_sign():
    scan = recorded(n=60)
    down = filter_scan(scan)
    up = filter_scan(InprocessScan(scan.layer, scan.t, scan.x, -scan.z), distance=False)
    np.testing.assert_allclose(up.height, -down.height, equal_nan=True)


def test_pieces_end_where_points_jump_and_short_ones_are_spatter():
    x = np.arange(30) * 0.06e-3
    z = np.where(np.arange(30) < 20, 0.0, 1e-3)
    z[5] = np.nan
    found = pieces(x[::-1], z[::-1])
    assert [len(a) for a, _ in found] == [19, 10]
    assert pieces(x[:7], z[:7]) == []


def test_quality_measures_what_it_says():
    rng = np.random.default_rng(0)
    t = np.arange(400) / 40.0
    noisy = 1e-3 * np.sin(t) + rng.normal(0, 30e-6, 400)
    q = quality(t, noisy, noisy)
    assert abs(q.noise - 30e-6) < 4e-6 and q.spikes == 0 and abs(q.delay) < 6e-3
    noisy[100] += 1e-3
    noisy[200] = np.nan
    q = quality(t, noisy, noisy)
    assert (q.spikes, q.missing) == (1, 1)
    wave = np.sin(5 * t)
    assert abs(delay_of(t, np.interp(t - 0.05, t, wave), wave) - 0.05) < 6e-3
    assert median_filter(np.array([1.0, 9.0, 2.0, np.nan, 3.0])).tolist() == [
        1.0,
        5.0,
        2.0,
        2.0,
        2.5,
    ]


@pytest.mark.skipif(not DATA.is_dir(), reason='recordings of others (../shared/data) are not here')
def test_real_profiles_beside_the_arc(tmp_path, capsys):
    s = filter_file(DATA / 'Representative_Layer_raw_points.csv', tmp_path)
    found = compared(s)
    ours, median, raw = (
        found[k] for k in ('filtered', 'running median of 5', 'median of each profile')
    )
    assert len(s.t) == 399 and s.used.sum() > 370
    assert raw.spikes >= 5 and ours.spikes == 0
    assert ours.noise < median.noise < raw.noise
    assert abs(ours.delay) < 0.02 < median.delay
    table = (tmp_path / 'Representative_Layer_raw_points_filtered.csv').read_text().splitlines()
    assert len(table) == 400 and table[0].startswith('t_s,')
    assert (tmp_path / 'Representative_Layer_raw_points_filtered.png').stat().st_size > 20_000
    assert 'lag-1' in capsys.readouterr().out
