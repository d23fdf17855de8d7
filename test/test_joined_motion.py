"""The general harmonic law as motion: what the motors of the real controller core do, not what the formula says."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "test"), str(ROOT / "waam_ws/src/waam_calibrate/test")]


@pytest.fixture(scope='module')
def driven() -> dict:
    from joined import drive
    from shaken import POINT, Shaker

    from waam_sim.gantry import GantryParams

    with Shaker(GantryParams()) as shaker:
        return {how: drive(shaker, how, POINT) for how in ('law', 'plain')}


def greatest(place: np.ndarray, derivative: int) -> float:
    """Of the places (m, one per ms): greatest derivative, each difference smoothed over 20 ms."""
    for _ in range(derivative):
        place = np.convolve(np.diff(place) / 1e-3, np.ones(20) / 20, mode='valid')
    return float(np.abs(place).max())


def test_the_ends_that_were_given_are_met_at_the_steps(driven):
    """From 10 mm/s to a joint with 0.08 m/s2, from there to no acceleration: the speed of the motors is the law's."""
    assert driven['law'].speed_error() < 0.01
    assert driven['plain'].speed_error() > 0.2


def test_neither_acceleration_nor_jerk_jumps_at_the_steps(driven):
    from joined import TIMES, laws

    t = np.linspace(0, 1, 1000)
    pairs = list(zip(laws(), TIMES, strict=True))
    most = max(float(np.abs(law.acceleration(t * end)).max()) for law, end in pairs)
    jerk = max(
        float(np.abs(np.gradient(law.acceleration(t * end), t * end)).max()) for law, end in pairs
    )
    assert greatest(driven['law'].place, 2) < 1.15 * most
    assert greatest(driven['law'].place, 3) < 3 * jerk
    assert greatest(driven['plain'].place, 3) > 10 * greatest(driven['law'].place, 3)
