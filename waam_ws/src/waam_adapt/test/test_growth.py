"""The growth network: what it sees, what its law does with it, what it is trained on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from growth_layers import (
    RES,
    SHAPE,
    WIDTH,
    H,
    grid_of,
    layer_sample,
    mirrored,
    origin,
    request,
    turned,
    weights_file,
    zigzag,
)
from net_weights import random_weights

from waam_adapt.beads import bead_path, model, plan_geometry
from waam_adapt.beads.bead_path import beads_of, nearest_of
from waam_adapt.beads.model import SPREAD, bead_model
from waam_adapt.grids import CELLS_PER_BEAD
from waam_adapt.laws import net_file, unet_law
from waam_adapt.laws.checks import MapOrigin
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.laws.registry import make_law
from waam_adapt.laws.unet_law import UNetLaw
from waam_adapt.training import samples
from waam_adapt.types import LastLayer, Predicted


@pytest.fixture
def law(tmp_path):
    return make_law('unet', model=str(weights_file(tmp_path / 'g.npz')))


def test_channels_keep_their_values_when_the_part_is_turned_or_mirrored():
    r = request()
    x = plan_geometry.build(r, grid_of(r))
    assert np.ptp(x[plan_geometry.NAMES.index('turn across')]) > 0.1
    for other, back in (
        (turned(r), lambda a: np.swapaxes(a, 1, 2)),
        (mirrored(r), lambda a: a[:, :, ::-1]),
    ):
        seen = back(plan_geometry.build(other, grid_of(other)))
        different = np.abs(seen - x).max(axis=(1, 2)) > 1e-5
        # where two passes are equally near, either may be the nearest
        shares = (np.abs(seen - x) > 1e-3).mean(axis=(1, 2))
        assert shares.max() < 0.05, [plan_geometry.NAMES[i] for i in np.flatnonzero(different)]


def test_channels_know_nothing_of_the_surface():
    r = request()
    rough = replace(r, z=1e-3 * np.random.default_rng(1).standard_normal(SHAPE))
    assert (plan_geometry.build(rough, grid_of(r)) == plan_geometry.build(r, grid_of(r))).all()


def test_passes_before_and_after_change_places_when_the_layer_is_laid_backwards():
    r = request()
    back = replace(r, paths=(zigzag()[::-1].copy(),))
    one, two = (plan_geometry.build(v, grid_of(v)) for v in (r, back))
    before, after = (plan_geometry.NAMES.index(n) for n in ('before', 'after'))
    middle = np.s_[12:20, 9:15]
    assert one[before][middle].mean() > 0.3
    assert np.abs(one[before] - two[after])[middle].max() < 1e-4


def test_sums_over_the_passes_are_those_of_their_definition():
    r, shape, cell = request(), (32, 32), WIDTH / CELLS_PER_BEAD
    # the second bead leaves the grid
    paths = tuple(p.tobytes() for p in (*r.paths, r.paths[0][:4] - 12e-3))
    pieces = plan_geometry._pieces(beads_of(paths, WIDTH), WIDTH)
    nearest, near = nearest_of(paths, shape, WIDTH)
    sums = plan_geometry._sums(pieces, nearest, WIDTH)
    for row, column in ((3, 3), (12, 9), (20, 18), (31, 0)):
        place = (np.array([column, row]) + 0.5) * cell
        far = np.hypot(*(pieces.where - place).T) / WIDTH
        assert near[row, column] / WIDTH == pytest.approx(far.min())
        later = (pieces.run - pieces.run[nearest[row, column]]) / WIDTH
        counts = far < plan_geometry.REACH
        beside = pieces.step * np.exp(-0.5 * (far / plan_geometry.NEIGHBOUR) ** 2)
        beside[~counts | (np.abs(later) <= plan_geometry.APART)] = 0.0
        wanted = (
            (pieces.step * np.exp(-0.5 * (far / SPREAD) ** 2))[counts].sum(),
            beside[later < 0].sum(),
            beside[later > 0].sum(),
            (beside * np.exp(-np.abs(later) / plan_geometry.FRESH)).sum(),
        )
        assert sums[:, row, column] == pytest.approx(wanted, rel=1e-9, abs=1e-15)


def test_answer_names_the_network_and_differs_from_the_bead_solver(law):
    result, plain = law.correct(request()), make_law('bead_solver').correct(request())
    assert not result.fallback
    assert (result.law, result.model_hash) == ('unet', law.network.digest)
    assert np.abs(result.psi - plain.psi).max() > 0.05
    assert (result.confidence <= plain.confidence + 1e-12).all()
    assert result.confidence.max() < plain.confidence.max()


def test_no_more_is_predicted_than_setpoints_can_make_least_of_all_in_thin_walls(tmp_path):
    law = make_law('unet', model=str(weights_file(tmp_path / 'g.npz', scale=30.0)))
    wide = request()
    thin = request(planned=np.where(np.arange(96)[:, None] // 11 == 4, wide.planned, 0.0))  # 5.5 mm
    told, in_wall = law.predict(wide).growth, law.predict(thin).growth
    assert (told.min(), told.max()) == pytest.approx((-0.15, 0.4))
    assert np.abs(in_wall).max() == pytest.approx(0.05)


def test_same_input_same_bits(law):
    one, two = law.correct(request()), law.correct(request())
    assert one.psi.tobytes() == two.psi.tobytes()
    assert one.residual_height.tobytes() == two.residual_height.tobytes()


def test_a_prepared_layer_is_answered_alike_without_computing_its_geometry_again(tmp_path):
    """What an announcement prepares: everything that the surface has no part in."""
    kept = plan_geometry._ways, bead_path.nearest_of, model._cached
    params = CorrectionParams(model=str(weights_file(tmp_path / 'g.npz')))
    origin = MapOrigin(0.0, 'job', 'job', 1, 1, plausible=True)
    rough = np.random.default_rng(1).normal(0, 1e-4, SHAPE)
    asked = request((zigzag() + (1e-5, 0),), z=rough)

    def computed() -> list[int]:
        return [f.cache_info().misses for f in kept]

    before = computed()
    plain = Corrector(params).answer(2, asked, origin, LastLayer()).correction
    assert [b - a for a, b in zip(before, computed(), strict=True)] == [1, 1, 1]
    for f in kept:
        f.cache_clear()
    corrector = Corrector(params)
    corrector.prepare(replace(asked, z=np.zeros(SHAPE), temperature=np.nan))
    before = computed()
    prepared = corrector.answer(2, asked, origin, LastLayer()).correction
    assert computed() == before
    assert not plain.fallback and plain.psi.any()
    assert prepared.psi.tobytes() == plain.psi.tobytes()


def test_the_network_is_asked_before_the_layer_has_cooled(tmp_path):
    """About as warm as the one before: the answer to the announced layer serves; much warmer: it is asked again."""
    corrector = Corrector(CorrectionParams(model=str(weights_file(tmp_path / 'g.npz'))))
    origin = MapOrigin(0.0, 'job', 'job', 1, 1, plausible=True)
    asked = request((zigzag() + (2e-5, 0),), temperature=150.0)
    corrector.answer(1, request(temperature=150.0), origin, LastLayer())
    corrector.prepare(replace(asked, z=np.zeros(SHAPE), temperature=np.nan))
    for temperature, more in ((165.0, 0), (128.0, 0), (300.0, 1)):
        before = unet_law._answer.cache_info().misses
        warm = replace(asked, temperature=temperature)
        found = corrector.answer(2, warm, origin, LastLayer()).correction
        assert not found.fallback
        assert unet_law._answer.cache_info().misses == before + more


def test_less_is_laid_where_more_will_grow():
    r, law = request(), UNetLaw.load('none', make_law('damped_inverse'))
    growth = np.zeros(grid_of(r).shape)
    growth[14:18, 10:14] = 0.3
    told = replace(r, predicted=Predicted(growth, np.zeros_like(growth), 'abc'))
    hump, plain = law.correct(told), law.correct(r)
    place = np.s_[42:54, 30:42]
    assert (hump.psi - plain.psi)[place].mean() > 0.2  # faster: thinner
    assert hump.model_hash == 'abc'


@pytest.mark.parametrize(
    ('how', 'word'), [('missing', 'no such model'), ('unlike', 'unlike'), ('nan', 'finite')]
)
def test_without_the_network_the_bead_solver_answers_and_says_so(tmp_path, how, word):
    path = tmp_path / 'g.npz'
    if how == 'unlike':
        weights_file(path, low=50.0, high=60.0)
    elif how == 'nan':
        weights_file(path, scale=1e38)
    law = make_law('unet', model=str(path))
    with np.errstate(all='ignore'):
        result = law.correct(request())
    assert result.fallback
    assert word in result.reasons[0]
    assert (result.psi == make_law('bead_solver').correct(request()).psi).all()
    assert result.model_hash == ''


def test_weights_of_the_other_network_are_refused(tmp_path):
    path = tmp_path / 'other.npz'
    net_file.save(path, random_weights(channels=15), {'seen': {}})
    result = make_law('unet', model=str(path)).correct(request())
    assert result.fallback
    assert 'shape' in result.reasons[0]


def test_what_was_predicted_is_not_learned_again(tmp_path):
    """A layer grows exactly as predicted: nothing is left to learn beside the forecast, and much beside the model."""
    missing = {}
    for name in ('unet', 'bead_solver'):
        model = str(weights_file(tmp_path / 'g.npz')) if name == 'unet' else ''
        corrector = Corrector(CorrectionParams(law=name, model=model))
        first = request()
        answer = corrector.answer(1, first, origin(0), LastLayer())
        predicted = make_law('unet', model=str(tmp_path / 'g.npz')).predict(first).growth
        c, grid = answer.correction, grid_of(first)
        asked = np.where(first.footprint, H / (1 + c.k_gain * c.psi) + c.residual_height, 0.0)
        model_ = bead_model(first.paths, grid.shape, WIDTH)
        expected = model_.growth(
            model_.of_cells(np.where(first.footprint, asked / H, np.nan), RES), 0.0
        )
        grown = first.z + np.where(first.footprint, H * grid.fine(expected + predicted), 0.0)
        second = request(z=grown, target=grown)
        corrector.answer(2, second, origin(1), LastLayer(first.z, asked))
        who = corrector.identifier
        learned = (who.beads_told if name == 'unet' else who.beads).missing[1]
        missing[name] = float(np.sqrt(np.mean(learned**2)))
    assert missing['unet'] < 0.5 * missing['bead_solver']


def lay(corrector: Corrector, layers: int, grows, job: str = 'job', times: int = 1):
    """Lays flat layers one over the other; grows(expected, predicted): relative growth on the model's grid.

    Returns the answers, one more than layers; every one is asked for so many times."""
    answers, surface, last = [], np.zeros(SHAPE), LastLayer()
    network = corrector.law
    for number in range(1, layers + 2):
        r = request(z=surface, target=surface)
        where = MapOrigin(0.0, job, job, number - 1, number - 1, True)
        answers.append([corrector.answer(number, r, where, last) for _ in range(times)][-1])
        c, grid = answers[-1].correction, grid_of(r)
        asked = np.where(r.footprint, H / (1 + c.k_gain * c.psi) + c.residual_height, 0.0)
        relative = np.where(r.footprint, asked / H, np.nan)
        model = bead_model(r.paths, grid.shape, WIDTH)
        expected = model.growth(model.of_cells(relative, RES), 0.0)
        grown = grid.fine(grows(expected, network.predict(r).growth))
        last = LastLayer(surface, asked)
        surface = surface + np.where(r.footprint, H * grown, 0.0)
    return answers


def says(answers) -> list[float]:
    return [a.estimate.network_weight for a in answers]


def corrector_of(tmp_path, **params) -> Corrector:
    model = str(weights_file(tmp_path / 'g.npz'))
    return Corrector(CorrectionParams(law='unet', model=model, **params))


def test_a_network_that_predicts_nonsense_loses_its_say(tmp_path):
    found = lay(corrector_of(tmp_path), 4, lambda expected, predicted: expected)
    weights = says(found)
    assert 0.8 <= weights[0] <= 1.0
    assert weights[1] < 0.6
    assert weights[3] < 0.3
    assert max(weights[3:]) < 0.3
    against = lay(corrector_of(tmp_path), 2, lambda expected, predicted: expected - predicted)
    assert says(against)[2] < weights[2]
    assert 'weight of the network' in found[3].correction.reasons[0]
    assert not found[3].correction.fallback


def test_a_network_that_predicts_well_keeps_its_say(tmp_path):
    weights = says(lay(corrector_of(tmp_path), 4, lambda expected, predicted: expected + predicted))
    assert min(weights) > 0.85
    assert weights[-1] > 0.93


def test_without_its_say_the_network_changes_nothing(law):
    told = replace(request(), predicted=law.predict(request()).weighed(0.0))
    ours, plain = law.correct(told), make_law('bead_solver').correct(request())
    assert (ours.psi == plain.psi).all()
    assert not ours.fallback


def test_the_say_belongs_to_the_job_and_a_layer_counts_once(tmp_path):
    c, found = corrector_of(tmp_path), []
    for job, times in (('one', 1), ('two', 1), ('three', 3)):
        answers = lay(c, 3, lambda expected, predicted: expected, job, times)
        found.append([(a.estimate, a.correction.psi.tobytes()) for a in answers[1:]])
    assert found[0] == found[1] == found[2]


def test_a_law_without_a_network_tells_no_say():
    c = Corrector(CorrectionParams(law='bead_solver'))
    answer = c.answer(1, request(), origin(0), LastLayer())
    assert np.isnan(answer.estimate.network_weight)
    assert answer.correction.reasons == ()


def test_a_sample_is_what_grew_beside_the_bead_model():
    bumpy, plain = layer_sample(1), layer_sample(1, 0.0)
    known = bumpy.weight > 0.9
    assert np.abs(plain.y[known]).max() < 0.1
    turn = bumpy.x[plan_geometry.NAMES.index('turn')]
    assert np.corrcoef(bumpy.y[known] - plain.y[known], turn[known])[0, 1] > 0.8


def test_samples_come_back_from_their_files(tmp_path):
    with pytest.raises(ValueError, match='no job_'):
        list(samples.load(tmp_path))
    layers = [layer_sample(4), layer_sample(5)]
    samples.save(tmp_path, 4, layers)
    for a, b in zip(layers, samples.load(tmp_path), strict=True):
        assert (a.x == b.x).all()
        assert (a.y == b.y).all()
        assert (a.weight == b.weight).all()
        assert b.seed == 4
