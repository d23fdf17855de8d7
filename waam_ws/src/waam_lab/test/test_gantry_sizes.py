"""Whole jobs on gantries of other sizes: plan, job and refusal go by the reach that the controller was told."""

from __future__ import annotations

import pytest

from waam_lab import restore, run

LARGE = {
    'envelope_x': 3.0, 'envelope_y': 3.0, 'envelope_z': 2.0, 'max_speed_x': 0.5, 'max_speed_y': 0.5, 'rapid_speed': 0.5,
    'home_direction_y': 1, 'steps_per_mm_x': 150.0, 'steps_per_mm_y': 150.0, 'max_accel_z': 0.1,
}  # fmt: skip
SMALL = {'envelope_x': 0.13, 'envelope_y': 0.12, 'envelope_z': 0.1}
FAR = (2.8, 2.7, 1.5)


def job(parts, folder, bridge: dict, zero: tuple[float, float, float]):
    overrides = {
        'bridge': bridge,
        'cell': {'work_zero': list(zero)},
        'job_sequencer': {'work_offset': list(zero)},
    }
    return restore(*parts, seed=3, preset='gentle', jobs_dir=folder, overrides=overrides)


def test_a_small_part_far_out_on_a_large_gantry(parts, tmp_path):
    result = run(job(parts, tmp_path, LARGE, FAR))
    assert result.error_code == 0, result.message
    assert result.layers >= 1 and abs(result.layer_means[-1]) < 0.3e-3


@pytest.mark.parametrize(('gantry', 'zero'), [({}, FAR), (SMALL, (0.1, 0.1, 0.02))])
def test_a_part_that_does_not_fit_is_refused_by_axis_place_and_limit(parts, tmp_path, gantry, zero):
    result = run(job(parts, tmp_path, gantry, zero))
    assert result.error_code != 0 and result.layers == 0
    assert 'outside the machine' in result.message
    assert 'its limit in the work frame is' in result.message
