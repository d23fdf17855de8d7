"""The cell as delivered: what is connected wrongly or is off shows where a person or a sensor looks."""

from __future__ import annotations

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim.delivered import INPUT_ESTOP, INPUT_LIMIT, Delivered, DeliveredParams
from waam_sim.plant import INPUT_GAS_OK, OUTPUT_GAS, Plant
from waam_sim.scanner import ScannerParams

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


OFF = {
    'scanner_x': 0.004, 'scanner_y': -0.005, 'scanner_z': 0.003, 'scanner_roll': 2.0, 'scanner_pitch': -1.5,
    'scanner_yaw': 1.8,
}  # fmt: skip


OVER = np.array([-0.01, 0.03, 0.02])  # m, work frame, with the scanner over the plate


def scanned(plant: Plant):
    """Profiles of a torch that stands at OVER."""
    still = samples()
    at = OVER + plant.params.work_zero
    still['table_x'], still['table_y'], still['tool_z'] = -at[0], -at[1], at[2]
    plant.scanning = True
    plant.step(still, plant.time_us + 10_000)
    return plant.profiles(still)


def about(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
    return turn


@pytest.mark.parametrize('off', [{}, OFF])
def test_a_point_of_a_scanner_that_sits_elsewhere_lies_on_the_surface_all_the_same(make_cell, off):
    quiet = ScannerParams(noise=0.0, dropout=0.0, outliers=0.0, steep_dropout=0.0)
    plant = make_cell(groups={'delivered': DeliveredParams(**off), 'scanner': quiet})
    x, y = np.meshgrid(plant.metal.spec.x, plant.metal.spec.y)
    plant.metal.z[:] = 0.02 + 0.1 * x - 0.2 * y
    z = scanned(plant).z[0].astype(float)
    turn = about(2, off.get('scanner_yaw', 0)) @ about(1, off.get('scanner_pitch', 0))
    turn = turn @ about(0, off.get('scanner_roll', 0)) @ about(2, 90.0)
    at = OVER + [
        0.060 + off.get('scanner_x', 0),
        off.get('scanner_y', 0),
        0.120 + off.get('scanner_z', 0),
    ]
    lateral = plant.scanner.lateral
    points = at + lateral[:, None] * turn[:, 0] + z[:, None] * turn[:, 2]
    there = plant.metal.spec.contains(points[:, 0], points[:, 1]) & np.isfinite(z)
    assert there.sum() > 100
    wanted = 0.02 + 0.1 * points[:, 0] - 0.2 * points[:, 1]
    assert np.abs(points[:, 2] - wanted)[there].max() < 2e-6


def test_late_stamps(make_cell):
    on_time, late = (
        scanned(make_cell(groups={'delivered': DeliveredParams(scanner_late=s)})).time_us
        for s in (0.0, 0.07)
    )
    assert (late - on_time == 70_000).all()


def test_what_is_set_at_the_pyrometer_stays_set(make_cell):
    plant = make_cell()
    plant.faults.inject('warm_hand', 200.0, plant.now)
    plant.faults.inject('emissivity_dial', 0.5, plant.now)
    high = [plant.temperature(10.0) for _ in range(5)][-1]
    plant.faults.inject('none', 0.0, plant.now)
    plant.faults.inject('warm_hand', 200.0, plant.now)
    assert [plant.temperature(10.0) for _ in range(5)][-1] == pytest.approx(high, abs=5.0)
    plant.faults.inject('emissivity_dial', 1.0, plant.now)
    assert [plant.temperature(10.0) for _ in range(5)][-1] < high - 30.0
