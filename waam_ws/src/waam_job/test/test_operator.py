"""What the operator may change in a running job, and jobs of two passes."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from waam_job.model.goal import Code, JobError, JobGoal, check
from waam_job.model.limits import k_gain_limit
from waam_job.model.records import State
from waam_job.ros.node_requests import adjust
from waam_job.run.control import Control
from waam_msgs.srv import AdjustJob
from waam_plan.fill.linking import arc_starts
from waam_plan.gcode.store import load_plan
from waam_process.segment import Kind

R = AdjustJob.Request


def run(folder) -> dict:
    return json.loads((folder.path / 'report.json').read_text())['closed_loop']


def test_gain_changes_from_the_next_layer_on(make_cell, make_runner):
    cell = make_cell(efficiency=0.8)
    runner, control, folder = make_runner(cell)
    cell.on_deposit(5, lambda: adjust(control, R.SET_K_GAIN, 0.1))
    assert runner.run().state == State.DONE
    gains = [r['k_gain'] for r in run(folder)['layers'] if not r['final']]
    assert gains[0] == 0.3 and gains[1:] == [0.1] * (len(gains) - 1)
    assert any('k_gain set to 0.1' in a['text'] for a in run(folder)['anomalies'])
    assert cell.statuses[-1].k_gain == 0.1


def test_rescan_is_done_once_and_its_map_is_used(make_cell, make_runner):
    cell = make_cell()
    runner, control, folder = make_runner(cell)
    scans = []
    inner = cell.finish_scan
    cell.finish_scan = lambda *a: scans.append(a) or inner(*a)
    cell.on_deposit(5, lambda: adjust(control, R.RESCAN, 0.0))
    assert runner.run().state == State.DONE
    assert len(scans) == runner.status.layers + 2  # as found, after each layer, and one more


def test_skipped_layer_gets_no_metal(make_cell, make_runner):
    cell = make_cell()
    runner, control, folder = make_runner(cell)
    assert adjust(control, R.SKIP_LAYER, 0.0) == ''
    assert runner.run().state == State.DONE
    assert {s.layer for s in cell.executed if s.kind == Kind.DEPOSIT} == set(
        range(2, runner.status.layers + 1)
    )
    assert 'skipped by the operator' in run(folder)['layers'][0]['reasons']
    assert any('skipped' in a['text'] for a in run(folder)['anomalies'])


@pytest.mark.parametrize(('code', 'value'), [(R.SET_K_GAIN, 0.6), (R.SET_K_GAIN, -0.1), (77, 0.0)])
def test_nonsense_is_refused_with_a_reason(code, value):
    control = Control()
    assert adjust(control, code, value) != ''
    assert control.k_gain(0.25) == 0.25


def test_more_gain_than_the_correction_server_allows_is_refused_while_a_job_runs():
    control = Control()
    limit = k_gain_limit({'correction_server': {'k_gain_max': 0.3}})
    assert 'server allows 0.3' in adjust(control, R.SET_K_GAIN, 0.4, limit)
    assert adjust(control, R.SET_K_GAIN, 0.3, limit) == '' and k_gain_limit({}) == 0.5


def test_gain_nan_means_the_servers_own():
    control = Control()
    assert adjust(control, R.SET_K_GAIN, math.nan) == ''
    assert math.isnan(control.k_gain(0.25))


def test_second_pass_is_planned_from_the_scan_after_the_first(make_cell, make_runner):
    once = make_cell(efficiency=0.75)
    runner, _, folder = make_runner(once, loop_mode='open_loop')
    runner.run()
    single = runner.final.rms
    twice = make_cell(efficiency=0.75)
    runner, _, folder = make_runner(twice, loop_mode='open_loop', passes=2)
    assert runner.run().state == State.DONE
    assert runner.final.rms < 0.8 * single
    report = json.loads((folder.path / 'report.json').read_text())['open_loop']
    first, second = report['passes']
    assert (folder.path / 'plan_2.npz').exists() and (folder.path / 'program_2.gcode').exists()
    # pass 1 fell short; pass 2 is thicker than what the first plan had left for it, by what was missing
    assert first['measured_mean'] < -0.1e-3
    rest = load_plan(folder.path / 'plan.npz').layers[first['layers']].planned
    assert second['corrected_height'] > rest[rest > 0].mean() + 0.3 * abs(first['measured_mean'])
    assert second['set_height'] == pytest.approx(rest[rest > 0].mean(), rel=0.02)
    missing = second['corrected_height'] - second['set_height']
    assert missing == pytest.approx(-first['measured_mean'], rel=0.5)
    assert first['corrected_height'] is None
    numbers = [r['layer'] for r in report['layers'] if not r['final']]
    assert numbers == list(range(1, len(numbers) + 1))
    assert [r['pass_number'] for r in report['layers']][-1] == 2
    maps = sorted(p.name for p in (folder.path / 'layers').iterdir())
    assert maps == [f'scan_{i:03d}.npz' for i in range(len(numbers) + 1)]


def angle(layer) -> float:
    """deg between +x and the longest straight piece of the path."""
    longest = max(layer.deposits, key=lambda s: s.length)
    return math.degrees(math.atan2(*(np.subtract(longest.end, longest.start)[1::-1])))


EQUAL = ('finish_layers=0',)  # layers of one thickness: the first pass is one layer


@pytest.mark.parametrize('alternation', ['reverse', 'cross', 'turn'])
def test_directions_and_starts_alternate_on_over_the_passes(alternation, make_cell, make_runner):
    asked = (f'alternation={alternation}', *EQUAL)
    runner, _, folder = make_runner(make_cell(), passes=2, plan_settings=asked)
    assert runner.run().state == State.DONE
    first, second = (load_plan(folder.path / f).layers[0] for f in ('plan.npz', 'plan_2.npz'))
    away = [
        np.linalg.norm(p - arc_starts(first.segments), axis=1) for p in arc_starts(second.segments)
    ]
    assert np.min(away) >= 5e-3
    turned = (angle(second) - angle(first)) % 180
    if alternation == 'turn':
        assert min(turned, 180 - turned) == pytest.approx(67.0, abs=2.0)
    elif alternation == 'cross':
        assert first.direction != second.direction
    else:  # the other way, from the opposite corner
        rows = [[s.start[1] for s in layer.deposits] for layer in (first, second)]
        assert np.sign(rows[0][-1] - rows[0][0]) == -np.sign(rows[1][-1] - rows[1][0])


def test_pass_two_is_checked_against_what_pass_one_has_left_on_the_spool(make_cell, make_runner):
    runner, _, folder = make_runner(
        make_cell(efficiency=0.7), loop_mode='open_loop', passes=2, plan_settings=EQUAL
    )
    assert runner.run().state == State.DONE
    needed = load_plan(folder.path / 'plan.npz').wire
    cell = make_cell(efficiency=0.7)
    runner, _, _ = make_runner(
        cell, loop_mode='open_loop', passes=2, wire_left=1.01 * needed, plan_settings=EQUAL
    )
    status = runner.run()
    assert status.error_code == Code.MACHINE_NOT_READY and 'm of wire' in status.message
    assert {s.layer for s in cell.executed if s.kind == Kind.DEPOSIT} == {1}


def test_allowance_is_left_on_top(make_cell, make_runner):
    plain, thick = make_cell(), make_cell()
    make_runner(plain)[0].run()
    runner, _, _ = make_runner(thick, allowance=0.5e-3)
    assert runner.run().state == State.DONE
    gained = np.nansum(thick.surface.z - plain.surface.z) * plain.surface.spec.resolution**2
    area = runner.context.program.whole.region.sum() * plain.surface.spec.resolution**2
    assert gained / area == pytest.approx(0.5e-3 * 0.85, rel=0.35)


def test_too_little_wire_is_said_before_the_arc(make_cell, make_runner):
    cell = make_cell()
    status = make_runner(cell, wire_left=0.5)[0].run()
    assert status.error_code == Code.MACHINE_NOT_READY and 'm of wire' in status.message
    assert not any(s.arc for s in cell.executed)


def test_all_that_is_wrong_with_a_goal_is_said_at_once(parts, tmp_path):
    goal = JobGoal(
        part=parts[0], material='unobtainium', jobs_dir=tmp_path, strategy='spirograph', passes=12
    )
    with pytest.raises(JobError) as e:
        check(goal)
    for word in ('unobtainium', 'spirograph', 'passes'):
        assert word in str(e.value)


@pytest.mark.parametrize(
    ('speed', 'wire', 'metal'), [(1.0, 1.2, 1.2), (0.8, 1.0, 1.25), (0.7, 0.7, 1.0)]
)
def test_metal_that_an_override_adds_counts_as_asked_for(
    make_cell, make_runner, speed, wire, metal
):
    """Or the identification would take it for the process, and the next layers would take it back."""

    def previous(override: bool) -> tuple[np.ndarray, np.ndarray]:
        """Metal of the first layer, as the next request and the folder tell it."""
        cell = make_cell()
        runner, control, folder = make_runner(cell)
        asked, inner = [], cell.correct
        cell.correct = lambda run_id, r: asked.append(r.previous_growth) or inner(run_id, r)
        if override:
            cell.on_deposit(1, lambda: control.override(speed, wire))
        assert runner.run().state == State.DONE
        said = [r for row in run(folder)['layers'] for r in row['reasons'] if 'override' in r]
        assert len(said) == (len(asked) if override and metal != 1.0 else 0)
        return asked[1], folder.read_map(0)['asked'].astype(float)

    for usual, altered in zip(previous(False), previous(True), strict=True):
        ratio = altered[usual > 0] / usual[usual > 0]
        assert np.median(ratio) == pytest.approx(metal, rel=1e-5)
        assert ratio.max() <= max(metal, 1.0) + 1e-5


def test_an_override_leaves_what_is_nan_and_what_the_bridge_refuses(make_cell):
    control = Control()
    control.override(math.nan, 1.2)
    assert control.factors == (1.0, 1.2) and control.metal_factor == pytest.approx(1.2)
    control.override(0.8, math.nan)
    assert control.factors == (0.8, 1.2)
    for refused in ((1.0, 5.0), (0.0, 1.0), (-1.0, 1.0), (math.inf, 1.0)):
        control.override(*refused)
    assert control.factors == (0.8, 1.2)
    assert Control(control.factors).metal_factor == pytest.approx(1.5)
