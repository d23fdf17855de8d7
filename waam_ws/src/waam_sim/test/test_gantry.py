"""Axes that swing: off changes nothing, on they swing as their modes say, and the accelerometer sees it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim import part
from waam_sim.compiled import random_state
from waam_sim.gantry import GRAVITY, GantryParams
from waam_sim.plant import Plant, PlantParams

ALONE = {'second_share': 0.0, 'coupling': 0.0, 'hz_per_m': 0.0, 'sensor_noise': 0.0}


def cell(**gantry: object) -> Plant:
    params = PlantParams(gantry=GantryParams(**gantry))
    return Plant(part.plate(0.04, 0.03, 0.01, params.metal.cell, 2e-3), params, 3)


def moving(x: np.ndarray) -> np.ndarray:
    """Samples (n,) with the axis X at x (m, machine)."""
    samples = np.zeros(len(x), SAMPLE)
    samples['table_x'], samples['table_y'], samples['tool_z'] = -x, -0.15, 0.1
    return samples


def live(plant: Plant, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deviation along x and y (n, 2) of every ms, and samples of the accelerometer (m, 3)."""
    off, seen = [], []
    for i in range(len(x)):
        plant.step(moving(x[i : i + 1]), 1_000_000 + 1000 * (i + 1))
        off.append(plant.gantry.deviation.copy())
        if (found := plant.accelerations()) is not None:
            seen.append(found.values)
    return np.array(off), np.concatenate(seen) if seen else np.empty((0, 3))


def stop(ms: int = 400, speed: float = 0.01) -> np.ndarray:
    """A stop from a constant speed (m/s) at 0.2 m."""
    return 0.2 + np.concatenate([np.arange(-50, 0) * 1e-3 * speed, np.zeros(ms)])


def test_rigid_axes_hear_nothing_and_stay() -> None:
    plant = cell()
    plant.sensing = True
    off, seen = live(plant, stop(50))
    assert not off.any() and not len(seen)


def test_one_mode_swings_as_the_solution_says() -> None:
    plant = cell(on=True, x_hz=40.0, x_damping=0.05, **ALONE)
    off, _ = live(plant, stop())
    omega = 2 * math.pi * plant.gantry.hz(0, 0.2)
    damped = omega * math.sqrt(1 - 0.05**2)
    # the push of the start and, 50 ms later, that of the stop
    t = 1e-3 * np.arange(1, len(off) + 1)
    swing = sum(
        np.where(
            t > at,
            push / damped * np.exp(-0.05 * omega * (t - at)) * np.sin(damped * (t - at)),
            0.0,
        )
        for at, push in ((1e-3, -0.01), (51e-3, 0.01))
    )
    assert off[:, 0] == pytest.approx(swing, abs=1e-9)
    assert not off[:, 1].any()


def test_coupling_load_and_place_act() -> None:
    plant = cell(on=True, coupling=0.1)
    off, _ = live(plant, stop())
    assert 0.02 < abs(off[:, 1]).max() / abs(off[:, 0]).max() < 0.4
    gantry = plant.gantry
    assert gantry.hz(0, 0.3) < gantry.hz(0, 0.2)
    assert gantry.hz(0, 0.2, 1e-3) < gantry.hz(0, 0.2) < 41.0


def test_the_accelerometer_sees_the_swing() -> None:
    plant = cell(on=True, sensor_resolution=1e-6, **ALONE)
    plant.sensing = True
    off, seen = live(plant, stop())
    assert len(seen) == pytest.approx(3.2 * len(off), abs=2)
    omega = 2 * math.pi * plant.gantry.hz(0, 0.2)
    assert abs(seen[:, 0]).max() == pytest.approx(omega**2 * abs(off[:, 0]).max(), rel=0.1)
    assert seen[:, 2] == pytest.approx(GRAVITY, abs=1e-5)


def test_samples_clip_and_their_stamps_follow_each_other() -> None:
    plant = cell(on=True, sensor_range=1.0)
    plant.sensing = True
    times, counts = [], []
    for i in range(20):
        plant.step(moving(0.2 + 0.001 * np.arange(10) * (i % 2)), 1_000_000 + 10_000 * (i + 1))
        found = plant.accelerations()
        assert found is not None and abs(found.values).max() <= 1.0
        times.append(found.time_ns)
        counts.append(len(found.values))
    assert np.diff(times) == pytest.approx(np.array(counts[:-1]) * 1e9 / 3200, abs=2)


def test_the_metal_follows_the_swing() -> None:
    """The same outputs lay other metal when the axes swing."""
    laid = []
    for on in (False, True):
        plant = cell(on=on, x_hz=12.0, x_damping=0.01)
        samples = moving(np.repeat(0.115 + 0.002 * (np.arange(20) % 2), 100))
        samples['table_y'], samples['tool_z'] = -0.095, 0.03
        samples['wire_cmd'], samples['voltage_set'], samples['outputs'] = 0.08, 22.0, 3
        for i in range(0, len(samples), 10):
            plant.step(samples[i : i + 10], 1_000_000 + 1000 * (i + 10))
        laid.append(plant.metal.z.copy())
    assert abs(laid[1] - laid[0]).max() > 1e-5


def test_one_seed_gives_one_run() -> None:
    assert random_state(3, 6) != random_state(4, 6)
    runs = []
    for _ in range(2):
        plant = cell(on=True)
        plant.sensing = True
        runs.append(live(plant, stop(60))[1])
    assert np.array_equal(*runs)
