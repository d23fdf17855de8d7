"""The learned law without torch: file, features, network in numpy, fallbacks, tiles."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from net_weights import card, model, random_weights

from waam_adapt import correct
from waam_adapt.laws import explicit as laws
from waam_adapt.laws import features, net, net_file
from waam_adapt.laws.checks import safe_correct
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.laws.net_law import UNetLaw
from waam_adapt.laws.registry import make_law
from waam_adapt.types import CorrectionInput

SHAPE, RES, WIDTH, H = (80, 120), 0.5e-3, 6e-3, 2e-3


def request(seed=0, shape=SHAPE, **changes) -> CorrectionInput:
    rng = np.random.default_rng(seed)
    inside = np.zeros(shape, bool)
    inside[8:-8, 8:-8] = True
    x, y = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    z = 0.2e-3 * np.sin(x / 11) * np.cos(y / 7) + 2e-5 * rng.standard_normal(shape)
    values = {
        'z': z, 'target': np.zeros(shape), 'planned': np.where(inside, H, 0.0), 'resolution': RES,
        'bead_width': WIDTH, 'k_gain': 0.3, 'sigma': np.full(shape, 2e-5), 'direction': (1.0, 0.0),
    }  # fmt: skip
    return CorrectionInput(**(values | changes))


@pytest.fixture
def law(tmp_path):
    return make_law('unet', model=str(model(tmp_path / 'm.npz')))


@pytest.fixture
def plain():
    return laws.DampedInverse()


def test_answers_of_the_network_name_its_hash_and_differ_from_the_explicit_law(law, plain):
    result = law.correct(request())
    assert not result.fallback
    assert result.law == 'unet'
    assert result.model_hash == law.network.digest
    assert len(result.model_hash) == 64
    difference = np.abs(result.psi - plain.correct(request()).psi)
    assert difference.max() > 0.01
    assert np.abs(result.psi).max() <= 1
    assert (result.confidence <= plain.correct(request()).confidence + 1e-12).all()


def test_network_with_a_zero_head_is_the_explicit_law(tmp_path, plain):
    law = make_law('unet', model=str(model(tmp_path / 'm.npz', head=0.0)))
    result, reference = law.correct(request()), plain.correct(request())
    assert not result.fallback
    assert result.psi == pytest.approx(reference.psi, abs=1e-12)


def test_same_input_same_bits(law):
    one, two = law.correct(request()), law.correct(request())
    for name in ('psi', 'confidence', 'residual_height'):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def damaged(path, how):
    if how == 'missing':
        path.unlink()
    elif how == 'no model':
        path.write_bytes(b'no model at all')
    elif how == 'truncated':
        path.write_bytes(path.read_bytes()[:-500])
    elif how == 'hash':
        w = dict(np.load(path))
        w['head.bias'] = w['head.bias'] + np.float32(1e-3)
        np.savez(path, **w)
    elif how == 'nan':
        model(path, **{'head.bias': np.full(1, np.nan, np.float32)})
    elif how == 'shape':
        model(path, **{'enc2a.weight': np.zeros((8, 3, 3, 3), np.float32)})
    elif how == 'pickle':
        np.savez(path, meta=np.array([{'evil': 1}], dtype=object))


@pytest.mark.parametrize(
    ('how', 'word'),
    [
        ('missing', 'no such model file'), ('no model', 'cannot be read'), ('truncated', 'cannot be read'),
        ('hash', 'hash is'), ('nan', 'head.bias is not a finite'), ('shape', 'enc2a has shape'),
        ('pickle', 'cannot be read'),
    ],
)  # fmt: skip
def test_without_a_sound_model_file_the_explicit_law_answers_and_says_so(
    tmp_path, plain, how, word
):
    path = model(tmp_path / 'm.npz')
    damaged(path, how)
    result = make_law('unet', model=str(path)).correct(request())
    assert result.fallback
    assert word in result.reasons[0]
    assert 'damped_inverse answers' in result.reasons[0]
    assert (result.law, result.model_hash) == ('damped_inverse', '')
    assert (result.psi == plain.correct(request()).psi).all()


@settings(max_examples=60)
@given(st.data())
def test_no_damage_of_the_file_gets_past_the_hash(tmp_path_factory, data):
    path = tmp_path_factory.mktemp('fuzz') / 'm.npz'
    raw = bytearray(model(path).read_bytes())
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


def test_input_unlike_the_training_is_answered_by_the_explicit_law(law, plain):
    seen = json.loads(json.dumps(law.network.card))
    seen['seen']['error'] = [0.0, 0.3]
    narrow = replace(law, network=replace(law.network, card=seen))
    assert not narrow.correct(request()).fallback
    wild = request(z=request().z * 8)
    result = narrow.correct(wild)
    assert result.fallback
    assert 'unlike the training: error' in result.reasons[0]
    assert (result.psi == plain.correct(wild).psi).all()
    assert narrow.network.unlike(features.SUMMARIES, np.full(len(features.SUMMARIES), np.nan))


def test_network_that_doubts_itself_leaves_it_to_the_explicit_law(tmp_path, plain):
    path = model(tmp_path / 'm.npz', **{'doubt.bias': np.full(1, 0.5, np.float32)})
    result = make_law('unet', model=str(path)).correct(request())
    assert result.fallback
    assert 'low confidence' in result.reasons[0]
    assert (result.psi == plain.correct(request()).psi).all()


def test_a_network_that_gives_nan_is_caught(law):
    weights = {k: v.copy() for k, v in law.network.weights.items()}
    weights['head.bias'][:] = np.nan
    broken = replace(law, network=replace(law.network, weights=weights))
    result = safe_correct(broken, request(), ())
    assert result.fallback
    assert 'not finite' in result.reasons[0]
    assert (result.psi == laws.DampedInverse().correct(request()).psi).all()


def test_tiles_join_without_a_seam():
    network = net.Network(random_weights(head=0.5), card(), '')
    x = np.random.default_rng(3).normal(0, 1, (features.CHANNELS, 230, 150)).astype(np.float32)
    tiled, _ = network(x)
    whole = network._tile(np.pad(x, ((0, 0), (0, 2), (0, 2))))[0][:230, :150]
    assert np.abs(tiled - whole).max() < 1e-5 * np.abs(whole).max()


def test_a_map_of_a_million_cells_is_answered_as_a_part_of_it_is(law):
    """1024 x 1024 cells with their beads: several tiles; the part is seen in one."""
    size, part = 1024, 480
    inside = np.zeros((size, size), bool)
    inside[8:-8, 8:-8] = True
    y = np.arange(8 * RES + 2.2e-3, (size - 8) * RES, 4.4e-3)
    beads = tuple(np.array([[8 * RES, v], [(size - 8) * RES, v]]) for v in y)
    whole = request(shape=(size, size), planned=np.where(inside, H, 0.0), paths=beads)
    maps = {k: getattr(whole, k)[:part, :part] for k in ('z', 'target', 'planned', 'sigma')}
    near = tuple(np.clip(b, None, part * RES) for b in beads if b[0, 1] < part * RES)
    answers = [law.correct(r) for r in (whole, replace(whole, paths=near, **maps))]
    assert not any(a.fallback for a in answers)
    a, b = (a.speed_factor[: part - 80, : part - 80] for a in answers)
    assert np.abs(a - b).max() < 0.01
    assert np.ptp(a) > 0.1


def test_same_answer_on_a_finer_map_and_for_beads_of_another_size(law):
    """Units of bead and layer: half the cell, or all lengths doubled, must not change psi."""
    coarse = request()
    fine = replace(
        coarse, resolution=RES / 2,
        **{k: np.repeat(np.repeat(getattr(coarse, k), 2, 0), 2, 1) for k in ('z', 'target', 'planned', 'sigma')},
    )  # fmt: skip
    a, b = (features.build(r, np.zeros(r.z.shape)).x for r in (coarse, fine))
    assert np.abs(a - b)[:-1].max() < 1e-5
    larger = replace(
        coarse, z=2 * coarse.z, planned=2 * coarse.planned, sigma=2 * coarse.sigma,
        resolution=2 * RES, bead_width=2 * WIDTH,
    )  # fmt: skip
    assert features.build(larger, np.zeros(SHAPE)).x == pytest.approx(a, abs=1e-6)


def test_starts_and_ends_of_paths_are_marked_where_they_are(law):
    bead = np.array([[6.2e-3, 21.3e-3], [51.3e-3, 21.3e-3]])
    seen = features.build(request(paths=(bead,)), np.zeros(SHAPE))
    cell = WIDTH / features.CELLS_PER_BEAD
    for name, (x, y) in (('starts', bead[0]), ('ends', bead[1])):
        peak = np.unravel_index(seen.channel(name).argmax(), seen.x.shape[1:])
        assert peak == (round(y / cell - 0.5), round(x / cell - 0.5))
    assert seen.channel('paths').all()
    assert not features.build(request(), np.zeros(SHAPE)).channel('paths').any()


def test_means_over_coarse_cells_keep_the_sum_and_come_back():
    values = np.random.default_rng(0).normal(size=(33, 46))
    r = features.Resampler.of(values.shape, 1.0, 1.0)
    assert r.fine(r.mean(values)) == pytest.approx(values)
    r = features.Resampler.of((40, 60), 0.5, 1.25)
    assert r.shape == (16, 24)
    y, x = np.mgrid[:40, :60]
    plane = 0.3 * x - 0.1 * y
    assert r.fine(r.mean(plane))[2:-2, 2:-2] == pytest.approx(plane[2:-2, 2:-2], abs=0.02)
    assert r.mean(plane).mean() == pytest.approx(plane.mean())


def test_packaged_model_is_sound_small_and_what_the_server_runs():
    law = Corrector(CorrectionParams(law='unet')).law
    assert isinstance(law, UNetLaw)
    assert not law.broken
    assert net_file.PACKAGED.stat().st_size < 5e6
    told = net_file.PACKAGED.with_suffix('.md').read_text()
    assert law.network.digest in told
    assert not law.correct(request()).fallback


def test_api_runs_the_network_and_passes_the_paths(tmp_path, monkeypatch):
    path = str(model(tmp_path / 'm.npz', head=0.5))
    bead = np.stack([np.linspace(6, 54, 30), np.full(30, 21.0)], axis=1)
    error = 0.2 * np.sin(np.arange(120) / 11)[None, :] * np.ones((80, 1))
    ours = correct(error, 0.5, [bead], 2.0, law='unet', model=path)[0]
    plain = correct(error, 0.5, [bead], 2.0)[0]
    assert ours.shape == plain.shape == (30,)
    assert np.abs(ours - plain).max() > 1e-3
    seen = []
    build = features.build
    monkeypatch.setattr(features, 'build', lambda r, e: seen.append(r) or build(r, e))
    correct(error, 0.5, [bead], 2.0, law='unet', model=path, origin_mm=(-10.0, 5.0))
    assert seen[0].paths[0][0] == pytest.approx([16e-3, 16e-3])
