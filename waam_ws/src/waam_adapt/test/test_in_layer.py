"""The rest of a layer, corrected by what was seen beside the arc: signs, sizes, limits, and what must not change."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_adapt import answers
from waam_adapt.in_layer.renewal import Belief, Seen, renew
from waam_adapt.laws.corrector import CorrectionParams
from waam_adapt.types import Correction, CorrectionError, split_ratio
from waam_msgs.msg import CorrectionMap
from waam_msgs.srv import RenewCorrection
from waam_node.conversions import floats, grid_to_msg, map_from_msg
from waam_process.grid import GridSpec

SHAPE, CELL, WIDTH, K = (60, 80), 0.5e-3, 6e-3, 0.3
PLANNED = np.zeros(SHAPE)
PLANNED[8:-8, 8:-8] = 1.5e-3
METAL = PLANNED > 0
NOTHING = np.full(SHAPE, np.nan)


def base(ratio=1.0):
    psi, residual = split_ratio(np.where(METAL, ratio, 1.0), np.where(METAL, PLANNED, 1.0), K)
    return Correction(psi, np.ones(SHAPE), residual, 'test', K)


def seen(ground=NOTHING, growth=NOTHING, count=1e6, age=0.0):
    return Seen(ground, growth, np.full(SHAPE, float(count)), np.full(SHAPE, float(age)))


def ratio_of(c):
    return 1 / (1 + K * c.psi) + c.residual_height / np.where(METAL, PLANNED, 1.0)


def test_nothing_seen_changes_nothing():
    before = base(1.1)
    found = renew(before, PLANNED, seen(), CELL, WIDTH)
    assert found.correction is before and not found.change.any()


def test_a_hollow_in_the_ground_asks_for_more_metal_there_alone():
    ground = NOTHING.copy()
    ground[20:40, 20:40] = -0.15e-3  # a tenth of a layer
    change = renew(base(), PLANNED, seen(ground), CELL, WIDTH).change
    assert 0.015 < change[30, 30] < 0.03  # of 0.1, by a gain of 0.3
    assert abs(change[30, 65]) < 1e-3
    assert not change[~METAL].any()


def test_beads_that_grew_too_high_make_the_rest_lower():
    growth = NOTHING.copy()
    growth[8:30, 8:-8] = 0.3e-3
    found = renew(base(), PLANNED, seen(growth=growth), CELL, WIDTH)
    after = ratio_of(found.correction)
    assert after[50, 40] - 1 == pytest.approx(
        -0.15, abs=0.03
    )  # far away: what the whole layer shares
    assert after[34, 40] == pytest.approx(after[50, 40], abs=0.01)  # the next bead: nothing else
    np.testing.assert_allclose(after[METAL] - 1, found.change[METAL], atol=1e-9)


def test_belief_rises_with_the_points_and_fades_with_the_age():
    growth = np.where(METAL, 0.3e-3, np.nan)
    growth[:, 40:] *= -1  # no level: what is left is what the neighbours share

    def size(**how):
        return -renew(base(), PLANNED, seen(growth=growth, **how), CELL, WIDTH).change[30, 18]

    few, many = size(count=30), size(count=1e6)
    assert few == pytest.approx(0.5 * many, rel=0.01)
    assert size(age=60.0) == pytest.approx(0.5 * many, rel=0.01)
    assert size(count=0) == size(age=1e9) == 0.0
    assert Belief().weight(np.array([1e9]), np.array([0.0])) == pytest.approx([0.3])


def level_asked(rows, share=-0.2, sigma=0.05, noise=0.0):
    """Change of the relative height far from what was seen: the first `rows` of the layer, off by `share`."""
    rng = np.random.default_rng(1)
    growth = NOTHING.copy()
    growth[8 : 8 + rows, 8:-8] = PLANNED[30, 30] * (share + noise * rng.standard_normal((rows, 64)))
    belief = Belief(level_sigma=sigma, limit=0.5)
    return renew(base(), PLANNED, seen(growth=growth, age=1e9), CELL, WIDTH, belief).change[50, 40]


def test_a_level_that_many_cells_show_is_believed_however_old_and_metal_is_asked_in_proportion():
    # a fifth less arrives: a quarter more is needed
    assert level_asked(30, sigma=0.3) == pytest.approx(0.25, rel=0.05)
    assert level_asked(30, share=0.2, sigma=0.3) == pytest.approx(-1 / 6, rel=0.05)
    assert 0 < level_asked(12) < level_asked(30) < 0.25


def test_a_level_is_believed_less_from_scattered_cells_and_never_where_none_is_expected():
    assert level_asked(12, noise=0.15) < 0.9 * level_asked(12)
    assert level_asked(30, sigma=0.01) < 0.6 * level_asked(30)
    assert level_asked(30, sigma=0.0) == 0.0
    assert level_asked(3) == 0.0  # the rim of the layer


def test_a_renewal_starts_from_the_layers_own_correction_and_not_from_the_one_before():
    growth = np.where(METAL, 0.3e-3, np.nan)
    first = renew(base(1.2), PLANNED, seen(growth=growth), CELL, WIDTH)
    again = renew(base(1.2), PLANNED, seen(growth=growth), CELL, WIDTH)
    np.testing.assert_array_equal(first.correction.psi, again.correction.psi)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.floats(0.5, 1.6), st.floats(0.0, 3e-3), st.floats(0.02, 0.3))
def test_whatever_is_seen_the_change_stays_inside_its_limits(seed, ratio, size, limit):
    rng = np.random.default_rng(seed)
    maps = [
        np.where(rng.random(SHAPE) < 0.5, size * rng.standard_normal(SHAPE), np.nan) for _ in '12'
    ]
    what = Seen(*maps, rng.integers(0, 500, SHAPE).astype(float), 100 * rng.random(SHAPE))
    found = renew(base(ratio), PLANNED, what, CELL, WIDTH, Belief(gain=1.0, limit=limit))
    c = found.correction
    assert np.abs(found.change).max() <= limit + 1e-12
    assert np.isfinite(c.psi).all() and np.abs(c.psi).max() <= 1
    assert (ratio_of(c)[METAL] > 0.39).all() and (ratio_of(c)[METAL] < 1.81).all()
    same = found.change == 0
    np.testing.assert_array_equal(c.psi[same], base(ratio).psi[same])


def request(**fields):
    spec = GridSpec(0.0, 0.0, CELL, *SHAPE)
    before = base(1.1)
    msg = CorrectionMap(job_id='j', layer=2, grid=grid_to_msg(spec), k_gain=K, flow_factor=1.05)
    msg.psi, msg.residual_height = floats(before.psi), floats(before.residual_height)
    msg.confidence, msg.law = floats(before.confidence), 'test'
    made = RenewCorrection.Request(job_id='j', layer=2, correction=msg, bead_width=WIDTH)
    growth = np.where(METAL, 0.3e-3, np.nan)
    made.planned_height, made.growth = floats(PLANNED), floats(growth)
    made.ground, made.count, made.age = (
        floats(NOTHING),
        floats(np.full(SHAPE, 100.0)),
        floats(np.zeros(SHAPE)),
    )
    for name, value in fields.items():
        setattr(made, name, value)
    return made, spec


def test_the_service_answers_in_time_and_keeps_the_other_terms():
    asked, spec = request()
    took = []
    for _ in range(5):
        began = time.perf_counter()
        answer, rms, most = answers.renew(CorrectionParams(), asked)
        took.append(time.perf_counter() - began)
    assert 0.01 < rms <= most <= 0.3
    assert answer.flow_factor == asked.correction.flow_factor and answer.layer == 2
    assert (map_from_msg(answer.psi, spec) >= map_from_msg(asked.correction.psi, spec)).all()
    assert min(took) < 1.0  # a hang, not a figure; the figure is in the bench


@pytest.mark.parametrize(
    ('fields', 'text'),
    [
        ({'growth': floats(np.zeros(5))}, 'growth'),
        ({'age': floats(np.full(SHAPE, np.inf))}, 'age has infinite values'),
        ({'bead_width': 0.0}, 'bead_width is 0'),
        ({'layer': 3}, 'correction is for layer 2'),
    ],
)
def test_what_cannot_be_used_is_named(fields, text):
    with pytest.raises(ValueError, match=text):
        answers.renew(CorrectionParams(), request(**fields)[0])


def test_maps_of_other_shapes_are_refused():
    with pytest.raises(CorrectionError, match='shape'):
        Seen(NOTHING, NOTHING[:5], NOTHING, NOTHING)
