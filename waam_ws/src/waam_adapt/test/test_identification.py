import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_adapt import filters
from waam_adapt.beads.bead_bias import BeadBias
from waam_adapt.identify.efficiency import Process
from waam_adapt.identify.estimate import Estimate, update, update_slope
from waam_adapt.identify.evidence import (
    BlockAverages,
    Layer,
    LayerEvidence,
    edge_sigma,
    layer_evidence,
)
from waam_adapt.identify.identification import Identifier
from waam_adapt.identify.layers import model_of_request
from waam_adapt.types import CorrectionInput

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
    return LayerEvidence(ratio, sigma, 5e-5, 2e-3, 30, np.full((5, 6), 2e-3), np.full((5, 6), 2e-3))


@settings(max_examples=20)
@given(st.floats(0.7, 1.3))
def test_ratio_is_measured_within_its_uncertainty(ratio):
    e = layer_evidence(layer(ratio))
    assert abs(e.ratio - ratio) < 4 * e.ratio_sigma
    assert e.ratio_sigma < 0.01


def job(shape, footprint, exponent, layers=30, noise=0.06, seed=0, gain=0.6):
    """A loop that answers errors of the surface with metal, where places have habits of their own: its identifier."""
    rng, who = np.random.default_rng(seed), Identifier()
    z, last = np.zeros(shape), None
    planned = np.where(footprint, 2e-3, 0.0)
    coarse = [int(np.ceil(n / 12)) for n in shape]
    habit = np.kron(rng.normal(1, 0.15, coarse), np.ones((12, 12)))[: shape[0], : shape[1]]
    for n in range(1, layers + 1):
        who.start('job', n)
        if last is not None:
            who.add(Layer(last[0], z, last[1], RES, WIDTH))
        who.prepare(CorrectionInput(z, np.full(shape, (n - 1) * 2e-3), planned, RES, WIDTH, 0.3))
        error = (n - 1) * 2e-3 - z
        asked = planned * np.clip(1 + gain * error / 2e-3, 0.4, 1.8)
        rough = np.kron(rng.normal(0, noise, coarse), np.ones((12, 12)))[: shape[0], : shape[1]]
        with np.errstate(divide='ignore', invalid='ignore'):
            grown = planned * (asked / np.where(planned > 0, planned, 1)) ** -exponent
        last = z, asked
        z = (
            z
            + np.where(footprint, grown * habit * (1 + rough), 0)
            + 2e-5 * rng.standard_normal(shape)
        )
    return who


def test_height_exponent_of_a_pad_and_of_a_wall_is_found_by_itself():
    """Though the loop asks for more where growth is always poor, and answers its own noise."""
    pad, wall = np.zeros((96, 132), bool), np.zeros((36, 288), bool)
    pad[6:-6, 6:-6] = True
    wall[12:24, 6:-6] = True
    found = [job(m.shape, m, e).estimate for m, e in ((pad, -1.0), (wall, -0.3))]
    assert found[0].height_exponent == pytest.approx(-1.0, abs=0.12)
    assert found[1].height_exponent == pytest.approx(-0.3, abs=0.1)
    assert all(f.slope_sigma < 0.15 for f in found)


def test_the_slope_of_one_layer_alone_is_no_evidence_and_without_variation_the_prior_stays():
    who = Identifier()
    for n in (1, 2):
        who.start('job', n)
        if n == 2:
            who.add(layer())
    assert (who.estimate.slope, who.estimate.slope_sigma) == (1.0, Estimate().slope_sigma)
    flat = replace(layer(), commanded=np.where(np.isfinite(layer().commanded), 2e-3, np.nan))
    e = layer_evidence(flat)
    assert math.isinf(BlockAverages.after(None, e).slope(e)[1])
    assert update_slope(Estimate(), 0.2, math.inf) == Estimate()


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(0.001, 2.0)), max_size=20))
def test_whatever_slopes_come_the_exponent_stays_bounded(slopes):
    e = Estimate()
    for slope, sigma in slopes:
        e = update_slope(e, slope, sigma)
        assert -1.3 <= e.height_exponent <= -0.2
        assert 0 < e.slope_sigma < 0.5


def test_on_a_wall_more_metal_is_asked_for_than_is_missing():
    footprint = np.zeros((36, 288), bool)
    footprint[12:24, 6:-6] = True
    who = job(footprint.shape, footprint, -0.4)
    z = np.full(footprint.shape, 29 * 2e-3)
    target = np.where(footprint, 29 * 2e-3 + 1e-4, np.nan)
    request = CorrectionInput(z, target, np.where(footprint, 2e-3, 0.0), RES, WIDTH, 0.3)
    asked = who.prepare(request).error[footprint]
    slope = who.estimate.slope + who.estimate.slope_sigma
    assert asked == pytest.approx(1e-4 / slope)
    assert slope < 0.65
    assert Identifier().prepare(request) is request


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


def test_estimate_converges_forgets_and_compensates():
    e = Estimate()
    for _ in range(6):
        e = update(e, evidence(0.85), 0.7)
    assert e.efficiency_ratio == pytest.approx(0.85, abs=0.003)
    assert e.flow_factor() == pytest.approx(1 / 0.85, rel=0.005)
    assert replace(e, slope=0.5).flow_factor() == pytest.approx(1 / 0.85**2, rel=0.01)
    assert e.efficiency_sigma < 0.02
    for _ in range(15):
        e = update(e, evidence(0.92), 0.7)
    assert e.efficiency_ratio == pytest.approx(0.92, abs=0.005)


@pytest.mark.parametrize('scatter', [0.004, 0.05])
def test_how_much_layers_scatter_is_identified_and_the_estimate_follows_less_of_it(scatter):
    rng, e, errors, steps = np.random.default_rng(5), Estimate(), [], []
    for _ in range(80):
        before = e.efficiency_ratio
        e = update(e, evidence(0.9 + scatter * rng.standard_normal(), sigma=0.003), 0.7)
        errors.append(e.efficiency_ratio - 0.9)
        steps.append(abs(e.efficiency_ratio - before))
    assert e.layer_noise == pytest.approx(scatter, rel=0.6)
    assert np.std(errors[20:]) < 0.75 * scatter
    assert max(steps[2:]) < max(3 * scatter, 0.05) * 0.7


def pad_request(**changes) -> CorrectionInput:
    """A pad of seven beads that overlap; beads told."""
    inside = np.zeros(SHAPE, bool)
    inside[6:-6, 6:-6] = True
    y = np.arange(6e-3, 40e-3, 4.4e-3)
    paths = tuple(np.array([[4e-3, v], [56e-3, v]])[:: 1 - 2 * (i % 2)] for i, v in enumerate(y))
    z = np.zeros(SHAPE)
    return CorrectionInput(
        z, z, np.where(inside, 2e-3, 0.0), RES, WIDTH, 0.3, paths=paths, **changes
    )


def test_beads_that_overlap_keep_all_of_their_metal_whatever_exponent_was_seen():
    """An exponent that scans of a rough surface suggest must not scale the wire of a whole layer."""
    who = Identifier()
    who.start('job', 1)
    who.efficiency.state = Process(Estimate(efficiency_ratio=0.9, slope=0.6))
    assert who.flow_factor(pad_request()) == pytest.approx(1 / 0.9)
    single = replace(pad_request(), paths=(np.array([[4e-3, 20e-3], [56e-3, 20e-3]]),))
    assert who.flow_factor(single) == pytest.approx(0.9 ** (-1 / 0.6))


def test_what_the_heat_factor_takes_off_is_put_back_at_once_and_not_learned_as_efficiency():
    who = Identifier()
    who.start('job', 1)
    cold = who.flow_factor(pad_request())
    assert who.flow_factor(pad_request(heat_factor=0.9)) == pytest.approx(cold / 0.9)
    for factor in (1.0, 0.9):  # laid with as much less wire as the factor says: the same process
        laid = layer(0.85)
        laid = replace(laid, commanded=laid.commanded * factor)
        laid = replace(laid, after=laid.before + factor * (laid.after - laid.before))
        assert layer_evidence(laid).ratio == pytest.approx(0.85, abs=0.01)


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
        assert 1 / 1.3 <= e.flow_factor() <= 1 / 0.7
        assert e.drift_alarm or 0.7 <= r <= 1.3


def test_same_layer_twice_counts_once_and_another_job_starts_afresh():
    once, twice = Identifier(), Identifier()
    for who, repeats in ((once, 1), (twice, 3)):
        for number in (1, 2, 3):
            for _ in range(repeats):
                who.start('job', number)
                if number > 1:
                    who.add(layer(seed=number))
    assert once.estimate == twice.estimate
    assert once.estimate.updates == 2
    once.start('other', 1)
    assert once.estimate == Estimate()
    twice.start('job', 1)  # the job began again
    assert twice.estimate == Estimate()


def test_a_layer_that_cannot_be_seen_teaches_nothing():
    who = Identifier()
    who.start('job', 2)
    hidden = layer()
    hidden.after[:] = np.nan
    who.add(hidden)
    assert who.estimate == Estimate()


def laid_pad(efficiency: np.ndarray, asked: np.ndarray | float = 1.0) -> Layer:
    """The pad of `pad_request` as it was laid. asked: of its planned height; efficiency: what grows of what was asked.
    Both (rows, cols)."""
    planned = pad_request().planned
    commanded = planned * asked
    return Layer(np.zeros(SHAPE), commanded * efficiency, commanded, RES, WIDTH, planned)


def watching(beads: BeadBias, laid: Layer) -> Estimate:
    """What an identifier that knows the beads of the pad believes after one layer of it."""
    who = Identifier(watch_beads=True)
    who.start('job', 1)
    who.prepare(pad_request())
    who.start('job', 2)
    who.beads.state = beads
    who.add(laid)
    return who.estimate


def test_a_third_of_a_layer_that_lies_low_counts_all_that_it_takes_off_the_mean():
    """What most blocks do would leave the layer 0.06 mm too low on average."""
    efficiency = np.full(SHAPE, 0.9)
    efficiency[:, :48] = 0.82
    laid = laid_pad(efficiency)
    inside = laid.commanded > 0
    mean = float(laid.after[inside].mean() / laid.commanded[inside].mean())
    assert layer_evidence(laid).ratio == pytest.approx(0.9, abs=0.005)
    assert mean < 0.88
    found = watching(BeadBias(), laid).efficiency_ratio
    assert found == pytest.approx(mean, abs=0.005)


def test_a_layer_that_is_all_edge_is_believed_less_than_a_wide_one_and_the_longer_the_more():
    """The metal of beads in a narrow pit flows back from its flanks: the layer is high, the wire is as it was."""
    wide = laid_pad(np.full(SHAPE, 1.1))
    inside = filters.depth(wide.commanded > 0) * RES
    band = (inside > 0) & (inside < 2 * WIDTH)
    narrow = replace(wide, commanded=np.where(band, wide.commanded, 0.0))
    assert edge_sigma(narrow) > 4 * edge_sigma(wide)
    found = []
    for laid in (wide, narrow):
        who = Identifier()
        who.start('job', 1)
        for layer in range(2, 6):
            who.start('job', layer)
            who.add(laid)
            found.append(who.estimate.efficiency_ratio)
    assert found[0] == pytest.approx(1.1, abs=0.01)
    assert found[4] < 1.07
    assert found[4] < found[5] < found[6] < found[7] < 1.1
    assert found[7] > 1.08


def test_a_spike_of_the_scan_does_not_move_the_level():
    laid = laid_pad(np.full(SHAPE, 0.9))
    laid.after[40:50, 40:50] += 5e-3
    assert watching(BeadBias(), laid).efficiency_ratio == pytest.approx(0.9, abs=0.005)


def test_metal_that_was_asked_for_because_beads_lack_it_is_no_loss_of_efficiency():
    model = model_of_request(pad_request())
    lack = np.zeros(model.shape)
    lack[:, :14] = 0.1
    asked = np.ones(SHAPE)
    asked[:, :42] = 1.1
    laid = laid_pad(0.9 / asked, asked)  # everywhere 0.9 of the plan, as was expected
    beads = BeadBias(missing=(0.9 * lack, 0.9 * lack), layers=(1, 1))
    ratios = [watching(b, laid).efficiency_ratio for b in (beads, BeadBias())]
    assert ratios[1] < 0.893
    assert ratios[0] == pytest.approx(0.9, abs=0.004)
