"""Layers of random parts on random cells for the training of the U-Net."""

import numpy as np
import pytest

from waam_adapt.beads import features
from waam_lab import training_data
from waam_lab.parts import random_build, random_part, random_wall
from waam_lab.plants import training_plant
from waam_lab.results import layer_means, layer_rms
from waam_sim.metal_models import MODELS
from waam_train import samples


def test_random_parts_are_worn_solids_and_come_back_with_their_seed():
    outlines = set()
    for seed in (1, 2016, 2000, 2017, 4, 5):
        part = random_part(np.random.default_rng(seed))
        nominal, worn = part.meshes()
        assert nominal.is_watertight
        assert worn.is_watertight
        assert 1.5 < (part.nominal - part.worn).max() < 12
        assert worn.volume < nominal.volume
        again = random_part(np.random.default_rng(seed))
        assert (again.worn == part.worn).all()
        outlines.add(round(nominal.volume))
    assert len(outlines) == 6


def test_random_walls_are_thin_and_random_builds_begin_at_the_plate():
    rng = np.random.default_rng(3)
    for _ in range(12):
        part = random_wall(rng)
        nominal, worn = part.meshes()
        assert nominal.is_watertight
        assert worn.is_watertight
        sides = (
            nominal.area - 2 * nominal.volume / 24.0
        )  # without top and floor: thickness = 2 V / sides
        assert 2.5 < 2 * nominal.volume / sides < 10.5
        assert (part.nominal - part.worn).min() > 2.0
        part = random_build(rng)
        assert part.worn is None
        assert part.meshes()[0].is_watertight
        assert 7 <= part.nominal.max() <= 14


def test_kinds_come_in_their_shares():
    kinds = [training_data.kind_of(s) for s in range(400)]
    for kind, share in training_data.KINDS.items():
        assert abs(kinds.count(kind) / 400 - share) < 0.07


def test_cells_are_of_every_metal_and_as_rough_as_their_preset():
    rng = np.random.default_rng(5)
    cells = [training_plant(rng, p) for p in ('gentle', 'recorded') for _ in range(30)]
    assert {c.metal.model for c in cells} == set(MODELS)
    gentle, recorded = (
        np.mean([c.metal.area_noise_layer for c in part]) for part in (cells[:30], cells[30:])
    )
    assert recorded > 2 * gentle
    drifts = [c.variation.efficiency_per_layer != 0 for c in cells]
    assert 0.1 < np.mean(drifts) < 0.6


@pytest.mark.parametrize('law', ['bead_solver', 'unet'])
def test_a_job_leaves_its_layers_and_what_the_base_law_missed(law, tmp_path, capsys):
    words = [str(tmp_path), '--seeds', '2004-2004', '--law', law]
    assert training_data.main(words) == 0
    layers = list(samples.load(tmp_path))
    assert '1/1 seed 2004' in capsys.readouterr().err
    assert len(layers) >= 2
    for s in layers:
        assert s.x.shape == (features.CHANNELS, *s.y.shape)
        assert s.weight.max() == 1.0
        assert s.family in MODELS
        known = s.weight > 0.9
        assert 0.03 < s.y[known].std() < 0.5
    assert np.median([abs(np.mean(s.y[s.weight > 0.9])) for s in layers]) < 0.5
    at = (tmp_path / 'job_2004.npz').stat().st_mtime_ns
    assert training_data.main(words) == 0  # is there already
    assert (tmp_path / 'job_2004.npz').stat().st_mtime_ns == at


def test_rms_after_a_layer_counts_what_it_laid_and_is_judged():
    before = {'planned': np.array([[1.0, 1.0, 0.0, 1.0]])}
    after = {
        'z': np.array([[3e-4, -1e-4, 9e-4, 9e-4]]),
        'target': np.zeros((1, 4)),
        'interior': np.array([[True, True, True, False]]),
    }
    assert np.allclose(layer_means([before, after]), 1e-4)
    assert np.allclose(layer_rms([before, after]), np.sqrt(5e-8))
