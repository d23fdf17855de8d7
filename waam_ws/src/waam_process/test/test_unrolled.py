"""A shaft and its unrolled plate: there and back, volume, and the seam."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waam_process.grid import GridSpec, HeightGrid
from waam_process.unrolled import OVERLAP, STEP, ShaftError, Unrolled

SHAFTS = [Unrolled(d) for d in (0.030, 0.040, 0.0801, 0.200)]


@pytest.mark.parametrize('shaft', SHAFTS)
def test_points_there_and_back(shaft):
    rng = np.random.default_rng(3)
    t, y, r = (
        rng.uniform(0, 2 * math.pi, 50),
        rng.uniform(0, 0.2, 50),
        shaft.radius + rng.uniform(-4e-3, 3e-3, 50),
    )
    points = np.column_stack([r * np.sin(t), y, r * np.cos(t)])
    plate = shaft.unroll(points)
    assert np.allclose(shaft.points(plate), points, atol=1e-12)
    assert np.allclose(plate[:, 2] - shaft.level, r - shaft.radius, atol=1e-12)
    assert np.allclose(np.radians(shaft.degrees(plate[:, 0])), t, atol=1e-9)
    assert np.allclose(shaft.x_of(shaft.degrees(plate[:, 0])), plate[:, 0], atol=1e-12)
    again = plate + (3 * shaft.period, 0.0, 0.0)  # three turns on it is the same point
    assert np.allclose(shaft.points(again), points, atol=1e-12)
    assert np.allclose(shaft.folded(again[:, 0]), plate[:, 0], atol=1e-12)


@pytest.mark.parametrize('shaft', SHAFTS)
def test_metal_of_the_plate_is_that_of_the_ring(shaft):
    low, high, length = shaft.level - 3e-3, shaft.level + 1e-3, 0.05
    ring = math.pi * (shaft.radius_at(high) ** 2 - shaft.radius_at(low) ** 2) * length
    middle = shaft.share((low + high) / 2)
    assert shaft.period * length * (high - low) * middle == pytest.approx(ring, rel=1e-12)
    whole = shaft.period * length * shaft.level
    assert whole == pytest.approx(math.pi * shaft.radius**2 * length, rel=0.02)


@pytest.mark.parametrize('shaft', SHAFTS)
def test_a_turn_is_a_whole_number_of_cells(shaft):
    for cell in (0.4e-3, 0.5e-3, STEP):
        assert shaft.period / cell == pytest.approx(round(shaft.period / cell), abs=1e-9)
        spec = GridSpec(-5e-3, 0.0, cell, 3, round((shaft.length_x + 10e-3) / cell))
        assert shaft.first_turn(spec).sum() == round(shaft.period / cell)


def test_a_turn_comes_round_on_the_plate():
    shaft, cell = Unrolled(0.04), 0.5e-3
    count = round(shaft.period / cell)
    turn = HeightGrid(
        GridSpec(OVERLAP, 0.0, cell, 2, count), np.arange(2.0 * count).reshape(2, count)
    )
    spec = GridSpec(0.0, 0.0, cell, 2, round(shaft.length_x / cell))
    z = shaft.wrapped(turn, spec).z
    first = shaft.first_turn(spec)
    assert np.array_equal(z[:, first], turn.z)
    aside = round(OVERLAP / cell)
    assert np.array_equal(z[:, :aside], turn.z[:, -aside:])
    assert np.array_equal(z[:, -aside:], turn.z[:, :aside])
    with pytest.raises(ShaftError, match='is not one turn'):
        shaft.wrapped(turn, GridSpec(0.0, 0.0, 2 * cell, 2, 100))


def test_a_thin_shaft_is_refused():
    with pytest.raises(ShaftError, match='29 mm, must be at least 30 mm'):
        Unrolled(0.029)
