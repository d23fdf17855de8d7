"""What is asked for at the ends of beads: as far as the job has shown that it arrives there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_beads import SIZE, W, pad, zigzag

from waam_adapt.beads import bead_bias, solver
from waam_adapt.beads.bead_bias import BeadBias
from waam_adapt.beads.model import bead_model
from waam_adapt.laws import explicit as laws
from waam_adapt.types import BeadDeviation


def job(response: float, layers: int, seed: int = 1, noise: float = 0.03) -> list[BeadBias]:
    """What layers teach of a plant whose growth near the ends of beads answers what is asked by `response`, and that
    lacks 0.5 there."""
    rng, bias, out = np.random.default_rng(seed), BeadBias(), []
    for layer in range(1, layers + 1):
        model = bead_model(zigzag(layer), SIZE, W)
        asked = np.clip(1 + 0.3 * rng.standard_normal(len(model.first)), 0.4, 2.6)
        full, plan = (model.growth(a, 0.0) for a in (asked, np.ones(len(asked))))
        near = model.arc <= bead_bias.INNER * W
        grown = np.where(near, plan + response * (full - plan) - 0.5 * (plan > 0), full)
        grown = grown + noise * rng.standard_normal(SIZE)
        bias = bias.learn(layer, model, asked, grown, (plan > 0) * 1.0, 0.3)
        out.append(bias)
    return out


@pytest.mark.parametrize('response', [0.0, 0.4, 1.0])
def test_the_response_near_ends_is_what_the_layers_show(response):
    found = [b.response for b in job(response, 16)]
    assert found[1] == bead_bias.RESPONSE, 'one layer of a direction tells nothing'
    assert found[-1] == pytest.approx(response, abs=0.15)


def test_where_nothing_answers_little_is_believed_to_be_missing():
    """Metal that slides back from the ends was asked for there again and again, and heaped up behind them."""
    model = bead_model(zigzag(), SIZE, W)
    end = (model.arc < 0.4 * W) & (model.growth(np.ones(len(model.first)), 0.0) > 0.3)
    deaf, true = (job(r, 24)[-1] for r in (0.0, 1.0))
    assert abs(deaf.of(26, model)[end].mean()) < bead_bias.MIN_MISSING + 0.02
    assert true.of(26, model)[end].mean() > 0.4
    assert deaf.fill == bead_bias.MIN_FILL and true.fill == 1.0


@settings(max_examples=25, deadline=None)
@given(st.floats(-2, 3), st.floats(0, 0.3), st.integers(0, 99))
def test_no_plant_drives_it_beyond_its_limits(response, noise, seed):
    for bias in job(response, 8, seed, noise):
        assert 0 <= bias.response <= 1
        assert bead_bias.MIN_FILL <= bias.fill <= 1
        most = max(bias.response, bead_bias.MIN_MISSING) * bead_bias.MAX_MISSING
        assert np.isfinite(bias.ends).all() and np.abs(bias.ends).max() <= 2 * most + 1


def test_a_map_of_another_size_and_equal_layers_teach_no_response():
    bias = job(1.0, 2)[-1]
    other = replace(bias, newest=(np.zeros((2, 3, 3)), np.zeros((2, 3, 3))))
    model = bead_model(zigzag(), SIZE, W)
    asked = np.ones(len(model.first))
    full = model.growth(asked, 0.0)
    seen = (full > 0) * 1.0
    assert other.learn(4, model, asked, full, seen, 0.3).response == bias.response
    once = BeadBias().learn(2, model, asked, full, seen, 0.3)
    assert once.learn(4, model, asked, full, seen, 0.3).response == bead_bias.RESPONSE


@pytest.mark.parametrize('fill', [0.0, 0.2, 1.0])
def test_an_end_is_asked_for_no_more_than_has_arrived_there(fill):
    model = bead_model(zigzag(), SIZE, W)
    crater = np.where((model.end < 0) & (model.end > -4), 0.9, 0.0)
    deviation = BeadDeviation(crater, fill=fill)
    request = pad(1.5e-3).with_prediction(learned=deviation)
    asked = laws.DampedInverse(1.0).height_request(request)
    assert asked is not None
    need, weight = crater, (crater >= 0) * 1.0
    x = solver.solve(model, need, weight, np.ones(len(model.first)), 0.0, fill=fill)
    at_end = model.to_arc < solver.END_REACH * W
    assert x[at_end].max() <= 1 + fill * (solver.END_HIGH - 1) + 1e-9
    full = solver.solve(model, need, weight, np.ones(len(model.first)), 0.0)
    assert x[at_end].max() < full[at_end].max() or fill == 1.0
