"""Wire drive and arc: lag, delay, calibration error, ignition, slope of the current, faults."""

from __future__ import annotations

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim.arc import ArcParams, steady_current
from waam_sim.drive import Drive
from waam_sim.plant import INPUT_DRIVE_FAULT, INPUT_GAS_OK, OUTPUT_ARC, OUTPUT_GAS

ON = OUTPUT_ARC | OUTPUT_GAS
WIRE = 5 / 60


def wire_response(plant, command: float, milliseconds: int) -> tuple[np.ndarray, np.ndarray]:
    """True wire speed and reading after every millisecond of a step command."""
    true, read = [], []
    sample = np.zeros(1, SAMPLE)
    sample['tool_z'], sample['wire_cmd'] = 0.1, command
    for i in range(milliseconds):
        read.append(plant.step(sample, 1_000_000 + 1000 * i).wire_speed)
        true.append(float(plant.arc.state['wire'][0]))
    return np.array(true), np.array(read)


def test_wire_answers_after_a_delay_with_a_lag(make_cell):
    plant = make_cell()
    true, read = wire_response(plant, WIRE, 600)
    p = plant.params.arc
    assert (true[: round(p.wire_delay * 1e3)] == 0).all()
    reached = np.argmax(true > (1 - np.exp(-1)) * true[-1]) * 1e-3
    assert reached == pytest.approx(p.wire_delay + p.wire_lag, abs=0.004)
    assert (np.diff(true) >= 0).all()
    assert read[-1] == pytest.approx(WIRE, abs=p.wire_quantum)
    assert true[-1] / read[-1] == pytest.approx(p.wire_ratio, abs=0.01), (
        'the wheel does not see its own error'
    )
    steps = read / p.wire_quantum
    assert np.allclose(steps, np.round(steps), atol=1e-6)


def test_the_wheel_loses_no_count(make_cell):
    plant = make_cell()
    true, read = wire_response(plant, 2 / 60, 3000)  # between two steps of the reading
    p = plant.params.arc
    assert np.sum(read) * p.wire_ratio == pytest.approx(np.sum(true), rel=2e-4)


def burning(plant, patience: float = 2.0) -> Drive:
    """The cell with a freshly struck arc, torch at rest on the plate."""
    drive = Drive(plant, (0.02, 0.03, 0.02))
    drive.wait(0.1, outputs=OUTPUT_GAS)
    for _ in range(round(patience * 100)):
        drive.wait(0.01, WIRE, 22.0, ON)
        if plant.arc_on:
            return drive
    raise AssertionError(f'no arc within {patience} s')


def test_arc_strikes_after_a_delay_and_needs_gas_and_wire(make_cell):
    plant = make_cell()
    drive = Drive(plant, (0.02, 0.03, 0.02))
    drive.wait(0.5, WIRE, 22.0, OUTPUT_ARC)
    assert not plant.arc_on, 'no gas'
    drive.wait(0.5, 0.0, 22.0, ON)
    assert not plant.arc_on, 'no wire'
    reading = drive.wait(0.01, 0.0, 22.0, ON)[-1]
    assert reading.current < 1.0 and 60 < reading.voltage < 80, 'open-circuit voltage'
    delays = []
    for seed in range(12):
        plant = make_cell(seed=seed, groups={'arc': ArcParams(strike_failure=0.0)})
        start = Drive(plant, (0.02, 0.03, 0.02))
        start.wait(0.1, outputs=OUTPUT_GAS)
        n = 0
        while not plant.arc_on and n < 100:
            start.wait(0.01, WIRE, 22.0, ON)
            n += 1
        delays.append(n * 0.01)
    assert min(delays) > 0.05 and max(delays) < 0.25 and len(set(delays)) > 3


def test_failed_strikes_are_tried_again(make_cell):
    failed = 0
    for seed in range(4):
        plant = make_cell(seed=seed, groups={'arc': ArcParams(strike_failure=0.6)})
        burning(plant, patience=10.0)
        failed += int(plant.arc.state['failed'][0])
    assert failed > 0


def test_no_current_without_arc_output(make_cell):
    plant = make_cell()
    drive = burning(plant)
    assert drive.wait(0.5, WIRE, 22.0, ON)[-1].current > 50
    after = drive.wait(0.02, WIRE, 22.0, OUTPUT_GAS)
    assert after[-1].current < 0.1 and after[-1].voltage == 0.0 and not plant.arc_on


def test_current_falls_with_contact_distance_and_rises_with_wire(make_cell):
    p = make_cell().arc.params[0]
    per_mm = [
        steady_current(p, WIRE, (15 + d + 1) * 1e-3) - steady_current(p, WIRE, (15 + d) * 1e-3)
        for d in range(4)
    ]
    assert all(-6 < d < -1.5 for d in per_mm), 'a few ampere per millimetre'
    assert steady_current(p, 0.12, 0.015) > 1.1 * steady_current(p, 0.09, 0.015)

    def mean_current(lift: float) -> float:
        plant = make_cell()
        drive = burning(plant)
        drive.move((0.02, 0.03, 0.02 + lift), 0.05, WIRE, 22.0, ON)
        readings = drive.move((0.05, 0.03, 0.02 + lift), 0.01, WIRE, 22.0, ON)
        return float(np.mean([r.current for r in readings]))

    assert mean_current(0.0) - mean_current(3e-3) == pytest.approx(8.0, abs=3.0)


def test_the_current_melts_the_wire_that_comes(make_cell):
    """Slopes at the reference point are the parameters; away from it the melting balance bends them."""
    p = make_cell().arc.params[0]
    per_m = (steady_current(p, 0.11, 0.0151) - steady_current(p, 0.11, 0.0149)) / 0.2e-3
    assert -per_m / 138.0 == pytest.approx(24.0, rel=0.01)
    exponent = np.log(steady_current(p, 0.111, 0.015) / steady_current(p, 0.109, 0.015))
    assert exponent / np.log(0.111 / 0.109) == pytest.approx(0.65, rel=0.01)
    assert steady_current(p, 0.03, 0.015) < 0.95 * 138.0 * (0.03 / 0.11) ** 0.65
    near, far = (steady_current(p, 0.11, 0.015 + d) - 138.0 for d in (-6e-3, 6e-3))
    assert near > 1.3 * -far


def test_the_wire_freezes_to_a_tip_that_is_too_near(make_cell):
    plant = make_cell(groups={'arc': ArcParams(contact_min=4e-3)})
    drive = burning(plant)
    drive.move((0.02, 0.03, 0.02 - 10e-3), 0.05, WIRE, 22.0, ON)
    assert plant.arc_on
    drive.move((0.02, 0.03, 0.02 - 12e-3), 0.05, WIRE, 22.0, ON)
    drive.wait(0.05, WIRE, 22.0, ON)
    assert not plant.arc_on


def test_arc_dies_when_wire_stops_or_the_surface_is_too_far(make_cell):
    plant = make_cell()
    drive = burning(plant)
    drive.wait(0.6, 0.0, 22.0, ON)
    assert not plant.arc_on
    plant = make_cell()
    drive = burning(plant)
    drive.move((0.02, 0.03, 0.04), 0.05, WIRE, 22.0, ON)
    assert not plant.arc_on


def test_current_and_voltage_move_against_each_other(make_cell):
    drive = burning(make_cell())
    readings = drive.move((0.08, 0.03, 0.02), 0.01, WIRE, 22.0, ON)[50:]
    current = np.array([r.current for r in readings])
    voltage = np.array([r.voltage for r in readings])
    assert 1.0 < current.std() < 8.0 and 0.1 < voltage.std() < 1.0
    assert np.corrcoef(current, voltage)[0, 1] < -0.4
    assert voltage.mean() == pytest.approx(22.0, abs=1.0)


def test_faults_of_arc_wire_and_gas(make_cell):
    plant = make_cell()
    drive = burning(plant)
    drive.wait(0.5, WIRE, 22.0, ON)
    plant.faults.inject('wire_slip', 0.4, plant.now)
    assert drive.wait(0.5, WIRE, 22.0, ON)[-1].wire_speed == pytest.approx(0.6 * WIRE, rel=0.03)
    plant.faults.inject('none', 0.0, plant.now)
    assert drive.wait(0.5, WIRE, 22.0, ON)[-1].wire_speed == pytest.approx(WIRE, rel=0.03)
    plant.faults.inject('gas_loss', 1.0, plant.now)
    assert not drive.wait(0.2, WIRE, 22.0, ON)[-1].inputs & INPUT_GAS_OK
    assert drive.wait(1.0, WIRE, 22.0, ON)[-1].inputs & INPUT_GAS_OK
    plant.faults.inject('drive_fault', 0.5, plant.now)
    assert drive.wait(0.2, WIRE, 22.0, ON)[-1].inputs & INPUT_DRIVE_FAULT
    assert not drive.wait(0.5, WIRE, 22.0, ON)[-1].inputs & INPUT_DRIVE_FAULT
    plant.faults.inject('arc_loss', 0.3, plant.now)
    assert all(r.current < 1.0 for r in drive.wait(0.25, WIRE, 22.0, ON)[1:])
    drive.wait(2.0, WIRE, 22.0, ON)
    assert plant.arc_on


@pytest.mark.parametrize('coast', [0.02, 1.0])
def test_at_the_end_of_the_wire_the_wheel_runs_down_and_the_arc_goes_out(make_cell, coast):
    plant = make_cell(groups={'arc': ArcParams(wheel_coast=coast)})
    drive = burning(plant)
    drive.wait(0.5, WIRE, 22.0, ON)
    metal = plant.metal.deposited
    plant.faults.inject('wire_end', 0.0, plant.now)
    readings = drive.wait(0.4, WIRE, 22.0, ON)
    assert readings[19].wire_speed == pytest.approx(WIRE * np.exp(-0.2 / coast), abs=0.06 * WIRE)
    assert not plant.arc_on and readings[-1].current < 1.0
    drive.wait(2.0, WIRE, 22.0, ON)
    assert not plant.arc_on, 'no wire, no strike'
    assert plant.metal.deposited - metal < 0.05 * metal
    plant.faults.inject('none', 0.0, plant.now)  # the new spool
    drive.wait(1.0, WIRE, 22.0, ON)
    assert plant.arc_on
    assert drive.wait(0.5, WIRE, 22.0, ON)[-1].wire_speed == pytest.approx(WIRE, rel=0.03)
