import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_process import heat, materials

STEEL = materials.get('er70s-6')


def test_feed_factor_of_the_source():
    """Ramp 20 to 400 degC: no change up to 200 degC, then linear, 85 % at 400 degC, no step."""
    ramp = np.linspace(20, 400, 3801)
    factor = heat.heat_factor(ramp, STEEL)
    assert np.all(factor[ramp <= 200] == 1.0)
    assert factor[-1] == pytest.approx(0.85)
    assert heat.heat_factor(300, STEEL) == pytest.approx(0.925)
    assert np.all(np.diff(factor) <= 0)
    assert np.abs(np.diff(factor)).max() < 1e-4


def test_feed_factor_is_not_extrapolated_and_unknown_stays_unknown():
    assert heat.heat_factor(900, STEEL) == heat.heat_factor(400, STEEL)
    assert np.isnan(heat.heat_factor(math.nan, STEEL))


def test_rosenthal_solves_the_heat_equation_of_a_moving_source():
    """In the frame of the source a*(T_xx + T_yy + T_zz) + V*T_x = 0 away from it (finite differences)."""
    a, v = STEEL.diffusivity, 0.01

    def t(x, y, z):
        return heat.rosenthal(x, np.sqrt(x**2 + y**2 + z**2), 3500.0, v, 20.0, 40.0, a)

    x, y, z, h = -4e-3, 3e-3, -2e-3, 2e-5
    second = sum(
        (t(x + i, y + j, z + k) - 2 * t(x, y, z) + t(x - i, y - j, z - k)) / h**2
        for i, j, k in ((h, 0, 0), (0, h, 0), (0, 0, h))
    )
    first = (t(x + h, y, z) - t(x - h, y, z)) / (2 * h)
    assert a * second + v * first == pytest.approx(0, abs=1e-2 * abs(v * first))


def test_rosenthal_is_hotter_behind_the_arc_and_cold_far_away():
    args = (3500.0, 0.01, 20.0, STEEL.conductivity, STEEL.diffusivity)
    behind, ahead = (heat.rosenthal(xi, 5e-3, *args) for xi in (-5e-3, 5e-3))
    assert behind > ahead > 20
    assert heat.rosenthal(1.0, 1.0, *args) == pytest.approx(20.0, abs=1e-6)


@pytest.mark.parametrize(('xi', 'r'), [(0.0, 0.0), (0.0, -1e-3), (5e-3, 1e-3)])
def test_rosenthal_refuses_what_is_no_distance(xi, r):
    with pytest.raises(heat.HeatError, match='r must be'):
        heat.rosenthal(xi, r, 3500.0, 0.01, 20.0, 40.0, 1e-5)


def test_powers():
    assert heat.effective_power(180, 22, 0.8) == pytest.approx(3168)
    assert heat.heat_input(180, 22, 0.01) == pytest.approx(396e3)


@given(st.floats(260, 800), st.floats(30, 2000))
def test_wait_is_when_the_lump_reaches_the_limit(start, tau):
    lump = heat.LumpedCooling(tau, 20.0)
    rate = -(start - 20.0) / tau
    wait = heat.cooling_wait(start, rate, 250.0, 20.0)
    assert lump.temperature(start, wait) == pytest.approx(250.0)
    assert wait > 0


def test_wait_is_zero_below_the_limit_and_unknown_when_it_does_not_cool():
    assert heat.cooling_wait(200, 5.0, 250, 20) == 0.0
    assert math.isnan(heat.cooling_wait(300, 0.5, 250, 20))
    assert math.isnan(heat.cooling_wait(300, math.nan, 250, 20))
    assert math.isnan(heat.cooling_wait(300, -1, 15, 20))


PASS = heat.ArcPass(power=2430.0, speed=10e-3, duration=60.0)


def test_least_rise_of_a_long_path_is_rykalins_peak_beside_a_fast_source():
    """Far from the torch and fast: 2*(Q/V)/(pi*e*rho*c*r^2)."""
    fast = heat.ArcPass(power=2430.0, speed=0.1, duration=600.0)
    r, capacity = 12e-3, STEEL.density * STEEL.specific_heat
    rise = heat.least_peak_rise(fast, r, STEEL.conductivity, STEEL.diffusivity)
    peak = 2 * fast.power / fast.speed / (math.pi * math.e * capacity * r**2)
    assert rise == pytest.approx(peak, rel=0.02)


def test_least_rise_of_a_short_path_is_that_of_all_the_energy_at_one_point():
    short = replace(PASS, duration=0.2)
    r, a = 20e-3, STEEL.diffusivity
    capacity = STEEL.density * STEEL.specific_heat
    t = np.linspace(0.1, 200, 200_000)
    curve = (
        2 * short.energy / (capacity * (4 * np.pi * a * t) ** 1.5) * np.exp(-(r**2) / (4 * a * t))
    )
    rise = heat.least_peak_rise(short, r, STEEL.conductivity, a)
    assert rise == pytest.approx(curve.max(), rel=1e-4)


@given(st.floats(3e-3, 50e-3), st.floats(1.05, 3.0))
def test_least_rise_falls_with_distance_and_grows_with_power(distance, more):
    def rise(p, r):
        return heat.least_peak_rise(p, r, STEEL.conductivity, STEEL.diffusivity)

    assert rise(PASS, distance * more) < rise(PASS, distance)
    assert rise(replace(PASS, power=PASS.power * more), distance) > rise(PASS, distance)


@pytest.mark.parametrize(('distance', 'speed'), [(0.0, 0.01), (0.01, 0.0)])
def test_least_rise_refuses_what_is_no_path(distance, speed):
    with pytest.raises(heat.HeatError, match='above zero'):
        heat.least_peak_rise(replace(PASS, speed=speed), distance, 40.0, 9e-6)
