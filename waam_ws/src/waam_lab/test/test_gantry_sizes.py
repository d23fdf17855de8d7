"""Whole jobs on gantries of other sizes: the reach is what the controller was told, for plan, job and refusal alike."""

from __future__ import annotations

import pytest
from test_program_job import goal, pad  # noqa: F401  (a fixture)

from waam_job.model.goal import JobGoal
from waam_lab import run
from waam_lab.job import LabJob

LARGE = {
    'envelope_x': 3.0, 'envelope_y': 3.0, 'envelope_z': 2.0, 'max_speed_x': 0.5, 'max_speed_y': 0.5, 'rapid_speed': 0.5,
    'home_direction_y': 1, 'steps_per_mm_x': 150.0, 'steps_per_mm_y': 150.0, 'max_accel_z': 0.1,
}  # fmt: skip
SMALL = {'envelope_x': 0.13, 'envelope_y': 0.12, 'envelope_z': 0.1}
FAR = (2.8, 2.7, 1.5)


def cell(bridge: dict, zero: tuple[float, float, float]) -> dict:
    return {
        'bridge': bridge,
        'cell': {'work_zero': list(zero)},
        'job_sequencer': {'work_offset': list(zero)},
    }


def worn(parts, folder) -> JobGoal:
    return JobGoal(part=parts[0], material='er70s-6', jobs_dir=folder, mode='restore')


def job(goal: JobGoal, overrides: dict, **more) -> LabJob:
    return LabJob(goal, seed=3, preset='gentle', overrides=overrides, **more)


def test_a_small_part_far_out_on_a_large_gantry(parts, tmp_path):
    result = run(job(worn(parts, tmp_path), cell(LARGE, FAR), scan=parts[1]))
    assert result.error_code == 0, result.message
    assert result.layers >= 1 and result.rms < 0.35e-3


def test_the_same_place_is_beyond_a_usual_gantry(parts, tmp_path):
    result = run(job(worn(parts, tmp_path), cell({}, FAR), scan=parts[1]))
    assert result.error_code != 0 and 'outside the machine' in result.message
    assert 'its limit in the work frame is' in result.message


def test_a_small_gantry_refuses_a_part_that_does_not_fit(parts, tmp_path):
    result = run(job(worn(parts, tmp_path), cell(SMALL, (0.1, 0.1, 0.02)), scan=parts[1]))
    assert result.error_code != 0 and 'outside the machine' in result.message, result.message


@pytest.mark.parametrize('x', [64, 900])
def test_a_program_beyond_the_reach_is_refused_with_line_and_word(goal, x):  # noqa: F811
    goal.program.write_text(pad(1).replace('X64', f'X{x}'))
    result = run(job(goal, cell(LARGE | {'envelope_x': 0.5}, (0.1, 2.7, 1.5))))
    if x == 64:
        assert result.error_code == 0, result.message
    else:
        assert 'X900' in result.message and 'line ' in result.message
        assert 'x = 900.0 mm, its limit in the work frame is 400.0 mm' in result.message
