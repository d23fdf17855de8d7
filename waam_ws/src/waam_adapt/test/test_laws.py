import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from waam_adapt import filters
from waam_adapt.laws import explicit as laws
from waam_adapt.laws.bead_solver_law import BeadSolver
from waam_adapt.laws.checks import safe_correct
from waam_adapt.laws.corrector import CorrectionParams
from waam_adapt.laws.registry import GONE, make_law
from waam_adapt.laws.registry import LAWS as REGISTERED
from waam_adapt.types import (
    MIN_GAIN,
    RATIO_HIGH,
    Correction,
    CorrectionError,
    CorrectionInput,
    split_ratio,
)
from waam_node.params import ParameterError, from_dict

SHAPE, RES, WIDTH, H = (80, 120), 0.5e-3, 6e-3, 2e-3
PITCH = 0.73 * WIDTH
LAWS = [laws.DampedInverse(), BeadSolver(laws.DampedInverse())]
named = pytest.mark.parametrize('law', LAWS, ids=lambda law: law.name)


def footprint():
    inside = np.zeros(SHAPE, bool)
    inside[8:-8, 8:-8] = True
    return inside


def given_surface(z, **changes):
    values = {
        'z': z, 'target': np.zeros(SHAPE), 'planned': np.where(footprint(), H, 0.0), 'resolution': RES,
        'bead_width': WIDTH, 'k_gain': 0.3, 'sigma': np.full(SHAPE, 2e-5), 'direction': (1.0, 0.0),
    }  # fmt: skip
    return CorrectionInput(**(values | changes))


def bump(height, centre=(40, 60), size=12):
    z = np.zeros(SHAPE)
    half = size // 2
    z[centre[0] - half : centre[0] + half, centre[1] - half : centre[1] + half] = height
    return z


@named
def test_slower_over_a_hollow_and_faster_over_a_hump(law):
    hollow, hump = (law.correct(given_surface(bump(h))) for h in (-0.3e-3, 0.3e-3))
    assert hollow.psi[40, 60] < -0.2
    assert hump.psi[40, 60] > 0.2
    assert hollow.speed_factor[40, 60] < 1 < hump.speed_factor[40, 60]
    assert abs(hollow.psi[40, 15]) < 0.02


@named
@settings(max_examples=30)
@given(st.floats(-3e-3, 3e-3), st.floats(0.0, 0.9))
def test_whatever_the_surface_psi_stays_in_its_range(law, height, k_gain):
    result = law.correct(given_surface(bump(height, size=40), k_gain=k_gain))
    assert np.abs(result.psi).max() <= 1
    assert np.isfinite(result.residual_height).all()
    assert result.speed_factor.min() > 0
    assert ((result.confidence >= 0) & (result.confidence <= 1)).all()


@given(st.floats(0.4, 1.8), st.floats(0.0, 0.5))
def test_speed_and_residual_together_give_the_wanted_height_once(ratio, k_gain):
    psi, residual = split_ratio(np.array([ratio]), np.array([H]), k_gain)
    laid = H / (1 + k_gain * psi) + residual
    assert laid == pytest.approx(ratio * H)
    if abs(psi[0]) < 1 and k_gain >= MIN_GAIN:
        assert residual[0] == 0.0


def test_flat_missing_height_is_asked_for_in_the_share_gain():
    missing = 0.2e-3
    result = laws.DampedInverse(gain=0.5).correct(
        given_surface(np.full(SHAPE, -missing), sigma=np.zeros(SHAPE))
    )
    asked = H / result.speed_factor + result.residual_height
    assert asked[footprint()] == pytest.approx(H + 0.5 * missing, rel=1e-6)


def test_saturation_is_counted_and_the_rest_goes_to_the_residual():
    result = laws.DampedInverse().correct(given_surface(np.full(SHAPE, -1.2e-3)))
    inside = footprint()
    assert (result.psi[inside] == -1).all()
    assert result.saturated_cells >= inside.sum()
    assert (result.residual_height[inside] > 0).all()
    over = laws.DampedInverse().correct(given_surface(np.full(SHAPE, 1.0e-3)))
    assert (over.residual_height[inside] < 0).all()


def test_wanted_height_is_limited_to_what_a_bead_can_be():
    result = laws.DampedInverse().correct(given_surface(np.full(SHAPE, -5e-3)))
    asked = (H / result.speed_factor + result.residual_height)[footprint()]
    assert asked == pytest.approx(RATIO_HIGH * H)


def test_nothing_is_known_far_from_the_footprint():
    z = np.full(SHAPE, -0.3e-3)
    planned = np.zeros(SHAPE)
    planned[:, :40] = H
    result = laws.DampedInverse().correct(given_surface(z, planned=planned))
    assert (result.psi[:, 60:] == 0).all()
    assert (result.confidence[:, 60:] == 0).all()
    assert (result.psi[:, 30:40] < -0.3).all()  # up to the very edge


def test_a_wide_hole_holds_the_level_and_a_narrow_one_is_bridged():
    z = np.full(SHAPE, -0.3e-3)
    z[20:60, 50:90] = np.nan
    z[20:24, 20:24] = np.nan
    result = laws.DampedInverse().correct(given_surface(z))
    assert result.psi[40, 70] == pytest.approx(result.psi[40, 20], rel=0.1)
    assert result.confidence[40, 70] == 0
    assert result.psi[22, 22] == pytest.approx(result.psi[40, 22], rel=0.02)


def test_edge_slope_of_the_outermost_bead_does_not_ask_for_metal():
    z = np.zeros(SHAPE)
    depth = filters.depth(footprint()) * RES
    z -= 1e-3 * np.clip(1 - depth / 2e-3, 0, 1)
    assert np.abs(laws.DampedInverse().correct(given_surface(z)).psi).max() < 0.02


@pytest.mark.parametrize('angle', [0.0, 30.0, 90.0])
def test_ripple_of_the_beads_is_not_answered_but_longer_waves_are(angle):
    a = np.deg2rad(angle)
    direction = (np.cos(a), np.sin(a))
    x, y = np.meshgrid(np.arange(SHAPE[1]) * RES, np.arange(SHAPE[0]) * RES)
    across = -x * direction[1] + y * direction[0]
    for period, low, high in ((PITCH, 0.0, 0.03), (5 * PITCH, 0.95, 1.35)):
        wave = 0.1e-3 * np.cos(2 * np.pi * across / period)
        out = filters.inverse_bead_filter(wave, RES, WIDTH, direction, 0.1)
        gain = out[20:-20, 30:-30].std() / wave[20:-20, 30:-30].std()
        assert low <= gain <= high, (period, gain)


def test_inverse_undoes_the_overlap_of_beads_for_waves_of_three_pitches():
    frequency = 1 / (3 * PITCH)
    y = np.arange(240) * RES
    wave = np.tile(np.cos(2 * np.pi * frequency * y)[:, None], (1, 8))
    metal = filters.inverse_bead_filter(wave, RES, WIDTH, (1.0, 0.0), 0.1)
    laid = filters.bead_transfer(frequency, WIDTH) * metal
    assert laid[60:180].std() / wave[60:180].std() == pytest.approx(1.0, abs=0.12)
    assert filters.bead_transfer(frequency, WIDTH) < 0.85  # without the inverse


def test_transfer_of_a_bead_is_that_of_a_parabola():
    f = 90.0
    s = np.linspace(-WIDTH / 2, WIDTH / 2, 20001)
    section = 1 - (2 * s / WIDTH) ** 2
    direct = trapezoid(section * np.cos(2 * np.pi * f * s), s) / trapezoid(section, s)
    assert filters.bead_transfer(f, WIDTH) == pytest.approx(direct, abs=1e-6)
    assert filters.bead_transfer(0.0, WIDTH) == 1.0


def test_uncertain_cells_are_believed_less():
    z = np.full(SHAPE, -0.3e-3)
    sure, unsure = (
        laws.DampedInverse().correct(given_surface(z, sigma=np.full(SHAPE, s)))
        for s in (1e-5, 5e-4)
    )
    assert abs(unsure.psi[40, 60]) < 0.5 * abs(sure.psi[40, 60])
    assert unsure.confidence[40, 60] < sure.confidence[40, 60]


def test_zero_law_and_zero_gain():
    z = bump(-0.3e-3)
    assert not laws.Zero().correct(given_surface(z)).psi.any()
    result = laws.DampedInverse().correct(given_surface(z, k_gain=0.0))
    assert not result.psi.any()
    assert result.residual_height[40, 60] > 0.1e-3  # speed may not: the feed has to


@pytest.mark.parametrize(
    ('changes', 'word'),
    [
        ({'target': np.zeros((3, 3))}, 'target has shape'),
        ({'planned': np.full(SHAPE, -1e-3)}, 'planned'),
        ({'planned': np.full(SHAPE, np.inf)}, 'planned'),
        ({'sigma': np.full(SHAPE, np.inf)}, 'sigma'),
        ({'bead_width': np.nan}, 'bead_width'),
        ({'k_gain': -0.1}, 'k_gain'),
        ({'resolution': 0.0}, 'resolution'),
        ({'direction': (np.nan, 0.0)}, 'direction'),
    ],
)
def test_impossible_input_is_refused_naming_the_field(changes, word):
    with pytest.raises(CorrectionError, match=word):
        given_surface(np.zeros(SHAPE), **changes)


def test_unknown_law_names_the_known_ones():
    with pytest.raises(
        CorrectionError, match="'magic'; known are damped_inverse, bead_solver, unet, zero"
    ):
        make_law('magic', 0.9, 0.1)


@pytest.mark.parametrize(('old', 'new'), GONE.items())
def test_laws_of_former_versions_say_what_to_write(old, new):
    with pytest.raises(CorrectionError, match=f"'{old}' is gone: write '{new}'"):
        make_law(old)
    with pytest.raises(ParameterError, match=f"'{old}' is gone, write '{new}'"):
        from_dict(CorrectionParams, {'law': old})
    assert new in REGISTERED


class Broken:
    """A law gone wrong, as a network might."""

    name = 'broken'

    def __init__(self, value):
        self.value = value

    def correct(self, request):
        psi = np.full(request.z.shape, self.value)
        zero = np.zeros_like(psi)
        return Correction(psi, zero, zero, self.name, request.k_gain)


@pytest.mark.parametrize(('value', 'word'), [(np.nan, 'not finite'), (1.5, 'above 1')])
def test_a_law_that_goes_wrong_is_replaced_by_no_correction(value, word):
    result = safe_correct(Broken(value), given_surface(np.zeros(SHAPE)), ())
    assert result.fallback
    assert word in result.reasons[0]
    assert not result.psi.any()


def test_reasons_against_the_map_remove_the_correction():
    result = safe_correct(laws.DampedInverse(), given_surface(bump(-0.3e-3)), ('stale map',))
    assert result.fallback
    assert result.reasons == ('stale map',)
    assert not result.psi.any()
    assert not result.confidence.any()
