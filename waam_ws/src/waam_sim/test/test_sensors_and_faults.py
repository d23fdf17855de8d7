"""Pyrometer and faults."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waam_sim.compiled import normal, random_state, uniform
from waam_sim.faults import KINDS, FaultError, Faults
from waam_sim.pyrometer import Pyrometer, PyrometerParams, apparent


def test_emissivity_error_reads_low_and_grows_with_temperature():
    p = PyrometerParams()
    errors = [apparent(t, p, 22.0) - t for t in (50.0, 200.0, 400.0)]
    assert all(-40 < e < 0 for e in errors) and errors == sorted(errors, reverse=True)
    exact = PyrometerParams(emissivity=0.85)
    assert apparent(250.0, exact, 22.0) == pytest.approx(250.0)


@pytest.mark.parametrize('emissivity', [0.6, 0.82, 0.95])
def test_a_part_as_cold_as_its_surroundings_reads_right_whatever_its_emissivity(emissivity):
    p = PyrometerParams(emissivity=emissivity)
    assert apparent(22.0, p, 22.0) == pytest.approx(22.0)
    assert (apparent(150.0, p, 22.0) > 150.0) is (emissivity > 0.85)


def test_reading_lags_and_scatters():
    p = PyrometerParams(emissivity=0.85)
    meter = Pyrometer(p, random_state(1, 3), 22.0)
    for _ in range(20):
        meter.read(20.0, 0.1)
    first = meter.read(200.0, 0.1)
    assert 40 < first < 160, 'lag'
    values = np.array([meter.read(200.0, 0.1) for _ in range(200)])[40:]
    assert values.mean() == pytest.approx(200.0, abs=0.5)
    assert values.std() == pytest.approx(p.noise, rel=0.3)


def reading(plant) -> float:
    """What the pyrometer shows when it has settled, degC."""
    return max(plant.temperature(10.0) for _ in range(5))


def test_an_aimed_pyrometer_sees_a_small_part_beside_the_middle_of_the_plate(make_cell):
    plant = make_cell(size=(0.2, 0.2, 0.01))
    spec = plant.heat.spec
    near = (np.abs(spec.x[None, :] - 0.03) < 0.01) & (np.abs(spec.y[:, None] - 0.03) < 0.01)
    plant.heat.skin[near] = 300.0
    assert reading(plant) < 40.0  # the middle of the plate is cold
    plant.aim(0.03, 0.03)
    assert reading(plant) > 200.0


def test_a_pyrometer_with_a_spot_of_its_own_cannot_be_aimed(make_cell):
    plant = make_cell(groups={'pyrometer': PyrometerParams(spot_x=0.01, spot_y=0.02)})
    plant.aim(0.05, 0.05)
    assert plant.spot == (0.01, 0.02)


def test_stuck_pyrometer_repeats_itself_and_recovers():
    meter = Pyrometer(PyrometerParams(), random_state(1, 3), 22.0)
    last = meter.read(100.0, 0.1)
    assert {meter.read(300.0, 0.1, stuck=True) for _ in range(20)} == {last}
    assert meter.read(300.0, 0.1) > last + 50


def test_range_limits_the_reading():
    meter = Pyrometer(PyrometerParams(range_high=500.0), random_state(1, 3), 22.0)
    assert meter.read(900.0, 0.1) == 500.0


def test_timed_faults_end_by_themselves():
    faults = Faults()
    faults.inject('arc_loss', 0.5, 10.0)
    assert faults.on('arc_loss', 10.4) and not faults.on('arc_loss', 10.6)
    faults.inject('scanner_dead', 0.0, 10.0)
    assert faults.on('scanner_dead', 1e6), 'value 0: until ended'
    faults.inject('none', 0.0, 20.0)
    assert not faults.active


@pytest.mark.parametrize(
    ('name', 'value'), [('wire_slip', 1.5), ('wire_slip', -0.1), ('arc_loss', math.nan)]
)
def test_bad_fault_values_are_refused(name, value):
    with pytest.raises(FaultError, match=name):
        Faults().inject(name, value, 0.0)


def test_unknown_fault_names_the_known_ones():
    with pytest.raises(FaultError, match=', '.join(KINDS)):
        Faults().inject('quake', 0.0, 0.0)


def test_random_numbers_are_good_enough():
    rng = random_state(3, 1)
    u = np.array([uniform(rng) for _ in range(20000)])
    n = np.array([normal(rng) for _ in range(20000)])
    assert u.min() > 0 and u.max() < 1 and u.mean() == pytest.approx(0.5, abs=0.01)
    assert n.mean() == pytest.approx(0.0, abs=0.03) and n.std() == pytest.approx(1.0, abs=0.03)
    assert abs(np.corrcoef(u[1:], u[:-1])[0, 1]) < 0.03
    assert uniform(random_state(3, 1)) != uniform(random_state(3, 2))
