"""What a plan of a restoration warns of: where it is true, with place and area, and nowhere else."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.layers.restore import plan_restoration
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid

S = PlanSettings()
SPEC = GridSpec.covering(-3e-3, -3e-3, 63e-3, 53e-3, 0.5e-3)
X, Y = np.meshgrid(SPEC.x * 1e3, SPEC.y * 1e3)  # mm
INSIDE = (X > 0) & (X < 60) & (Y > 0) & (Y < 50)


def grid(z: np.ndarray, noise: float = 0.0, seed: int = 0) -> HeightGrid:
    """From mm, NaN off the part; noise in mm."""
    z = z + np.random.default_rng(seed).normal(0, noise, z.shape) if noise else z
    return HeightGrid(SPEC, np.where(INSIDE, z, np.nan) * 1e-3)


def boss(worn: float = 0.0, aside: float = 0.0, wider: float = 0.0) -> np.ndarray:
    """A boss of 30 mm with a blind bore of 12 on a plate: walls of 18 mm on every side."""
    r = np.hypot(X - 30 - aside, Y - 25)
    top = 30.0 - worn - (0.03 * (X - 30) if worn else 0.0)
    return np.where((r < 15 + wider) & (r > 6 - wider), top, 12.0)


def keyway(filled: bool, deep: float = 6.0, bevel: float = 0.0) -> np.ndarray:
    """A slot of 12 mm with round ends in a block, its edges broken."""
    away = np.hypot(X - np.clip(X, 18, 42), Y - 25)
    edge = np.where(away < 6 + bevel, 30 - 0.9 * (bevel > 0), 30.0)
    return np.full(X.shape, 30.0) if filled else np.where(away < 6, 30 - deep, edge)


def warned(nominal: np.ndarray, found: np.ndarray, noise: float = 0.03, seed: int = 0) -> list[str]:
    plan = plan_restoration(grid(found, noise, seed), grid(nominal), S)
    assert plan.layers
    return [w for w in plan.warnings if 'above nominal' in w or 'stay missing' in w]


@given(st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.floats(2.5, 6), st.integers(0, 99))
@settings(max_examples=12, deadline=None)
def test_a_wall_that_is_a_cell_aside_is_neither_a_hump_nor_a_gap(aside, wider, worn, seed):
    assert warned(boss(), boss(worn, aside, wider), seed=seed) == []


@given(st.floats(2.5, 7), st.floats(0, 2.0), st.integers(0, 99))
@settings(max_examples=8, deadline=None)
def test_a_slot_with_broken_edges_is_filled_without_alarm(deep, bevel, seed):
    assert warned(keyway(True), keyway(False, deep, bevel), seed=seed) == []


def test_an_edge_that_falls_off_to_the_floor_is_no_gap():
    z = np.where((X < 0.9) | (Y > 49.2), 2.0, keyway(True) - 4)
    assert warned(keyway(True), z) == []


@pytest.mark.parametrize(('x', 'y', 'r', 'high'), [(20, 15, 4, 3.0), (45, 30, 2.5, 1.2)])
def test_a_hump_is_told_with_its_place_and_area(x, y, r, high):
    hump = np.hypot(X - x, Y - y) < r
    z = np.where(hump, 30 + high, keyway(True) - 4)
    (text,) = warned(keyway(True), z, 0.0)
    found = re.search(
        r'up to ([\d.]+) mm .*on (\d+) mm2 around x = ([\d.]+) mm, y = ([\d.]+) mm', text
    )
    told, area, at_x, at_y = map(float, found.groups())
    assert told == pytest.approx(high, abs=0.01)
    assert area == pytest.approx(hump.sum() * 0.25, abs=1.0)
    assert np.hypot(at_x - x, at_y - y) <= r


def test_a_hump_on_the_boss_is_told_beside_its_walls():
    z = np.where(np.hypot(X - 40, Y - 25) < 2.5, 33.0, boss(4.0, 0.3))
    (text,) = warned(boss(), z)
    assert 'stands up to 3.' in text and re.search(r'x = (3[89]|4[012])', text)


def test_a_pit_that_the_layers_cannot_fill_is_told_with_its_place():
    pit = np.hypot(X - 20, Y - 20) < 2.5  # too narrow for layers of its own
    (text,) = warned(keyway(True), np.where(pit, 20.0, keyway(True) - 1), 0.0)
    assert re.search(r'thickest layer limits the metal; \d\.\d\d mm stay missing, on \d+ mm2', text)
    assert re.search(r'x = (1[89]|2[0-2])\.\d mm, y = (1[89]|2[0-2])', text)


def test_metal_beside_what_is_needed_is_no_warning():
    """A bolt head and a clamp beside the part."""
    z = keyway(True) - 4
    found = grid(z)
    beside = np.where(~INSIDE & (X > 60.5), 0.055, found.z)
    plan = plan_restoration(HeightGrid(SPEC, beside), grid(keyway(True)), S)
    assert not plan.warnings
