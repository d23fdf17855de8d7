"""The level of a layer, as the figures of its plan tell it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from growth_layers import RES, SHAPE, WIDTH, grid_of, mirrored, origin, request, turned
from net_weights import random_weights

from waam_adapt.beads import plan_geometry, plan_level
from waam_adapt.beads.model import bead_model
from waam_adapt.laws import net, net_file
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.training import plan_level as training
from waam_adapt.training.samples import Sample
from waam_adapt.types import LastLayer

THICKNESS = plan_level.FIGURES.index('thickness')


def channels(height: float = 2e-3) -> np.ndarray:
    r = request()
    r = replace(r, planned=np.where(r.footprint, height, 0.0))
    return plan_geometry.build(r, grid_of(r))


def weights_with_level(tmp_path, per_thickness: float, name: str = 'level.npz'):
    """A network that tells this much per unit of the figure 'thickness', 0 at 2 mm, and nothing by place."""
    weights = {
        k: np.zeros_like(v) for k, v in random_weights(channels=plan_geometry.CHANNELS).items()
    }
    slopes = np.zeros(len(plan_level.FIGURES), np.float32)
    slopes[THICKNESS] = per_thickness
    at = plan_level.figures(channels())[THICKNESS]
    weights |= {plan_level.WEIGHTS: slopes, plan_level.BIAS: np.array([-per_thickness * at], 'f4')}
    path = tmp_path / name
    net_file.save(path, weights, {'seen': {n: [-1e9, 1e9] for n in plan_geometry.SUMMARIES}})
    return path


def test_figures_are_those_of_the_layer_however_it_lies():
    r = request()
    own = plan_level.figures(plan_geometry.build(r, grid_of(r)))
    for other in (turned(r), mirrored(r)):
        assert plan_level.figures(plan_geometry.build(other, grid_of(other))) == pytest.approx(
            own, abs=0.02
        )
    assert np.isfinite(own).all()


def test_a_thin_layer_has_other_figures_than_a_thick_one():
    thin, thick = (plan_level.figures(channels(h)) for h in (1e-3, 2e-3))
    assert thick[THICKNESS] - thin[THICKNESS] == pytest.approx(2.5 * 1e-3 / WIDTH)


def test_the_fit_finds_how_levels_follow_the_figures_and_not_the_wire():
    """Thick layers of all jobs have 6 % less than thin ones, whatever the wire of the job."""
    rng = np.random.default_rng(3)
    layers = []
    for job in range(24):
        wire = rng.uniform(0.8, 1.1)
        for height in rng.uniform(0.8e-3, 2.4e-3, 5):
            level = wire * (1 - 0.06 * (height / 1e-3 - 1.5)) * rng.normal(1, 0.003)
            x = channels(height)
            layers.append(Sample(x, x[0], x[0], np.zeros(1), job, level))
    weights, worth = training.fit(layers)
    assert worth['level_left'] < 0.4 * worth['level_std']
    told = [plan_level.level(channels(h), weights) for h in (1e-3, 2e-3)]
    assert told[0] - told[1] == pytest.approx(math.log(1.03 / 0.97), abs=0.015)


def test_of_too_few_jobs_nothing_is_told():
    x = channels()
    few = [Sample(x, x[0], x[0], np.zeros(1), job, level) for job in range(4) for level in (1, 1.1)]
    unknown = [replace(s, seed=s.seed + 9, level=math.nan) for s in few * 3]
    assert training.fit(few + unknown) == ({}, {})


def test_no_geometry_changes_the_level_by_more_than_is_believed(tmp_path):
    weights = net_file.load(weights_with_level(tmp_path, -30.0), plan_geometry.CHANNELS).weights
    assert plan_level.level(channels(1e-3), weights) == plan_level.MOST
    assert plan_level.level(channels(3e-3), weights) == -plan_level.MOST


def test_weights_of_before_say_nothing_of_the_level():
    assert plan_level.level(channels(), random_weights(channels=plan_geometry.CHANNELS)) == 0.0


@pytest.mark.parametrize('wrong', [{plan_level.WEIGHTS: np.zeros(3, 'f4')}, {}])
def test_a_level_that_does_not_fit_is_refused(tmp_path, wrong):
    weights = random_weights(channels=plan_geometry.CHANNELS)
    weights |= {plan_level.BIAS: np.zeros(1, 'f4'), **wrong}
    net_file.save(tmp_path / 'w.npz', weights, {'seen': {}})
    with pytest.raises(net.ModelError, match='level'):
        net_file.load(tmp_path / 'w.npz', plan_geometry.CHANNELS)


def heights_of(corrector: Corrector, planned: list[float], shares: list[float]) -> list[float]:
    """Mean height over the planned one of layers whose metal arrives in these shares."""
    found, surface, last = [], np.zeros(SHAPE), LastLayer()
    for number, (height, share) in enumerate(zip(planned, shares, strict=True), 1):
        r = request(z=surface, target=surface)
        r = replace(r, planned=np.where(r.footprint, height, 0.0))
        answer = corrector.answer(number, r, origin(number - 1), last)
        c = answer.correction
        asked = height / (1 + c.k_gain * c.psi) + np.nan_to_num(c.residual_height)
        asked = np.where(r.footprint, asked, 0.0)
        model = bead_model(r.paths, grid_of(r).shape, WIDTH)
        relative = model.of_cells(np.where(r.footprint, asked / height, np.nan), RES)
        feed = answer.flow_factor * share
        grown = height * grid_of(r).fine(model.growth(relative, 0.0)) * feed
        last = LastLayer(surface, asked, answer.flow_factor)
        surface = surface + np.where(r.footprint, grown, 0.0)
        found.append(float(grown[r.footprint].mean() / height))
    return found


def test_a_level_that_is_told_is_met_at_once(tmp_path):
    """Layers of 1 mm get 8 % more of their metal than those of 2 mm; the network knows it, or knows nothing."""
    slope = math.log(1.08) / (-2.5 * 1e-3 / WIDTH)
    planned = [2e-3] * 4 + [1e-3] * 2
    shares = [0.9] * 4 + [0.9 * 1.08] * 2
    off = {}
    for name, told in (('knows', slope), ('nothing', 0.0)):
        model = str(weights_with_level(tmp_path, told, f'{name}.npz'))
        corrector = Corrector(CorrectionParams(law='unet', model=model))
        off[name] = abs(heights_of(corrector, planned, shares)[4] - 1)
        assert corrector.identifier.estimate.efficiency_ratio == pytest.approx(0.9, abs=0.04)
    assert off["nothing"] > 0.05
    assert off['knows'] < 0.03
