"""A machined finish: what needs metal, what gets none, and the allowance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_plan import finish
from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration, plan_top_up
from waam_plan.mesh.part import load_part
from waam_plan.mesh.stl import read_stl, stl_of
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.grid import HeightGrid

S = PlanSettings(tolerance=0.2e-3, finish='machined', bead_width=5e-3)


def dished(x, y):
    """3 mm deep in the middle of the block, a shelf of 0.2 mm around it, nothing beyond."""
    away = np.maximum(abs(x - 0.030), abs(y - 0.020))
    return np.where(away < 0.008, 0.003, np.where(away < 0.012, 0.2e-3, 0.0))


def test_noise_level_and_single_lines_of_cells_need_no_metal(worn_block):
    found, nominal = worn_block(lambda x, y: np.where(x < 0.030, 0.09e-3, 0.0))
    assert not finish.needed_area(found, nominal).any()
    found, nominal = worn_block(lambda x, y: np.where(abs(x - 0.03025) < 0.4e-3, 2e-3, 0.0))
    assert not finish.needed_area(found, nominal).any()
    found, nominal = worn_block(lambda x, y: np.where(x < 0.030, 0.15e-3, 0.0))
    x, _ = np.meshgrid(found.spec.x, found.spec.y)
    needed = finish.needed_area(found, nominal)
    part = np.isfinite(nominal.z)
    assert needed[part & (x < 0.028)].mean() > 0.99 and not needed[x > 0.0305].any()


def test_what_as_laid_leaves_out_is_named_and_a_machined_finish_lays_it(worn_block):
    found, nominal = worn_block(dished)
    plan = plan_restoration(found, nominal, replace(S, finish='as-laid'))
    told = [w for w in plan.warnings if 'get no metal' in w]
    assert len(told) == 1
    needed = finish.needed_area(found, nominal)
    left = finish.unlaid(needed, plan.region, nominal.z - found.z, nominal.spec)
    assert left.area == pytest.approx(24e-3**2 - 16e-3**2, rel=0.15)
    assert left.share == pytest.approx(1 - (16 / 24) ** 2, abs=0.08)
    row, col = found.spec.cell(left.x, left.y)
    assert needed[row, col] and not plan.region[row, col]
    assert left.depth == pytest.approx(nominal.z[row, col] - found.z[row, col])
    assert left.text in told
    machined = plan_restoration(found, nominal, S)
    assert not any('get no metal' in w for w in machined.warnings)
    assert machined.region[needed].all()


def test_the_allowance_is_laid_on_the_needed_area_and_its_run_out_only(worn_block):
    found, nominal = worn_block(dished)
    plan = plan_restoration(found, nominal, S)
    chosen = plan.settings.allowance
    assert chosen == finish.forecast(plan_thickness(plan)).allowance > 0.3e-3
    np.testing.assert_allclose((plan.final_target - nominal.z)[plan.region], chosen, atol=1e-9)
    x, y = np.meshgrid(found.spec.x, found.spec.y)
    away = np.maximum(abs(x - 0.030), abs(y - 0.020))
    assert plan.region[away < 0.0135].all() and not plan.region[away > 0.0155].any()
    assert any(f'{chosen * 1e3:.2f} mm, chosen' in r for r in plan.remarks)


def plan_thickness(plan) -> float:
    """m, of the last layer where it is not the lowest."""
    return float(np.median(plan.layers[-1].planned[plan.layers[0].footprint]))


def test_a_given_allowance_is_taken_and_said_what_it_would_do(worn_block):
    found, nominal = worn_block(dished)
    plan = plan_restoration(found, nominal, replace(S, allowance=0.2e-3))
    np.testing.assert_allclose((plan.final_target - nominal.z)[plan.region], 0.2e-3, atol=1e-9)
    ahead = finish.forecast(plan_thickness(plan))
    (told,) = [r for r in plan.remarks if 'allowance' in r]
    assert '0.20 mm, as given' in told and f'{ahead.chance(0.2e-3):.0%}' in told
    assert f'{ahead.allowance * 1e3:.2f} mm for 95%' in told


def test_more_is_laid_along_free_sides(worn_block):
    found, nominal = worn_block(0.002)
    plan = plan_restoration(found, nominal, S)
    above = plan.final_target - nominal.z
    row, cols = found.spec.rows // 2, np.flatnonzero(np.isfinite(nominal.z[found.spec.rows // 2]))
    base = plan.settings.allowance
    assert above[row, cols[0]] == pytest.approx(
        base + finish.SIDE_EXTRA, abs=0.15 * finish.SIDE_EXTRA
    )
    assert above[row, cols[len(cols) // 2]] == pytest.approx(base, abs=1e-6)
    assert np.nanmax(above) > base + 1.2 * finish.SIDE_EXTRA  # at a corner
    assert plan.settings.overrun == finish.MIN_OVERRUN


def test_what_the_scan_saw_from_the_side_is_no_needed_area(worn_block):
    """Only along a free side: a hole that deep in the face is wear."""
    found, nominal = worn_block(0.002)
    cols = np.flatnonzero(np.isfinite(nominal.z[found.spec.rows // 2]))
    rows = slice(found.spec.rows // 2 - 3, found.spec.rows // 2 + 3)
    before = finish.needed_area(found, nominal)
    assert before[rows, cols[0]].all() and before[rows, cols[8]].all()
    seen = found.z.copy()
    seen[rows, cols[0]] = np.nan
    seen[rows, cols[-1]] -= 3e-3
    seen[rows, cols[8]] -= 3e-3
    after = finish.needed_area(HeightGrid(found.spec, seen), nominal)
    assert not after[rows, cols[0]].any() and not after[rows, cols[-1]].any()
    assert after[rows, cols[8]].all() and (before & ~after).sum() == 12


def test_a_thin_part_between_free_sides_is_said_not_to_clean_up(worn_block):
    found, nominal = worn_block(0.002)
    needed = finish.needed_area(found, nominal)
    wide = finish.edges(needed, nominal)
    x, y = np.meshgrid(found.spec.x, found.spec.y)
    row = found.spec.rows // 2
    size = np.isfinite(nominal.z[row]).sum(), np.isfinite(nominal.z[:, found.spec.cols // 2]).sum()
    assert wide.share == pytest.approx(2 * (size[0] + size[1] - 2) / (size[0] * size[1]), rel=0.1)
    assert not wide.warning
    wall = np.where(abs(y - y[row, 0]) < 2.3e-3, nominal.z, np.nan)
    thin = HeightGrid(nominal.spec, wall)
    plan = plan_restoration(HeightGrid(found.spec, wall - 0.002), thin, S)
    (told,) = [w for w in plan.warnings if 'will not clean up' in w]
    assert 'along its free sides' in told
    as_laid = replace(S, finish='as-laid')
    plan = plan_restoration(HeightGrid(found.spec, wall - 0.002), thin, as_laid)
    assert not any('will not clean up' in w for w in plan.warnings)


def test_the_smallest_allowance_with_its_chance():
    ahead = finish.forecast(1e-3)
    assert ahead.chance(ahead.allowance) == pytest.approx(finish.CLEAN_UP_PROBABILITY, abs=0.01)
    assert ahead.chance(ahead.allowance - 0.02e-3) < finish.CLEAN_UP_PROBABILITY
    assert ahead.chance(ahead.depth) == pytest.approx(0.5) and ahead.chance(0.0) == 0.0
    assert finish.forecast(2e-3).allowance > 1.9 * ahead.allowance


def test_a_run_out_ends_at_a_step_of_the_part():
    nominal = np.full((5, 20), 0.010)
    nominal[:, 10:] = 0.006
    needed = np.zeros(nominal.shape, bool)
    needed[:, 5:9] = True
    wide = finish.with_run_out(needed, nominal, 4)
    assert wide[2, 1:10].all() and not wide[:, 10:].any() and not wide[2, 0]
    sides = finish.free_sides(needed | wide, nominal)
    assert sides[:, 10:].all() and not sides[:, :10].any()
    slope = np.broadcast_to(0.010 - 0.5e-3 * np.arange(20), nominal.shape)
    assert not finish.free_sides(needed, slope).any()


def test_a_build_refuses_it(box_file):
    with pytest.raises(PlanError, match='finish machined: only a restoration'):
        plan_build(load_part(box_file(), 1e-3), PlanSettings(finish='machined'))


def test_heights_become_an_stl_that_is_open_where_nothing_was_seen(worn_block):
    _, nominal = worn_block(0.0)
    grid: HeightGrid = nominal
    corners, _ = read_stl(stl_of(grid.spec.x * 1e3, grid.spec.y * 1e3, grid.z * 1e3))
    cells = np.isfinite(grid.z)
    squares = (cells[:-1, :-1] & cells[:-1, 1:] & cells[1:, :-1] & cells[1:, 1:]).sum()
    assert corners.shape == (2 * squares, 3, 3) and np.allclose(corners[..., 2], 30.0)
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (up > 0).all()


def restored(worn_block, low):
    """A block 0.7 mm above nominal but for `low`(x, y), where it is 0.2 mm below it."""
    found, nominal = worn_block(dished)
    x, y = np.meshgrid(nominal.spec.x, nominal.spec.y)
    cells = low(x, y) & np.isfinite(nominal.z)
    z = np.where(cells, nominal.z - 0.2e-3, nominal.z + 0.7e-3)
    return replace(found, z=np.where(np.isfinite(nominal.z), z, found.z)), nominal, cells, x, y


def test_a_top_up_lays_a_bead_on_what_is_low_and_around_it(worn_block):
    surface, nominal, low, x, y = restored(
        worn_block, lambda x, y: np.hypot(x - 0.030, y - 0.020) < 1e-3
    )
    plan = plan_top_up(surface, nominal, S, low, 4, None)
    assert len(plan.layers) == 1 and plan.region[low].all() and not plan.warnings
    away = np.hypot(x - 0.030, y - 0.020)
    assert (away[plan.region] < 1e-3 + 1.5 * 0.75 * S.bead_width + 0.5e-3).all()
    assert plan.layers[0].planned[low].min() > 0.2e-3
    assert (plan.final_target[low] > nominal.z[low]).all()


def test_a_top_up_along_a_free_side_runs_over_it_and_leaves_humps_alone(worn_block):
    surface, nominal, low, x, y = restored(worn_block, lambda x, y: y < 0.4e-3)
    hump = (x < 0.020) & ~low
    surface.z[hump & np.isfinite(nominal.z)] += 3e-3
    plan = plan_top_up(surface, nominal, S, low, 4, None)
    assert plan.region[low & (x > 0.024)].mean() > 0.9 and not plan.region[hump].any()
    assert min(s.start[1] for s in plan.layers[0].deposits) < 2e-3
