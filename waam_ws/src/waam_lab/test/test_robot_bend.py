"""The bend of a measured map as predicted, against simulated robots with the same stated errors."""

from __future__ import annotations

import numpy as np
import pytest

from waam_robot.bend import bend
from waam_robot.station import Station
from waam_robot.uncertain import Stated
from waam_sim.robot import RobotParams, SimRobot

STATION, TAUGHT, BESIDE = Station(), np.array([0.1, 0.08, 0.02]), np.array([0.06, 0.0, 0.0])


def places(x: float, y: float) -> np.ndarray:
    grid = np.meshgrid(np.linspace(0, x, 5), np.linspace(0, y, 4), [0.02])
    return np.stack(grid, -1).reshape(-1, 3) + TAUGHT


@pytest.mark.parametrize('size', [(0.1, 0.06), (0.25, 0.2)])
def test_predicted_as_simulated_robots_bend_it(size):
    tips = places(*size)
    told = bend(STATION, tips, TAUGHT, BESIDE)
    joints, params = STATION.joints(tips), RobotParams(backlash=0.0)
    off = []
    for seed in range(1, 31):
        robot = SimRobot(STATION, params, seed, TAUGHT, TAUGHT, 0)
        off.append([robot.height_error(row) for row in joints])
    rms = np.sqrt(np.mean(np.square(off)))
    assert told.rms == pytest.approx(rms, rel=0.25)
    assert (
        1.2 * told.rms < told.largest < 3 * told.rms and str(round(told.rms * 1e3, 3)) in told.text
    )


def test_none_where_it_was_taught_and_in_proportion_to_the_errors():
    assert bend(STATION, TAUGHT[None], TAUGHT, BESIDE).rms < 1e-12
    tips = places(0.1, 0.06)
    once, twice = (
        bend(STATION, tips, TAUGHT, BESIDE, Stated(n * 3e-4, n * 1e-4, n * 1e-4)).rms
        for n in (1, 2)
    )
    assert twice == pytest.approx(2 * once, rel=1e-3)
