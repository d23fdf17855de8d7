"""A shaft in the chuck of the simulated cell: no metal is lost or doubled at the seam, wherever that lies."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waam_process.grid import GridSpec, HeightGrid
from waam_process.plant_port import SAMPLE
from waam_sim.arc import ArcParams
from waam_sim.gantry import GantryParams
from waam_sim.metal_models import MODELS
from waam_sim.metal_params import MetalParams
from waam_sim.placement import PlacementParams
from waam_sim.plant import PlantParams
from waam_sim.scanner import ScannerParams
from waam_sim.shaft_plant import Chuck, ShaftPlant

CELL, FIRST, PERIOD, RIM, LENGTH = 4e-4, 0.020, 0.128, 0.0152, 0.040
SCALE = PERIOD / (2 * math.pi)
LEVEL = 0.5 * SCALE
CHUCK = Chuck(PERIOD, FIRST, SCALE, SCALE - LEVEL)
ZERO = np.array(PlantParams().work_zero)
STILL = 3000  # samples at the start without an arc: the cell forgets how fast the torch came there
INSIDE = 0.3 * CELL  # a place that is no edge of a cell, so that rounding does not choose the cell
QUIET = {'area_noise_fixed': 0.0, 'area_noise_layer': 0.0, 'width_noise': 0.0}


def cell(model='portions', height=LEVEL, **groups) -> ShaftPlant:
    cols = round((PERIOD + 2 * FIRST + 2 * RIM) / CELL)
    spec = GridSpec(-RIM, -RIM, CELL, round((LENGTH + 2 * RIM) / CELL), cols)
    inside = (spec.y > 0) & (spec.y < LENGTH)
    z = np.where(inside[:, None], height, 0.0) * np.ones(spec.cols)
    params = PlantParams(metal=MetalParams(model=model, **QUIET), **groups)
    return ShaftPlant(HeightGrid(spec, z), CHUCK, params, seed=2)


def lay(plant: ShaftPlant, path: list[tuple[float, float]], speed: float = 0.01) -> None:
    """Straight lines between points (m, work frame), the torch at the surface, where it stands before the start."""
    points = np.array(path)
    pairs = zip(points, points[1:], strict=False)
    ways = [np.linspace(a, b, max(2, int(math.dist(a, b) / speed * 1e3))) for a, b in pairs]
    track = np.concatenate(ways)
    still = np.repeat(track[:1], STILL, axis=0)
    track = np.concatenate([still, track, np.repeat(track[-1:], 10 + -len(track) % 10, axis=0)])
    on = np.ones(len(track), bool)
    on[:STILL] = on[-10:] = False
    for k in range(0, len(track), 10):
        samples = np.zeros(10, SAMPLE)
        samples['table_x'] = -(track[k : k + 10, 0] + ZERO[0])
        samples['table_y'] = -(track[k : k + 10, 1] + ZERO[1])
        samples['tool_z'] = LEVEL + ZERO[2]
        samples['outputs'] = 2 | on[k : k + 10]
        samples['wire_cmd'] = 0.08 * on[k : k + 10]
        samples['voltage_set'] = 22.0
        plant.step(samples, plant.time_us + 10_000)


def turn(plant: ShaftPlant) -> np.ndarray:
    """Heights of the first turn."""
    x = plant.metal.spec.x
    return plant.metal.z[:, (x >= FIRST) & (x < FIRST + PERIOD)]


def agree(plant: ShaftPlant) -> None:
    """All showings of a place are the same."""
    n = round(PERIOD / CELL)
    for field in (plant.metal.z, plant.metal.solid):
        assert np.array_equal(field[:, n:], field[:, :-n])
    heat = plant.heat
    n = round(PERIOD / heat.spec.resolution)
    for field in (heat.skin, heat.bulk, heat.thickness):
        assert np.allclose(field[:, n:], field[:, :-n], atol=1e-9)


@pytest.mark.parametrize('model', sorted(MODELS))
def test_nothing_is_lost_or_doubled_over_the_seam(model):
    seam = FIRST + PERIOD
    plant = cell(model)
    before = plant.metal_volume
    lay(plant, [(seam - 0.012, 0.020), (seam + 0.012, 0.020)])  # a ring over it
    lay(plant, [(seam - 0.001, 0.010), (seam - 0.001, 0.030)])  # and a line beside it
    agree(plant)
    wire = float(plant.metal.deposited)
    grown = plant.metal_volume - before
    assert wire > 1e-7
    assert plant.metal.state['lost'][0] == 0.0
    # `deposited` counts metal of the field, which is more where the shaft is thinner; here z is close to the scale
    assert grown == pytest.approx(wire, rel=0.1)


@pytest.mark.parametrize('model', sorted(MODELS))
def test_turning_everything_gives_the_same_metal(model):
    steady = {'arc': ArcParams(drift_current=0.0, drift_voltage=0.0)}
    found = []
    for shift in (0, 60, 160):  # cells, whole cells of heat; the second is laid over the seam
        plant = cell(model, **steady)
        x = FIRST + 0.1 + INSIDE + shift * CELL
        line = [(x, 0.010), (x, 0.030), (x + 0.004, 0.030), (x + 0.004, 0.010)]
        lay(plant, line, speed=0.0097)  # no portion ends on the edge of a sample
        found.append(np.roll(turn(plant), -shift, axis=1))
    assert found[0].max() > LEVEL + 1e-3
    for other in found[1:]:
        assert np.abs(other - found[0]).max() < 5e-6


def test_any_number_of_turns_is_the_same_place():
    plants = [cell(), cell()]
    for plant, turns in zip(plants, (0, 7), strict=True):
        x = FIRST + 0.05 + INSIDE + turns * PERIOD
        lay(plant, [(x, 0.010), (x, 0.030)])
    assert np.abs(turn(plants[0]) - turn(plants[1])).max() < 1e-9


@pytest.mark.parametrize('depth', [0.0, 4e-3])
def test_metal_at_a_smaller_radius_grows_higher(depth):
    plant = cell(height=LEVEL - depth)
    before = plant.metal_volume
    lay(plant, [(FIRST + 0.05, 0.010), (FIRST + 0.05, 0.030)])
    on_plate = float(plant.metal.deposited)
    grown = plant.metal_volume - before
    assert grown / on_plate == pytest.approx(CHUCK.share(LEVEL - depth + 1e-3), abs=0.03)


def test_the_scanner_sees_the_shaft_after_any_number_of_turns():
    still = {
        'scanner': ScannerParams(noise=0.0, outliers=0.0, dropout=0.0, shared_error=0.0, points=64)
    }
    plant = cell(**still)
    n = turn(plant).shape[1]
    bump = plant.metal.z
    x = plant.metal.spec.x
    bump += 1e-3 * np.cos(2 * math.pi * (x - FIRST) / PERIOD) * (bump > 0)
    assert n == round(PERIOD / CELL)
    plant.scanning = True
    rows = []
    for turns in (0, 3):
        samples = np.zeros(10, SAMPLE)
        at = (
            FIRST
            + 0.03
            + INSIDE
            + turns * PERIOD
            - still['scanner'].offset_x
            + np.arange(10) * 1e-6
        )
        samples['table_x'], samples['table_y'] = -(at + ZERO[0]), -(0.02 + ZERO[1])
        samples['tool_z'] = LEVEL + 0.005 + ZERO[2]
        for _ in range(2):  # the first is where the torch came from
            plant.step(samples, plant.time_us + 10_000)
            profiles = plant.profiles(samples)
        rows.append(profiles.z[-1])
    seen = np.isfinite(rows[0]) & np.isfinite(rows[1])  # flanks show by chance
    assert seen.sum() > 20
    assert np.allclose(rows[0][seen], rows[1][seen], atol=1e-6)


def test_the_chuck_lies_around_its_field():
    spec = GridSpec(-RIM, 0.0, CELL, 50, round((PERIOD + 2 * FIRST + 2 * RIM) / CELL))
    chuck = Chuck.around(spec, PERIOD / math.pi, LEVEL, 4e-3)
    assert (chuck.period, chuck.first) == pytest.approx((PERIOD, FIRST))
    assert (chuck.scale, chuck.core) == pytest.approx((SCALE, SCALE - LEVEL))


def test_the_chuck_is_told_turns():
    """Steps per mm that do not belong to its diameter would turn it too far."""
    samples = np.zeros(3, SAMPLE)
    samples['table_x'], samples['table_y'] = (0.0, -0.5, -2.25), -0.1
    placed = cell().placed_samples(samples)
    assert placed['table_x'] == pytest.approx([0.0, -0.5 * PERIOD, -2.25 * PERIOD])
    assert np.array_equal(placed['table_y'], samples['table_y'])
    assert samples['table_x'][1] == -0.5


def test_what_a_shaft_does_not_have_is_refused():
    with pytest.raises(ValueError, match='gantry_on'):
        cell(gantry=GantryParams(on=True))
    params = PlantParams(metal=MetalParams(cell=3e-4))
    spec = GridSpec(-RIM, 0.0, 3e-4, 100, 700)
    with pytest.raises(ValueError, match='metal_cell is 0.3 mm and does not divide the turn'):
        ShaftPlant(HeightGrid(spec, np.full(spec.shape, LEVEL)), CHUCK, params)
    short = GridSpec(0.01, 0.0, CELL, 50, 300)
    with pytest.raises(ValueError, match='not the turn'):
        ShaftPlant(HeightGrid(short, np.full(short.shape, LEVEL)), CHUCK, PlantParams())


def test_warp_is_not_simulated():
    plant = cell(part=PlacementParams(warp=3e-3))
    assert plant.placed.params['warp'][0] == 0.0
    assert plant.params.part.warp == 0.0
