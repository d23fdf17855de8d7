"""What is kept of a layer to learn from."""

from __future__ import annotations

import numpy as np
import pytest
from layers_to_learn import SHAPE, grid_of, laid, layer_sample, request

from waam_adapt.types import Forecast
from waam_train import samples


def test_a_sample_is_what_the_base_law_would_have_left():
    r = request()
    zero = np.zeros(grid_of(r).shape)
    forecast = Forecast(zero + 0.05, zero, zero, 0.02, 'abc')
    plain = samples.sample(r, r, laid(r, np.full(grid_of(r).shape, 0.1)), 1)
    with_it = samples.sample(
        r, r.with_prediction(forecast), laid(r, np.full(grid_of(r).shape, 0.03)), 1
    )
    known = plain.weight > 0.9
    assert plain.y[known] == pytest.approx(0.1, abs=1e-6)
    assert with_it.y[known] == pytest.approx(0.1, abs=1e-6)
    nothing_seen = np.full(SHAPE, np.nan)
    assert samples.sample(r, r, nothing_seen, 1) is None


def test_samples_come_back_from_their_files(tmp_path):
    with pytest.raises(ValueError, match='no job_'):
        list(samples.load(tmp_path))
    layers = [layer_sample(4), layer_sample(5)]
    samples.save(tmp_path, 4, layers)
    for a, b in zip(layers, samples.load(tmp_path), strict=True):
        assert np.abs(a.x - b.x).max() < 2e-3  # kept in half precision
        assert (a.y == b.y).all()
        assert (a.weight == b.weight).all()
        assert (b.seed, b.family) == (4, layers[0].family)
