"""Metal per piece: the pieces together lay the map."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.fill import path
from waam_plan.layers.allocate import footprints, metal_heights, pool_places
from waam_plan.settings import PlanSettings
from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec, HeightGrid

S = PlanSettings(pool_trail=0.0)
SPEC = GridSpec.covering(0.0, 0.0, 0.06, 0.04, 0.5e-3)


def straight(length=0.03, pieces=15):
    x = np.linspace(0.01, 0.01 + length, pieces + 1)
    points = np.column_stack([x, np.full(pieces + 1, 0.02), np.zeros(pieces + 1)])
    return path.Pieces(points[:-1], points[1:], np.ones(pieces, int), np.zeros(pieces, int))


def hatched(planned, s=S):
    mask = planned > 0
    chains, _ = path.hatch_region(mask, SPEC, s, 1)
    pieces = path.lay_out(chains, HeightGrid.full(SPEC, 0.0), s)
    return pieces, metal_heights(pieces, planned, mask, SPEC, s)


def block(height=0.002):
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    return np.where((x > 0.01) & (x < 0.05) & (y > 0.008) & (y < 0.032), height, 0.0)


def laid(pieces, height):
    volume = AREA_FACTOR * S.bead_width * height * pieces.length
    return (footprints(pieces, SPEC, S) @ volume).reshape(SPEC.shape) / SPEC.resolution**2


def test_footprints_keep_the_metal_and_are_one_bead_wide():
    spread = footprints(straight(), SPEC, S)
    np.testing.assert_allclose(spread.sum(axis=0), 1.0)
    touched = (spread.sum(axis=1).reshape(SPEC.shape) > 0).any(axis=1).sum() * SPEC.resolution
    assert touched == pytest.approx(S.bead_width, abs=2 * SPEC.resolution)


def test_the_pool_trails_along_the_chain_and_stays_at_its_start():
    places = pool_places(straight(), 0.005)
    assert places[0, 0] == pytest.approx(0.010)
    assert places[-1, 0] == pytest.approx(0.04 - 0.005, abs=1e-3)
    assert (np.diff(places[:, 0]) >= 0).all()


@given(st.floats(0.0012, 0.0024), st.floats(-10, 10), st.floats(-10, 10))
@settings(max_examples=15, deadline=None)
def test_volume_is_kept_and_the_middle_is_met(height, slope_x, slope_y):
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    planned = block(height) * (1 + slope_x * (x - 0.03) + slope_y * (y - 0.02))
    pieces, h = hatched(planned)
    total = planned.sum() * SPEC.resolution**2
    assert np.sum(AREA_FACTOR * S.bead_width * h * pieces.length) == pytest.approx(total, rel=0.01)
    deep = (x > 0.018) & (x < 0.042) & (y > 0.014) & (y < 0.026)
    error = laid(pieces, h)[deep] / planned[deep] - 1
    assert abs(error.mean()) < 0.05 and error.std() < 0.12


def test_turns_carry_less_than_straight_beads():
    pieces, h = hatched(block())
    turn = abs(pieces.end[:, 1] - pieces.start[:, 1]) > abs(pieces.end[:, 0] - pieces.start[:, 0])
    assert turn.any()
    assert h[turn].mean() < 0.75 * h[~turn].mean()
    flat = np.full(len(h), h.mean())
    inner = block() > 0
    assert np.std(laid(pieces, h)[inner]) < np.std(laid(pieces, flat)[inner])
