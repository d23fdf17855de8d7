"""The cell as delivered: what is connected wrongly or is off shows where a person or a sensor looks."""

from __future__ import annotations

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim.delivered import INPUT_ESTOP, INPUT_LIMIT, Delivered, DeliveredParams
from waam_sim.plant import INPUT_GAS_OK, OUTPUT_GAS, Plant

START = (0.15, 0.12, 0.1)


def samples(way=(0.0, 0.0, 0.0), outputs=0, wire=0.0) -> np.ndarray:
    """Ten, from START along `way` (m, machine)."""
    made = np.zeros(10, SAMPLE)
    at = np.array(START) + np.linspace(0, 1, 10)[:, None] * np.array(way)
    made['table_x'], made['table_y'], made['tool_z'] = -at[:, 0], -at[:, 1], at[:, 2]
    made['outputs'], made['wire_cmd'] = outputs, wire
    return made


def live(plant: Plant, steps=20, **what):
    """The last reading."""
    for _ in range(steps):
        reading = plant.step(samples(**what), plant.time_us + 10_000)
    return reading


def gone(plant: Plant, way) -> np.ndarray:
    """m, that the torch truly went over the table."""
    live(plant, 1)
    before = np.array(plant.torch)
    live(plant, 1, way=way)
    return np.array(plant.torch) - before


@pytest.mark.parametrize(
    ('wrong', 'way', 'goes'),
    [
        ({}, (0.01, 0.02, 0.03), (0.01, 0.02, 0.03)),
        ({'x_reversed': True}, (0.01, 0.02, 0), (-0.01, 0.02, 0)),
        ({'z_reversed': True}, (0, 0, 0.01), (0, 0, -0.01)),
        ({'xy_swapped': True}, (0.01, 0, 0), (0, 0.01, 0)),
        ({'skew': 0.5}, (0, 0.02, 0), (0.02 * np.tan(np.radians(0.5)), 0.02, 0)),
    ],
)
def test_the_torch_goes_as_the_motors_turn(make_cell, wrong, way, goes):
    plant = make_cell(groups={'delivered': DeliveredParams(**wrong)})
    assert gone(plant, way) == pytest.approx(goes, abs=1e-9)


def test_a_good_cell_gets_its_samples_as_they_are():
    made = samples()
    assert Delivered(DeliveredParams()).moved(made) is made


@pytest.mark.parametrize(
    ('name', 'wiring', 'bit', 'rest', 'pressed'),
    [
        ('estop', 'good', INPUT_ESTOP, False, True),
        ('estop', 'reversed', INPUT_ESTOP, True, False),
        ('estop', 'unwired', INPUT_ESTOP, False, False),
        ('limits', 'good', INPUT_LIMIT, False, True),
        ('limits', 'open', INPUT_LIMIT, True, True),
        ('limits', 'bridged', INPUT_LIMIT, False, False),
    ],
)
def test_buttons(make_cell, name, wiring, bit, rest, pressed):
    plant = make_cell(groups={'delivered': DeliveredParams(**{name: wiring})})
    assert bool(live(plant).inputs & bit) is rest
    plant.faults.inject(f'{name.removesuffix("s")}_pressed', 0.0, plant.now)
    assert bool(live(plant).inputs & bit) is pressed
    plant.faults.inject('none', 0.0, plant.now)
    assert bool(live(plant).inputs & bit) is rest


@pytest.mark.parametrize(
    ('valve', 'off', 'on'),
    [('good', False, True), ('stuck_open', True, True), ('stuck_closed', False, False)],
)
def test_the_gas_valve(make_cell, valve, off, on):
    plant = make_cell(groups={'delivered': DeliveredParams(gas_valve=valve)})
    assert bool(live(plant).inputs & INPUT_GAS_OK) is off and (plant.gassed > 0) is off
    before = plant.gassed
    assert bool(live(plant, outputs=OUTPUT_GAS).inputs & INPUT_GAS_OK) is on
    assert (plant.gassed > before) is on


def test_sensors_read_a_supply_with_their_scale_and_sign(make_cell):
    wrong = DeliveredParams(current_scale=-1.05, current_offset=2.0, voltage_scale=0.95)
    plant = make_cell(groups={'delivered': wrong})
    assert live(plant)[1:3] == pytest.approx((2.0, 0.0))
    plant.faults.inject('test_current', 50.0, plant.now)
    plant.faults.inject('test_voltage', 24.0, plant.now)
    assert live(plant)[1:3] == pytest.approx((2.0 - 52.5, 22.8))


def test_warmth_reads_as_cold_with_swapped_wires(make_cell):
    read = {}
    for swapped in (False, True):
        plant = make_cell(groups={'delivered': DeliveredParams(thermocouple_swapped=swapped)})
        before = [plant.temperature(10.0) for _ in range(5)][-1]
        plant.faults.inject('warm_hand', 15.0, plant.now)
        read[swapped] = [plant.temperature(10.0) for _ in range(5)][-1] - before
    assert read[False] == pytest.approx(15.0, abs=4.0)
    assert read[True] == pytest.approx(-15.0, abs=4.0)


def test_the_wire_that_was_fed_is_counted(make_cell):
    plant = make_cell()
    live(plant, 100, wire=0.05)
    live(plant, 100)
    assert plant.fed == pytest.approx(0.05 * plant.params.arc.wire_ratio, rel=5e-3)
