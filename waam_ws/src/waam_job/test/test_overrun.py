"""How far metal stands over the sides of a part."""

from __future__ import annotations

import numpy as np
import pytest

from waam_job.model.overrun import overrun

RES = 0.5e-3
PART = np.zeros((40, 60), bool)
PART[10:30, 10:50] = True
PLATE = np.zeros(PART.shape)
BLOCK = np.where(PART, 0.020, 0.0)


def test_a_clean_side_has_no_overrun():
    found = overrun(PLATE, BLOCK, PART, PART, RES)
    assert found.mean == found.max == 0.0


def test_overrun_is_the_distance_to_the_farthest_metal_beside_the_part():
    after = BLOCK.copy()
    after[10:30, 50:53] = 0.018  # 1.5 mm over one of four sides
    found = overrun(PLATE, after, PART, PART, RES)
    assert found.max == pytest.approx(1.5e-3)
    assert 0.1 * found.max < found.mean < 0.5 * found.max


def test_sides_without_new_metal_do_not_count():
    after = BLOCK.copy()
    after[:, 50:53] = 0.018
    left = PART.copy()
    left[:, 25:] = False
    assert overrun(PLATE, after, PART, left, RES).max == 0.0


def test_what_stood_there_before_is_no_overrun():
    fixture = PLATE.copy()
    fixture[:, 51:] = 0.030
    assert overrun(fixture, np.fmax(BLOCK, fixture), PART, PART, RES).max == 0.0


def test_unseen_ground_before_the_job_is_as_high_as_what_was_seen_beside_it():
    before = PLATE.copy()
    before[:, 50:54] = np.nan
    after = BLOCK.copy()
    after[10:30, 50:52] = 0.018
    assert overrun(before, after, PART, PART, RES).max == pytest.approx(1.0e-3)


@pytest.mark.parametrize('part', [np.ones_like(PART), np.zeros_like(PART)])
def test_without_sides_there_is_nothing_to_tell(part):
    assert np.isnan(overrun(PLATE, BLOCK, part, part, RES).max)


def test_sides_that_nobody_saw_are_not_told():
    after = np.where(PART, BLOCK, np.nan)
    assert np.isnan(overrun(PLATE, after, PART, PART, RES).max)
