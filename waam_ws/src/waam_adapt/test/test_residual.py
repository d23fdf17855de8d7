"""What the loop leaves of a surface, told before a layer is laid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from growth_layers import SHAPE, H, grid_of, layer_sample, mirrored, origin, request, turned
from net_weights import random_weights
from scipy.ndimage import gaussian_filter

from waam_adapt.beads import plan_geometry, residual
from waam_adapt.cli import register
from waam_adapt.laws import net, net_file
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.laws.registry import make_law
from waam_adapt.training import residual as training
from waam_adapt.training import samples
from waam_adapt.training.samples import Sample
from waam_adapt.types import LastLayer, Predicted

LONG = 3  # of the bands: waves of about two to four beads


def rough(seed: int = 1, height: float = H, **changes):
    """A layer on an uneven surface."""
    noise = gaussian_filter(np.random.default_rng(seed).standard_normal(SHAPE), 8)
    r = request(z=0.15 * height * noise / noise.std(), **changes)
    return replace(r, planned=np.where(r.footprint, height, 0.0))


def surface(r, growth=None):
    grid = grid_of(r)
    x = plan_geometry.build(r, grid)
    return residual.surface(r, grid, x, np.zeros(grid.shape) if growth is None else growth)


def leaving(share: float) -> np.ndarray:
    """Weights that say: this share of the error's long waves stays."""
    weights = np.zeros(residual.FIGURES, np.float32)
    weights[LONG] = -share
    return weights


def growth_weights(left: np.ndarray | None = None) -> dict[str, np.ndarray]:
    weights = random_weights(channels=plan_geometry.CHANNELS, head=0.02)
    return weights if left is None else {**weights, residual.WEIGHTS: left}


def network(path, left: np.ndarray | None = None):
    seen = {n: [-1e9, 1e9] for n in plan_geometry.SUMMARIES}
    card = {
        'seen': seen, 'name': 'n', 'purpose': 'p', 'parameters': 1, 'training': {'steps': 1, 'batch': 1, 'seed': 1},
        'data': {'layers': 1, 'jobs': 1, 'seeds': [1, 1]},
        'metrics': {'explained': 0.1, 'explained_raw': 0.1, 'sigma_ratio': 1.0},
    }  # fmt: skip
    net_file.save(path, growth_weights(left), card)
    return path


def laid(seed: int, share: float) -> Sample:
    """A layer that has left this share of the long waves that it found, and noise."""
    r = rough(seed, height=(1e-3, 2e-3)[seed % 2])
    s = surface(r)
    left = -share * residual.figures(s)[LONG]
    left = left + 0.02 * np.random.default_rng(seed).standard_normal(left.shape)
    moments = residual.moments(s, left)
    assert moments is not None
    return replace(layer_sample(seed), seed=seed, moments=moments)


def test_bands_of_a_surface_add_up_to_it():
    s = surface(rough())
    known = s.counted > 0
    bands = residual.figures(s)[: len(residual.SCALES) + 1].sum(axis=0)
    error, _ = residual.known_mean(rough().error / H, grid_of(rough()))
    assert known.sum() > 100
    assert bands[known] == pytest.approx(error[known], abs=1e-6)


def test_what_is_told_turns_with_the_part():
    rng = np.random.default_rng(2)
    weights = {residual.WEIGHTS: 0.05 * rng.standard_normal(residual.FIGURES)}
    r = rough()
    own = residual.told(surface(r), weights)
    assert np.abs(own).max() > 0.01
    for other, back in (
        (replace(turned(r), z=r.z.T.copy()), np.transpose),
        (replace(mirrored(r), z=r.z[:, ::-1].copy()), np.fliplr),
    ):
        seen = back(residual.told(surface(other), weights))
        # where two passes are equally near, either may be the nearest
        assert (np.abs(seen - own) > 0.02 * np.abs(own).max()).mean() < 0.1


def test_it_is_the_regression_of_its_figures():
    s = surface(rough(), growth=0.1 * surface(rough()).x[3])
    weights = 0.02 * np.random.default_rng(3).standard_normal(residual.FIGURES)
    figures = residual.figures(s)
    assert len(figures) == residual.FIGURES
    known = (s.counted > 0).astype(float)
    sums = [
        gaussian_filter(v * known, residual.TOLD, truncate=3.0)
        for v in (np.tensordot(weights, figures, 1), 1.0)
    ]
    plain = sums[0] / np.maximum(sums[1], 1e-3)
    plain = plain - (plain * s.counted).sum() / s.counted.sum()
    told = residual.told(s, {residual.WEIGHTS: weights})
    assert told == pytest.approx(plain * s.counted, abs=1e-6)
    assert (told[s.counted == 0] == 0).all()


def test_cells_that_were_never_seen_and_wild_weights_do_no_harm():
    r = rough()
    z = r.z.copy()
    z[20:50, 30:60] = np.nan
    told = residual.told(surface(replace(r, z=z)), {residual.WEIGHTS: leaving(1e6)})
    assert np.isfinite(told).all()
    assert np.abs(told).max() == pytest.approx(residual.MOST)


def test_the_fit_finds_what_the_loop_leaves():
    weights, worth = training.fit([laid(seed, 0.6) for seed in range(12)])
    assert worth['explained'] > 0.7
    assert worth['jobs'] == 12
    s = surface(rough(99))
    told, true = residual.told(s, {residual.WEIGHTS: weights}), -0.6 * residual.figures(s)[LONG]
    known = s.counted > 0.9
    assert np.corrcoef(told[known], true[known])[0, 1] > 0.9
    assert told[known].std() == pytest.approx(true[known].std(), rel=0.25)


def test_noise_teaches_nothing():
    _, worth = training.fit([laid(seed, 0.0) for seed in range(12)])
    assert worth['explained'] < 0.05


def test_less_is_laid_where_the_loop_would_end_too_high(tmp_path):
    plain = make_law('unet', model=str(network(tmp_path / 'a.npz')))
    # hollows are filled too little, hills taken away too little
    telling = make_law('unet', model=str(network(tmp_path / 'b.npz', leaving(0.5))))
    r = rough()
    hill = gaussian_filter(r.z, 6)
    inside = np.zeros(SHAPE, bool)
    inside[30:-30, 30:-34] = True
    speeds = [law.correct(r).speed_factor for law in (plain, telling)]
    change = speeds[1] - speeds[0]
    assert np.corrcoef(change[inside], hill[inside])[0, 1] > 0.5


def test_a_network_without_its_say_leaves_nothing_either():
    p = Predicted(np.ones((2, 2)), np.ones((2, 2)), 'x', left=np.full((2, 2), 0.1))
    assert (p.weighed(0.0).left == 0).all()
    assert (p.weighed(0.5).left == 0.05).all()


def test_nothing_is_told_of_programs_of_others(tmp_path):
    law = make_law('unet', model=str(network(tmp_path / 'n.npz', leaving(0.8))))
    told, other = (law.predict(rough(ratio_high=high)) for high in (0.0, 1.8))
    assert np.abs(told.left).max() > 0.01
    assert np.abs(other.left).max() == 0
    assert (told.growth == other.growth).all()


def test_weights_of_before_leave_nothing(tmp_path):
    assert (residual.told(surface(rough()), growth_weights()) == 0).all()


def test_a_regression_of_other_figures_is_refused(tmp_path):
    file = network(tmp_path / 'w.npz', np.zeros(7, np.float32))
    with pytest.raises(net.ModelError, match=r'residual\.weight has shape \(7,\)'):
        net_file.load(file, plan_geometry.CHANNELS)


def test_a_sample_knows_what_was_left_of_it(tmp_path):
    r = rough()
    grid = grid_of(r)
    predicted = Predicted(np.zeros(grid.shape), np.ones(grid.shape), 'hash')
    after = np.where(r.footprint, 0.4 * gaussian_filter(r.z, 3) + H, 0.0)
    found = samples.sample(r, np.where(r.footprint, H, 0.0), after, 0.0, 7, predicted=predicted)
    assert found is not None
    assert found.moments is not None
    bands = slice(0, len(residual.SCALES) + 1)  # together the error that it found
    square, product = found.moments[bands, bands].sum(), found.moments[bands, -1].sum()
    assert product / square == pytest.approx(-0.4, abs=0.1)
    samples.save(tmp_path, 7, [found, layer_sample(7)])
    back = list(samples.load(tmp_path))
    assert (back[0].moments == found.moments).all()
    assert back[1].moments is None


def believed(tmp_path, leaves) -> list[float]:
    """Weights of what is told, before each of six layers; leaves: of what the layer ends too high, by what was told and
    the weight that it was told with."""
    model = str(network(tmp_path / 'net.npz', leaving(3.0)))
    corrector = Corrector(CorrectionParams(law='unet', model=model))
    z, last, found = rough(1).z, LastLayer(), []
    for number in range(1, 7):
        r = request(z=z, target=np.full(SHAPE, (number - 1) * H))
        corrector.answer(number, r, origin(number - 1), last)
        found.append(corrector.identifier.left_skill.weight)
        told = grid_of(r).fine(corrector.law.predict(r).left)
        error = H * leaves(told, found[-1]) + rough(number + 1).z
        last = LastLayer(z, np.where(r.footprint, H, 0.0))
        z = np.where(r.footprint, number * H + error, z)
    return found


def test_what_is_told_and_true_is_believed(tmp_path):
    weights = believed(tmp_path, lambda told, weight: (1 - weight) * told)
    assert weights[-1] > 0.8


def test_what_is_told_and_not_there_is_believed_less_and_less(tmp_path):
    weights = believed(tmp_path, lambda told, weight: -weight * told)
    assert weights[0] > 0.8
    assert weights[-1] < 0.5


def command(*words: str) -> int:
    import argparse

    p = argparse.ArgumentParser()
    register(p.add_subparsers())
    args = p.parse_args(['train', *words])
    return int(args.run_command(args))


def test_the_command_adds_round_upon_round(tmp_path, capsys):
    start, out = network(tmp_path / 'start.npz'), tmp_path / 'out'
    for seed in range(8):
        samples.save(tmp_path / 'laid', seed, [laid(seed, 0.5)])
    words = (str(tmp_path / 'laid'), '--residual', '--out', str(out))
    assert command(*words, '--start', str(start)) == 0
    once = net_file.load(out / 'unet.npz', plan_geometry.CHANNELS)
    assert 'of what the loop leaves' in capsys.readouterr().out
    assert once.weights[residual.WEIGHTS][LONG] < -0.1
    assert (once.weights['head.weight'] == growth_weights()['head.weight']).all()
    assert command(*words, '--start', str(out / 'unet.npz')) == 0
    twice = net_file.load(out / 'unet.npz', plan_geometry.CHANNELS)
    assert twice.weights[residual.WEIGHTS] == pytest.approx(
        2 * once.weights[residual.WEIGHTS], rel=1e-3
    )
    assert len(twice.card['residual']) == 2
    assert (out / 'unet.md').read_text().count('of jobs left out') == 2


def test_layers_that_were_laid_without_a_network_are_refused(tmp_path, capsys):
    samples.save(tmp_path / 'layers', 1, [layer_sample(1)])
    start = str(network(tmp_path / 'start.npz'))
    assert command(str(tmp_path / 'layers'), '--residual', '--start', start, '--out', 'x') == 1
    assert '--law unet' in capsys.readouterr().err
