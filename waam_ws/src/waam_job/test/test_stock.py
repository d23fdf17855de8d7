"""Finish machined: whether the part cleans up, what is to be machined off, and what the folder holds of it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from waam_job.model.geometry import deviation
from waam_job.model.goal import JobGoal, field_problems
from waam_job.model.records import State
from waam_job.model.stock import needed_area, stock_of
from waam_job.model.verdict import Verdict
from waam_plan.finish import Unlaid
from waam_plan.mesh.stl import read_stl

MACHINED = ('finish=machined',)
ON = np.ones((4, 5), bool)


@pytest.fixture
def job(make_cell, make_runner):
    """A whole job with finish machined: runner, folder and report."""
    runner, _, folder = make_runner(make_cell(), plan_settings=MACHINED)
    assert runner.run().state == State.DONE
    return runner, folder, json.loads((folder.path / 'report.json').read_text())


def test_status_report_and_folder_say_what_is_to_be_machined(job):
    runner, folder, report = job
    run, verdict = report['closed_loop'], report['verdict']
    assert verdict in ('cleans up', 'does not clean up') and verdict == run['verdict']
    assert runner.status.message.startswith(f'{verdict}: ') and 'to machine: mean' in run['message']
    assert runner.in_tolerance == (verdict == 'cleans up') == (run['stock']['share'] >= 0.995)
    assert run['layers'][-1]['final'] and verdict in run['layers'][-1]['reasons'][-1]
    assert run['stock']['allowance_mm'] == pytest.approx(
        runner.context.plan.settings.allowance * 1e3
    )
    assert set(run['unlaid']) == {'area_mm2', 'share', 'depth_mm', 'x_mm', 'y_mm'}
    plan = runner.context.program.first
    rows = np.genfromtxt(folder.path / 'stock_map.csv', delimiter=',', names=True)
    assert len(rows) == (needed_area(plan) | plan.region).sum()
    assert rows['needed'].sum() == needed_area(plan).sum()
    share = np.mean(rows['stock_mm'][rows['needed'] == 1] >= 0)
    assert share == pytest.approx(run['stock']['share'], abs=2e-3)
    corners, _ = read_stl((folder.path / 'as_laid.stl').read_bytes())
    last = np.load(folder.path / 'layers' / f'scan_{folder.last_map():03d}.npz')
    assert corners[..., 2].max() == pytest.approx(np.nanmax(last['z']) * 1e3, abs=0.01)
    assert (last['needed'].astype(bool) == needed_area(plan)).all()


def test_low_and_unseen_places_count_and_the_lowest_is_named(job):
    plan = job[0].context.program.first
    z = np.where(np.isfinite(plan.nominal.z), plan.nominal.z + 0.4e-3, np.nan)
    found = stock_of(plan, z)
    assert found.cleans_up and found.share == 1.0 and found.below == 0.0
    assert found.mean == pytest.approx(0.4e-3) and found.high == pytest.approx(0.4e-3)
    area = plan.region.sum() * plan.spec.resolution**2
    assert found.volume == pytest.approx(0.4e-3 * area, rel=0.02)
    needed = np.argwhere(needed_area(plan))
    row, col = needed[len(needed) // 2]
    low = z.copy()
    low[row, col] = plan.nominal.z[row, col] - 0.3e-3
    found = stock_of(plan, low)
    assert found.below == pytest.approx(0.3e-3) and 'lowest 0.30 mm below' in found.text
    assert (found.x, found.y) == (plan.spec.x[col], plan.spec.y[row])
    few = needed[: int(0.006 * len(needed)) + 1]
    unseen = z.copy()
    unseen[few[:, 0], few[:, 1]] = np.nan
    one = replace(found, share=0.9997)
    assert one.cleans_up and one.text.startswith('99.9% of')
    assert not stock_of(plan, unseen).cleans_up


def test_the_verdict_is_that_of_the_finish_and_names_what_got_no_metal(job):
    error = np.full(ON.shape, 5e-4)  # far out of tolerance
    plan = job[0].context.program.first
    clean = stock_of(plan, plan.nominal.z + 1e-3)
    verdict = Verdict(0.95, 0.2e-3, deviation(error, ON, ON, 0.2e-3), stock=clean)
    assert verdict.good and verdict.word == verdict.word_all == 'cleans up'
    poor = replace(verdict, stock=replace(clean, share=0.99))
    assert not poor.good and poor.text.startswith('does not clean up: 99.0% of the needed area')
    assert replace(verdict, final=None).word == 'failed' and not replace(verdict, final=None).good
    left = replace(verdict, stock=None, unlaid=Unlaid(30e-6, 0.11, 0.3e-3, 0.01, 0.02))
    assert (
        left.word == 'out of tolerance' and '30 mm2 (11.0% of the needed area) get no' in left.text
    )


def test_it_belongs_to_a_restoration(tmp_path):
    goal = JobGoal(tmp_path / 'a.stl', 'er70s-6', tmp_path, mode='build', plan_settings=MACHINED)
    assert any('finish machined belongs to' in p for p in field_problems(goal))
    assert not field_problems(replace(goal, mode='restore'))
