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


STACK = heat.LayerStack(energy=60e3, heat_capacity=80.0, base=400.0, loss=0.8, t_env=20.0)


def test_a_part_heats_up_layer_by_layer_until_new_metal_and_loss_take_what_the_arc_brings():
    t = STACK.interpass(400, 90.0)
    assert t[0] == 20.0
    assert (np.diff(t[:6]) > 0).all()
    assert t[-1] == pytest.approx(20 + 60e3 / (80 + 0.8 * 90.0), rel=0.03)


@given(st.floats(30, 600), st.floats(5, 200))
def test_longer_cycles_never_make_the_part_warmer(cycle, more):
    assert (STACK.interpass(30, cycle + more) <= STACK.interpass(30, cycle) + 1e-9).all()


@given(st.floats(40, 400), st.floats(5, 200))
def test_pauses_keep_the_limit_and_are_not_longer_than_needed(limit, duration):
    waits = STACK.pause(20, duration, limit)
    assert (waits >= 0).all()
    assert waits[0] == 0
    t = 20.0
    for n in range(1, 20):
        capacity = 400.0 + n * 80.0
        t = 20 + ((t - 20) * (capacity - 80.0) + 60e3) / capacity * np.exp(
            -(duration + waits[n]) * 0.8 / capacity
        )
        assert t <= limit + 1e-6
        assert waits[n] == 0 or t == pytest.approx(limit)


@pytest.mark.parametrize('name', ['energy', 'heat_capacity', 'base', 'loss'])
def test_a_stack_that_cannot_be_is_refused_by_name(name):
    with pytest.raises(heat.HeatError, match=name):
        replace(STACK, **{name: 0.0})
