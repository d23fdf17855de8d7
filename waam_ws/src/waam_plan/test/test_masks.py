"""What is judged, what may overrun the sides, and how values reach there. Cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_plan import masks

BEAD, RIM = 12.0, 2.0  # cells of 0.5 mm: a bead of 6 mm, a rim of 1 mm


def strip(width: int, length: int = 60) -> np.ndarray:
    mask = np.zeros((width + 20, length + 20), bool)
    mask[10 : 10 + width, 10 : 10 + length] = True
    return mask


def test_all_but_the_rim_is_judged():
    mask = strip(40)
    judged = masks.judged(mask, RIM, BEAD)
    expected = np.zeros_like(mask)
    expected[12:48, 12:68] = True
    assert np.array_equal(judged, expected)


def test_a_wall_of_one_bead_is_judged_along_its_crown():
    judged = masks.judged(strip(12), RIM, BEAD)
    rows = np.flatnonzero(judged.any(axis=1))
    assert judged.any() and len(rows) == 4  # a quarter of the bead (3 cells), whole cells
    assert rows.mean() == pytest.approx(10 + 5.5)
    assert judged[rows].sum() > 0.7 * 60 * len(rows)


@pytest.mark.parametrize('width', [1, 2, 3, 5, 8, 12, 13, 20, 40])
def test_no_wall_is_too_thin_to_be_judged(width):
    assert masks.judged(strip(width), RIM, BEAD).any()


@given(st.integers(1, 50), st.integers(20, 70), st.floats(0, 4))
def test_only_what_was_laid_is_judged(width, length, rim):
    mask = strip(width, length)
    assert not (masks.judged(mask, rim, BEAD) & ~mask).any()


def test_nothing_is_judged_where_nothing_was_laid():
    assert not masks.judged(np.zeros((20, 20), bool), RIM, BEAD).any()


def test_metal_overruns_only_free_sides():
    mask = strip(20)
    free = np.zeros_like(mask)
    free[:10] = True
    wider = masks.overrun(mask, free, 3)
    assert wider[7:10, 12:68].all() and not wider[:7].any()
    assert np.array_equal(wider[10:], mask[10:])
    assert np.array_equal(masks.overrun(mask, free, 0), mask)


def test_cells_beside_the_mask_take_the_value_of_the_nearest_one():
    mask = strip(4)
    values = np.where(mask, np.arange(mask.shape[0])[:, None], 0.0)
    wider = masks.overrun(mask, ~mask, 3)
    out = masks.spread(values, mask, wider)
    assert (out[7:10, 20] == 10).all() and (out[14:17, 20] == 13).all()
    assert (out[~wider] == 0).all() and np.array_equal(out[mask], values[mask])


def test_cells_on_a_steep_face_are_flanks_and_those_at_its_edges_are_not():
    z = np.zeros((6, 12))
    z[:, 6:] = -8.0
    assert not masks.flanks(z, 0.5).any()  # an upright face has no cells of its own
    z[:, 5:7] = [-2.0, -5.0]
    assert np.array_equal(np.flatnonzero(masks.flanks(z, 0.5).all(axis=0)), [5, 6])
    assert masks.flanks(z, 0.5).sum() == 12
    assert np.array_equal(masks.flanks(z.T, 0.5), masks.flanks(z, 0.5).T)


def test_a_slope_that_is_no_flank_and_what_is_unknown_beside():
    z = np.arange(12.0)[None] * 0.5 * np.ones((4, 1))  # 45 deg
    assert not masks.flanks(z, 0.5).any()
    z = z * 4
    z[:, :4] = np.nan
    assert np.array_equal(np.flatnonzero(masks.flanks(z, 0.5)[0]), np.arange(4, 12))
