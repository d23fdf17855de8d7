import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_adapt.identification import (
    Estimate,
    Identifier,
    Layer,
    LayerEvidence,
    Shortfall,
    layer_evidence,
    update,
)

SHAPE, RES, WIDTH = (90, 120), 0.5e-3, 6e-3


def layer(ratio=0.85, noise=3e-5, seed=0, commanded=2e-3, exponent=-1.0):
    rng = np.random.default_rng(seed)
    inside = np.zeros(SHAPE, bool)
    inside[6:-6, 6:-6] = True
    speed = np.broadcast_to(1 + 0.25 * np.sin(np.linspace(0, 9, SHAPE[1])), SHAPE)
    asked = np.where(inside, commanded / speed, np.nan)
    before = 1e-4 * rng.standard_normal(SHAPE)
    grown = ratio * commanded * speed**exponent
    after = before + np.where(inside, grown, 0) + noise * rng.standard_normal(SHAPE)
    after[rng.random(SHAPE) < 0.02] = np.nan
    return Layer(before, after, asked, RES, WIDTH)


def evidence(ratio, sigma=0.01):
    return LayerEvidence(ratio, sigma, 1.0, math.inf, 5e-5, 2e-3, 30)


@settings(max_examples=20)
@given(st.floats(0.7, 1.3))
def test_ratio_is_measured_within_its_uncertainty(ratio):
    e = layer_evidence(layer(ratio))
    assert abs(e.ratio - ratio) < 4 * e.ratio_sigma
    assert e.ratio_sigma < 0.01


@pytest.mark.parametrize('exponent', [-1.0, -0.4])
def test_height_exponent_is_found_where_the_speed_varied(exponent):
    e = layer_evidence(layer(exponent=exponent))
    assert e.slope == pytest.approx(-exponent, abs=0.1)
    now = update(Estimate(), e, 0.7)
    assert abs(now.height_exponent - exponent) < 0.15
    assert now.slope_sigma < 0.3


def test_without_variation_the_exponent_keeps_its_prior():
    good = layer()
    e = layer_evidence(replace(good, commanded=np.where(np.isfinite(good.commanded), 2e-3, np.nan)))
    assert math.isinf(e.slope_sigma)
    now = update(Estimate(), e, 0.7)
    assert (now.slope, now.slope_sigma) == (1.0, Estimate().slope_sigma)


def test_edges_and_spikes_do_not_count():
    bad = layer()
    bad.after[6:10] -= 1.5e-3
    bad.after[40:50, 40:50] += 5e-3
    assert layer_evidence(bad).ratio == pytest.approx(0.85, abs=0.01)


def test_too_little_to_see_is_no_evidence():
    hidden = layer()
    hidden.after[:, 14:] = np.nan
    assert layer_evidence(hidden) is None
    assert layer_evidence(replace(layer(), commanded=np.zeros(SHAPE))) is None
    wall = np.full(SHAPE, np.nan)
    wall[40:52] = 2e-3  # a single bead has no interior
    assert layer_evidence(replace(layer(), commanded=wall)) is None


def test_estimate_converges_forgets_and_compensates():
    e = Estimate()
    for _ in range(4):
        e = update(e, evidence(0.85), 0.7)
    assert e.efficiency_ratio == pytest.approx(0.85, abs=0.003)
    assert e.flow_factor == pytest.approx(1 / 0.85, rel=0.005)
    assert e.efficiency_sigma < 0.01
    for _ in range(12):
        e = update(e, evidence(0.92), 0.7)
    assert e.efficiency_ratio == pytest.approx(0.92, abs=0.005)


def test_drift_alarm_needs_a_settled_estimate_and_a_real_difference():
    e = Estimate()
    for _ in range(3):
        e = update(e, evidence(0.85), 0.7)
        assert not e.drift_alarm
    jumped = update(e, evidence(1.05), 0.7)
    assert jumped.drift_alarm
    assert jumped.innovation == pytest.approx(0.2 * 2e-3, rel=0.05)
    assert jumped.efficiency_ratio < 0.95  # one odd layer does not turn the process round
    assert not update(e, evidence(0.87), 0.7).drift_alarm


@given(st.lists(st.floats(0.05, 3.0), min_size=1, max_size=8))
def test_whatever_is_measured_the_factor_stays_bounded(ratios):
    e = Estimate()
    for r in ratios:
        e = update(e, evidence(r), 0.7)
        assert 1 / 1.3 <= e.flow_factor <= 1 / 0.7
        assert e.drift_alarm or 0.7 <= r <= 1.3


def test_shortfall_that_comes_back_is_learned_and_one_that_does_not_fades():
    place, once = (slice(40, 50), slice(40, 50)), (slice(20, 30), slice(80, 90))
    s = Shortfall()
    for n in range(6):
        laid = layer(seed=n, noise=0.0)
        laid.after[place] += 0.2 * 0.85 * laid.commanded[place]
        if n == 0:
            laid.after[once] -= 0.3 * 0.85 * laid.commanded[once]
        s = s.learn(laid, 0.85, 0.3)
    assert np.nanmean(s.share[place]) == pytest.approx(-0.2, abs=0.04)
    assert 0 < np.nanmean(s.share[once]) < 0.06
    assert np.abs(s.share[60:80, 20:100]).max() < 1e-6


def test_shortfall_is_bounded_and_leaves_unknown_cells_alone():
    laid = layer()
    laid.after[40:50, 40:50] += 0.05
    laid.after[50:60, 50:60] = np.nan
    share = Shortfall().learn(laid, 0.85, 1.0).share
    seen = np.isfinite(laid.after[40:50, 40:50])
    assert (share[40:50, 40:50][seen] == -0.5).all()
    assert (share[50:60, 50:60] == 0).all()
    assert np.isfinite(share).all()


def test_same_layer_twice_counts_once_and_another_job_starts_afresh():
    once, twice = Identifier(), Identifier()
    for who, repeats in ((once, 1), (twice, 3)):
        for number in (1, 2, 3):
            for _ in range(repeats):
                who.start('job', number)
                if number > 1:
                    who.add(layer(seed=number))
    assert once.estimate == twice.estimate
    assert once.estimate.updates == once.shortfall.layers == 2
    assert np.array_equal(once.shortfall.share, twice.shortfall.share)
    once.start('other', 1)
    assert (once.estimate, once.shortfall) == (Estimate(), Shortfall())
    twice.start('job', 1)  # the job began again
    assert (twice.estimate, twice.shortfall) == (Estimate(), Shortfall())


def test_a_layer_that_cannot_be_seen_teaches_nothing():
    who = Identifier()
    who.start('job', 2)
    hidden = layer()
    hidden.after[:] = np.nan
    who.add(hidden)
    assert (who.estimate, who.shortfall) == (Estimate(), Shortfall())
