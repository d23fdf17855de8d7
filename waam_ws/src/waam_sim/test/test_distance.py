"""The distance sensor at the torch."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from waam_sim.distance import DistanceParams
from waam_sim.drive import Drive
from waam_sim.plant import OUTPUT_ARC, OUTPUT_GAS

ON = OUTPUT_ARC | OUTPUT_GAS
WIRE = 5 / 60
QUIET = DistanceParams(dropout=0.0)


def of(**changed) -> dict:
    return {'distance': dataclasses.replace(QUIET, **changed)}


def readings(plant, lift: float = 0.0, at=(0.05, 0.03), seconds: float = 1.0) -> np.ndarray:
    """What the controller is given (one value per 10 ms) with the torch at rest."""
    drive = Drive(plant, (*at, 0.02 + lift))
    return np.array([r.distance for r in drive.wait(seconds)])


def test_the_laser_says_millimetres_with_its_noise_and_resolution(make_cell):
    for lift in (-2e-3, 0.0, 3e-3):
        said = readings(make_cell(groups=of()), lift)
        assert said.mean() == pytest.approx(100.0 + lift * 1e3, abs=0.005)
        assert 0.005 < said.std() < 0.02
        assert np.allclose(said, np.round(said, 2), atol=1e-9)


def test_readings_are_counted_at_the_cycle_of_the_sensor(make_cell):
    def counted(**changed) -> int:
        plant = make_cell(groups=of(**changed))
        return Drive(plant, (0.05, 0.03, 0.02)).wait(1.65)[-1].distance_reading

    assert counted() == pytest.approx(825, abs=2)
    assert counted(kind='infrared') == pytest.approx(100, abs=1)
    assert counted(kind='none') == 0


def test_the_infrared_sensor_says_counts_of_a_curve_of_its_own(make_cell):
    at = {
        lift: readings(make_cell(groups=of(kind='infrared')), lift).mean() for lift in (0.0, 0.02)
    }
    assert at[0.0] == pytest.approx(0.13 / 0.100 / 5 * 1023, abs=1.0)
    assert at[0.02] == pytest.approx(0.13 / 0.120 / 5 * 1023, abs=1.0)
    polynomial = np.polyval([-5e-11, 1e-7, -8e-5, 3.24e-2, -6.84, 698.49], at[0.02])
    assert abs(polynomial - 120.0) > 0.5, (
        'the curve that the controller uses is not the one of the cell'
    )


def test_it_is_blind_over_an_edge_and_out_of_range(make_cell):
    assert np.isnan(readings(make_cell(groups=of()), at=(0.1, 0.03))).all()
    assert np.isnan(readings(make_cell(groups=of()), lift=0.03)).all()
    assert np.isfinite(readings(make_cell(groups=of()), at=(0.097, 0.03))).all()


def lost_beside_the_arc(make_cell, lead: float, outputs: int) -> float:
    """Share of readings without echo while the torch rides along the plate."""
    plant = make_cell(groups=of(lead=lead))
    drive = Drive(plant, (0.02, 0.03, 0.02))
    drive.wait(0.1, outputs=OUTPUT_GAS)
    drive.move((0.025, 0.03, 0.02), 0.01, WIRE, 22.0, outputs)
    seen = drive.move((0.075, 0.03, 0.02), 0.01, WIRE, 22.0, outputs)
    assert plant.arc_on == (outputs == ON)
    return float(np.isnan([r.distance for r in seen]).mean())


def test_the_arc_dazzles_it_the_more_the_nearer(make_cell):
    near, far = (lost_beside_the_arc(make_cell, lead, ON) for lead in (2e-3, 12e-3))
    assert near > 0.6 and far < 0.1
    assert lost_beside_the_arc(make_cell, 2e-3, OUTPUT_GAS) == 0.0


def test_it_looks_ahead_along_the_path(make_cell):
    plant = make_cell(groups=of(lead=0.01))
    spec = plant.metal.spec
    plant.metal.z[:, spec.x > 0.06] += 1e-3
    plant.metal.solid[:] = plant.metal.z
    drive = Drive(plant, (0.02, 0.03, 0.02))

    def stepped(to: float) -> float:
        """x of the torch at the first reading on the other side of the step."""
        start = drive.position[0]
        said = np.array([r.distance for r in drive.move((to, 0.03, 0.02), 0.01)])
        changed = int(np.argmax(np.abs(said - said[0]) > 0.5))
        return start + (to - start) * changed / len(said)

    assert stepped(0.08) == pytest.approx(0.05, abs=1.5e-3)
    assert stepped(0.02) == pytest.approx(0.07, abs=1.5e-3)


@pytest.mark.parametrize('fault', ['dead', 'stuck', 'inverted', 'drift', 'unit', 'dropout'])
def test_faults_of_the_sensor(make_cell, fault):
    plant = make_cell(groups=of())
    drive = Drive(plant, (0.05, 0.03, 0.021))
    before = drive.wait(0.1)[-1]
    plant.faults.inject(f'distance_{fault}', 0.0, plant.now)
    drive.move((0.05, 0.03, 0.023), 0.01)
    after = drive.wait(1.0)
    said = np.array([r.distance for r in after])
    if fault == 'dead':
        assert after[-1].distance_reading == before.distance_reading
    elif fault == 'stuck':
        assert set(said) == {before.distance}
        assert after[-1].distance_reading > before.distance_reading + 400
    elif fault == 'inverted':
        assert said.mean() == pytest.approx(97.0, abs=0.01)
    elif fault == 'drift':
        assert said[-1] - said[0] == pytest.approx(0.5, abs=0.06)
    elif fault == 'unit':
        assert said.mean() == pytest.approx(103.0 / 25.4, abs=0.01)
    else:
        assert 0.02 < np.isnan(said).mean() < 0.25
    plant.faults.inject('none', 0.0, plant.now)
    if fault != 'drift':
        assert math.isclose(drive.wait(0.1)[-1].distance, 103.0, abs_tol=0.06)
