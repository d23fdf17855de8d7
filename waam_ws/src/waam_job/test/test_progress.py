"""Share of the job and time left, as the client sees them."""

from __future__ import annotations

import numpy as np
import pytest

from waam_job.model.records import State


def told(cell) -> tuple[np.ndarray, np.ndarray, list]:
    """Progress, time left (s, NaN = not known) and what was laid, at every status while metal is laid."""
    seen = [s for s in cell.statuses if s.state == State.DEPOSITING]
    return np.array([s.progress for s in seen]), np.array([s.time_left for s in seen]), seen


@pytest.mark.parametrize('fields', [{}, {'passes': 2}, {'layers': 1}, {'loop_mode': 'open_loop'}])
def test_progress_is_the_share_of_arc_time_and_never_goes_back(fields, make_cell, make_runner):
    cell = make_cell(efficiency=0.75)
    cell.pace = 1
    runner, _, _ = make_runner(cell, **fields)
    assert runner.run().state == State.DONE
    progress, _, seen = told(cell)
    assert (progress >= 0).all() and (progress <= 1).all() and (np.diff(progress) >= 0).all()
    assert progress[-1] == pytest.approx(1.0, abs=1e-6) and cell.statuses[-1].progress == 1.0
    layers = np.array([s.layer for s in seen])
    share = runner.context.program.layer(1).arc_time / sum(
        runner.context.program.layer(k).arc_time for k in range(1, runner.status.layers + 1)
    )
    # a second pass that is thicker than the first plan had said shifts the end of layer 1 a little
    assert progress[layers == 1][-1] == pytest.approx(
        share, abs=0.05 if 'passes' in fields else 1e-6
    )


def test_time_left_shrinks_to_nothing(make_cell, make_runner):
    cell = make_cell()
    cell.pace = 1
    inner, at = cell.status, []
    cell.status = lambda s: (inner(s), at.append(cell.now()))
    runner, _, _ = make_runner(cell)
    assert runner.run().state == State.DONE
    laying = [s.state == State.DEPOSITING for s in cell.statuses]
    left = np.array([s.time_left for s in cell.statuses])[laying]
    truly = at[-1] - np.array(at)[laying]
    known = np.isfinite(left)
    assert known.mean() > 0.8 and (left[known] >= 0).all()
    half = len(left) // 2
    # the first scan counts into the pace of a short job
    assert 0.4 * truly[half] < left[half] < 2.5 * truly[half]
    assert left[-1] < 0.02 * np.nanmax(left) and cell.statuses[-1].time_left == 0.0
    assert np.nanmean(left[half:]) < 0.6 * np.nanmean(left[:half])
