"""The law with the U-Net: what it sees, what it does with a forecast, how that earns its weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from net_weights import card, random_weights
from unet_layers import (
    SHAPE,
    WIDTH,
    H,
    grid_of,
    laid,
    mirrored,
    origin,
    request,
    turned,
    weights_file,
    zigzag,
)

from waam_adapt.beads import bead_path, features, model, plan_geometry
from waam_adapt.beads.bead_path import beads_of, nearest_of
from waam_adapt.beads.model import SPREAD
from waam_adapt.grids import CELLS_PER_BEAD
from waam_adapt.identify.forecast_weight import ForecastWeight
from waam_adapt.laws import net_file
from waam_adapt.laws.checks import MapOrigin
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.laws.registry import make_law
from waam_adapt.laws.unet_law import UNetLaw
from waam_adapt.types import BeadDeviation, Forecast, LastLayer


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
        counts = far < plan_geometry.NEIGHBOURHOOD_WIDTHS
        beside = pieces.step * np.exp(-0.5 * (far / plan_geometry.NEIGHBOUR) ** 2)
        beside[~counts | (np.abs(later) <= plan_geometry.APART)] = 0.0
        wanted = (
            (pieces.step * np.exp(-0.5 * (far / SPREAD) ** 2))[counts].sum(),
            beside[later < 0].sum(),
            beside[later > 0].sum(),
            (beside * np.exp(-np.abs(later) / plan_geometry.FRESH)).sum(),
        )
        assert sums[:, row, column] == pytest.approx(wanted, rel=1e-9, abs=1e-15)


def test_no_more_is_acted_on_than_setpoints_can_make_least_of_all_in_thin_walls(tmp_path):
    law = make_law('unet', model=str(weights_file(tmp_path / 'g.npz', scale=30.0)))
    wide = request()
    thin = request(planned=np.where(np.arange(96)[:, None] // 11 == 4, wide.planned, 0.0))  # 5.5 mm
    told, in_wall = law.forecast(wide), law.forecast(thin)
    assert -0.15 <= told.shape.min() < -0.1 and 0.1 < told.shape.max() <= 0.4
    assert 0.03 < np.abs(in_wall.shape).max() <= 0.05
    assert abs(told.level) <= 0.1


def test_a_forecast_has_a_shape_without_level(law):
    r = request()
    told, inside = law.forecast(r), features.counted(r, grid_of(r))
    assert abs(float((told.shape * inside).sum() / inside.sum())) < 0.01
    assert np.abs(told.shape).max() > 0.01


def test_the_network_sees_the_surface_its_uncertainty_and_what_the_job_has_shown():
    r = request()
    lacking = np.zeros(grid_of(r).shape)
    lacking[10:20, 8:14] = 0.2
    learned = BeadDeviation(lacking, layers=3, scatter=0.04, response=0.6)
    rough = replace(
        r, z=r.z - 0.3e-3 * r.footprint, sigma=np.full(SHAPE, 1e-4), learned=learned, next_thickness=H / 2
    )  # fmt: skip
    x = dict(
        zip(
            features.NAMES,
            features.build(rough, grid_of(r), features.counted(rough, grid_of(r))),
            strict=True,
        )
    )
    inside = features.counted(r, grid_of(r)) > 0.99
    assert sum(x[n] for n in features.BANDS)[inside] == pytest.approx(0.3e-3 / H, abs=1e-6)
    assert x['uncertainty'][inside] == pytest.approx(1e-4 / H, abs=1e-6)
    assert (x['seen'][inside] == 1).all()
    assert x['lacking'][inside] == pytest.approx(lacking[inside])
    same = [float(x[n][0, 0]) for n in ('layers', 'scatter', 'response', 'next')]
    assert same == pytest.approx([0.5, 0.4, 0.6, 0.5])
    unseen = replace(rough, z=np.where(np.arange(96) < 40, np.nan, rough.z))
    hole = dict(
        zip(
            features.NAMES,
            features.build(unseen, grid_of(r), features.counted(unseen, grid_of(r))),
            strict=True,
        )
    )
    assert not any(hole[n][:, :12].any() for n in (*features.BANDS, 'seen'))


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


def test_of_a_map_with_a_hole_the_server_corrects_what_was_seen_and_the_hole_holds_the_level():
    r = request()
    low = np.where(r.footprint, -0.3e-3, 0.0)
    hole = np.zeros(SHAPE, bool)
    hole[:, 40:56] = True  # a quarter of the layer
    params, where = CorrectionParams(law='bead_solver'), origin(0)
    whole, part = (
        Corrector(params).answer(1, replace(r, z=z), where, LastLayer()).correction
        for z in (low, np.where(hole, np.nan, low))
    )
    assert not part.fallback
    raised = part.residual_height - H * (1 - 1 / part.speed_factor)
    full = whole.residual_height - H * (1 - 1 / whole.speed_factor)
    middle = np.s_[28:60, 46:50]
    assert (
        raised[middle].mean() == pytest.approx(full[middle].mean(), rel=0.15)
        and full[middle].mean() > 0.2e-3
    )
    assert part.confidence[middle].max() < 0.05
    few = replace(r, z=np.where(np.arange(96) < 70, np.nan, low))
    assert Corrector(params).answer(1, few, where, LastLayer()).correction.fallback


def test_less_is_laid_where_more_will_grow():
    r, law = request(), UNetLaw.load('none', make_law('damped_inverse'))
    shape = np.zeros(grid_of(r).shape)
    shape[14:18, 10:14] = 0.3
    told = replace(
        r, forecast=Forecast(shape, np.zeros_like(shape), np.ones_like(shape), digest='abc')
    )
    hump, plain = law.correct(told), law.correct(r)
    place = np.s_[42:54, 30:42]
    assert (hump.psi - plain.psi)[place].mean() > 0.2  # faster: thinner
    assert hump.model_hash == 'abc'


def lay(corrector: Corrector, layers: int, left, job: str = 'job', times: int = 1):
    """Lays layers that each end too high by left(forecast, weighed), a share of their height on the model's grid.

    Returns the answers, one more than layers; every one is asked for so many times."""
    answers, r, last = [], request(), LastLayer()
    for number in range(1, layers + 2):
        where = MapOrigin(0.0, job, job, number - 1, number - 1, True)
        answers.append([corrector.answer(number, r, where, last) for _ in range(times)][-1])
        c = answers[-1].correction
        asked = np.where(r.footprint, H / (1 + c.k_gain * c.psi) + c.residual_height, 0.0)
        kept = corrector.identifier.memory[number]
        after = laid(r, left(kept.forecast, kept.weighed))
        last = LastLayer(r.z, asked, answers[-1].flow_factor)
        r = request(z=after, target=np.where(r.footprint, r.target + H, 0.0))
    return answers


def says(answers) -> list[float]:
    return [a.estimate.network_weight for a in answers]


def corrector_of(tmp_path, **params) -> Corrector:
    model = str(weights_file(tmp_path / 'g.npz'))
    return Corrector(CorrectionParams(law='unet', model=model, **params))


def test_a_network_that_tells_nonsense_loses_its_say(tmp_path):
    """What is left is what was taken off for it."""
    found = lay(corrector_of(tmp_path), 4, lambda told, weighed: -weighed.shape)
    weights = says(found)
    assert weights[0] == 1.0
    assert weights[1] < 0.6
    assert weights[3] < 0.3
    against = lay(corrector_of(tmp_path), 2, lambda told, weighed: -told.shape - weighed.shape)
    assert says(against)[2] < weights[2]
    assert 'weight of the network' in found[3].correction.reasons[0]
    assert not found[3].correction.fallback


def test_a_network_that_is_right_keeps_its_say(tmp_path):
    weights = says(lay(corrector_of(tmp_path), 4, lambda told, weighed: told.shape - weighed.shape))
    assert min(weights) > 0.93


def test_shape_and_level_are_weighed_apart(tmp_path):
    corrector = corrector_of(tmp_path)
    lay(corrector, 5, lambda told, weighed: told.shape - weighed.shape - weighed.level)
    who = corrector.identifier
    assert who.forecasts.state.shape.weight > 0.93
    assert who.forecasts.state.level.weight < 0.7 * who.forecasts.state.shape.weight


@given(st.floats(-2.0, 2.0), st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_a_weight_stays_between_nothing_and_all_and_goes_to_what_is_true(slope, start, seed):
    rng, weight = np.random.default_rng(seed), ForecastWeight(start)
    counted = np.ones((20, 30))
    for _ in range(30):
        told = 0.1 * rng.standard_normal(counted.shape)
        left = slope * told + 0.02 * rng.standard_normal(counted.shape)
        weight = weight.after_shape(told, left, counted)
        assert 0.0 <= weight.weight <= 1.0
    assert weight.weight == pytest.approx(min(max(slope, 0.0), 1.0), abs=0.1)


def test_nothing_is_believed_because_it_was_packaged(tmp_path):
    """A network starts with the weight that it earned in the laboratory's worst family."""
    path = tmp_path / 'g.npz'
    shy = {**card(), 'weights': {'shape': 0.3, 'level': 0.1}}
    net_file.save(path, random_weights(), shy)
    corrector = Corrector(CorrectionParams(model=str(path)))
    answer = corrector.answer(1, request(), origin(0), LastLayer())
    assert answer.estimate.network_weight == 0.3
    assert corrector.identifier.forecasts.state.level.weight == 0.1


def test_without_its_say_the_network_changes_nothing(law):
    told = replace(request(), forecast=law.forecast(request()).weighed(0.0, 0.0))
    ours, plain = law.correct(told), make_law('bead_solver').correct(request())
    assert (ours.psi == plain.psi).all()
    assert not ours.fallback


def test_the_say_belongs_to_the_job_and_a_layer_counts_once(tmp_path):
    c, found = corrector_of(tmp_path), []
    for job, times in (('one', 1), ('two', 1), ('three', 3)):
        answers = lay(c, 3, lambda told, weighed: -weighed.shape, job, times)
        found.append([(a.estimate, a.correction.psi.tobytes()) for a in answers[1:]])
    assert found[0] == found[1] == found[2]


def test_a_law_without_a_network_tells_no_say():
    c = Corrector(CorrectionParams(law='bead_solver'))
    answer = c.answer(1, request(), origin(0), LastLayer())
    assert np.isnan(answer.estimate.network_weight)
    assert answer.correction.reasons == ()
