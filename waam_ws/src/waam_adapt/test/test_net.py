"""The network without torch: its file, tiles, and the law that answers when it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from net_weights import random_weights
from unet_layers import request, weights_file

from waam_adapt import correct
from waam_adapt.beads import features, plan_geometry
from waam_adapt.grids import Resampler
from waam_adapt.laws import net, net_file
from waam_adapt.laws.checks import safe_correct
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.laws.registry import make_law
from waam_adapt.laws.unet_law import UNetLaw
from waam_adapt.types import CorrectionInput

RES, WIDTH, H = 0.5e-3, 6e-3, 2e-3


@pytest.fixture
def law(tmp_path):
    return make_law('unet', model=str(weights_file(tmp_path / 'm.npz')))


def test_answers_of_the_network_name_its_hash_and_differ_from_the_bead_solver(law):
    result, plain = law.correct(request()), make_law('bead_solver').correct(request())
    assert (result.law, result.fallback) == ('unet', False)
    assert result.model_hash == law.network.digest
    assert len(result.model_hash) == 64
    assert np.abs(result.psi - plain.psi).max() > 0.01
    assert np.abs(result.psi).max() <= 1
    assert (result.confidence <= plain.confidence + 1e-12).all()
    assert result.confidence.max() < plain.confidence.max()


def test_without_a_network_it_is_the_bead_solver():
    bare, plain = (make_law(n, model='none').correct(request()) for n in ('unet', 'bead_solver'))
    assert (bare.fallback, bare.model_hash) == (False, '')
    assert (bare.psi == plain.psi).all()


def test_same_input_same_bits(law):
    one, two = law.correct(request()), law.correct(request())
    for name in ('psi', 'confidence', 'residual_height'):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def damaged(path, how):
    w = dict(np.load(path))
    if how == 'missing':
        path.unlink()
    elif how == 'no model':
        path.write_bytes(b'no model at all')
    elif how == 'truncated':
        path.write_bytes(path.read_bytes()[:-500])
    elif how == 'hash':
        np.savez(path, **{**w, 'head.bias': w['head.bias'] + np.float32(1e-3)})
    elif how in ('nan', 'shape'):
        other = {
            'nan': {'head.bias': np.full(1, np.nan, np.float32)},
            'shape': {'enc2a.weight': np.zeros((8, 3, 3, 3), np.float32)},
        }
        del w['meta']
        net_file.save(path, w | other[how], {'seen': {}, 'weights': {}})
    elif how == 'unlike':
        weights_file(path, low=50.0, high=60.0)
    elif how == 'pickle':
        np.savez(path, meta=np.array([{'evil': 1}], dtype=object))


@pytest.mark.parametrize(
    ('how', 'word'),
    [
        ('missing', 'no such model file'), ('no model', 'cannot be read'), ('truncated', 'cannot be read'),
        ('hash', 'hash is'), ('nan', 'head.bias is not a finite'), ('shape', 'enc2a has shape'),
        ('pickle', 'cannot be read'), ('unlike', 'unlike'),
    ],
)  # fmt: skip
def test_without_a_sound_model_file_the_bead_solver_answers_and_says_so(tmp_path, how, word):
    path = weights_file(tmp_path / 'm.npz')
    damaged(path, how)
    result = make_law('unet', model=str(path)).correct(request())
    assert result.fallback
    assert word in result.reasons[0]
    assert 'the bead solver answers without the network' in result.reasons[0]
    assert result.model_hash == ''
    assert (result.psi == make_law('bead_solver').correct(request()).psi).all()


@settings(max_examples=60)
@given(st.data())
def test_no_damage_of_the_file_gets_past_the_hash(tmp_path_factory, data):
    path = tmp_path_factory.mktemp('fuzz') / 'm.npz'
    raw = bytearray(weights_file(path).read_bytes())
    reference = net_file.load(path)
    at = data.draw(st.integers(0, len(raw) - 1))
    raw[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(bytes(raw[: data.draw(st.sampled_from([len(raw), at + 1]))]))
    try:
        loaded = net_file.load(path)
    except net.ModelError:
        return
    # a byte that carries nothing (time stamps of the archive)
    assert loaded.digest == reference.digest
    assert all((loaded.weights[k] == v).all() for k, v in reference.weights.items())


def test_a_network_that_gives_nan_is_caught(law):
    weights = {k: v.copy() for k, v in law.network.weights.items()}
    weights['head.bias'][:] = np.nan
    broken = replace(law, network=replace(law.network, weights=weights))
    result = safe_correct(broken, request(), ())
    assert result.fallback
    assert 'not finite' in result.reasons[0]


def test_tiles_join_without_a_seam():
    network = net.Network(random_weights(head=0.5), {}, '')
    x = np.random.default_rng(3).normal(0, 1, (features.CHANNELS, 230, 150)).astype(np.float32)
    tiled, _ = network(x)
    whole = network._tile(np.pad(x, ((0, 0), (0, 2), (0, 2))))[0][:230, :150]
    assert np.abs(tiled - whole).max() < 1e-5 * np.abs(whole).max()


def test_a_map_of_a_million_cells_is_answered_as_a_part_of_it_is(law):
    """1024 x 1024 cells with their beads: several tiles; the part is seen in one."""
    size, part = 1024, 480
    inside = np.zeros((size, size), bool)
    inside[8:-8, 8:-8] = True
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    z = 0.2e-3 * np.sin(x / 11) * np.cos(y / 7)
    rows = np.arange(8 * RES + 2.2e-3, (size - 8) * RES, 4.4e-3)
    beads = tuple(np.array([[8 * RES, v], [(size - 8) * RES, v]]) for v in rows)
    whole = CorrectionInput(
        z, np.zeros_like(z), np.where(inside, H, 0.0), RES, WIDTH, 0.3, np.full(z.shape, 2e-5), paths=beads,
    )  # fmt: skip
    maps = {k: getattr(whole, k)[:part, :part] for k in ('z', 'target', 'planned', 'sigma')}
    near = tuple(np.clip(b, None, part * RES) for b in beads if b[0, 1] < part * RES)
    answers = [law.correct(r) for r in (whole, replace(whole, paths=near, **maps))]
    assert not any(a.fallback for a in answers)
    a, b = (a.speed_factor[: part - 80, : part - 80] for a in answers)
    # the mean of all that is predicted is taken off, and the part has another one
    assert np.abs((a - b) - np.median(a - b)).max() < 0.02
    assert np.ptp(a) > 0.1


def test_means_over_coarse_cells_keep_the_sum_and_come_back():
    values = np.random.default_rng(0).normal(size=(33, 46))
    r = Resampler.of(values.shape, 1.0, 1.0)
    assert r.fine(r.mean(values)) == pytest.approx(values)
    r = Resampler.of((40, 60), 0.5, 1.25)
    assert r.shape == (16, 24)
    y, x = np.mgrid[:40, :60]
    plane = 0.3 * x - 0.1 * y
    assert r.fine(r.mean(plane))[2:-2, 2:-2] == pytest.approx(plane[2:-2, 2:-2], abs=0.02)
    assert r.mean(plane).mean() == pytest.approx(plane.mean())


def test_packaged_model_is_sound_small_and_what_the_server_runs():
    law = Corrector(CorrectionParams()).law
    assert isinstance(law, UNetLaw)
    assert not law.broken
    assert net_file.PACKAGED.stat().st_size < 2e6
    told = net_file.PACKAGED.with_suffix('.md').read_text()
    assert law.network.digest in told
    assert not law.correct(request()).fallback


def test_api_runs_the_network_and_passes_the_paths(tmp_path, monkeypatch):
    path = str(weights_file(tmp_path / 'm.npz'))
    bead = np.stack([np.linspace(6, 54, 30), np.full(30, 21.0)], axis=1)
    error = 0.2 * np.sin(np.arange(120) / 11)[None, :] * np.ones((80, 1))
    ours = correct(error, 0.5, [bead], 2.0, law='unet', model=path)[0]
    plain = correct(error, 0.5, [bead], 2.0)[0]
    assert ours.shape == plain.shape == (30,)
    assert np.abs(ours - plain).max() > 1e-3
    seen = []
    build = plan_geometry.build
    monkeypatch.setattr(plan_geometry, 'build', lambda r, g: seen.append(r) or build(r, g))
    correct(error, 0.5, [bead], 2.0, law='unet', model=path, origin_mm=(-10.0, 5.0))
    assert seen[0].paths[0][0] == pytest.approx([16e-3, 16e-3])
