"""Finish machined: what stays below nominal after the last planned layer gets one more."""

from __future__ import annotations

import json

import numpy as np
import pytest

from waam_job.model.records import State
from waam_job.run.passes import MAX_TOP_UPS
from waam_plan.gcode.store import load_plan
from waam_process.segment import Kind

MACHINED = ('finish=machined', 'finish_height=0.00115')
PLACE = 0.020, 0.015  # m, where `pit_after` has it
PIT = 3e-3  # m, its radius


@pytest.fixture
def planned(make_cell, make_runner) -> int:
    """Layers of a job that cleans up."""
    runner, _, _ = make_runner(make_cell(), plan_settings=MACHINED)
    status = runner.run()
    assert runner.in_tolerance and status.pass_number == 1, status.message
    return status.layers


def run_of(folder, loop_mode='closed_loop') -> dict:
    return json.loads((folder.path / 'report.json').read_text())[loop_mode]


def test_a_pit_is_topped_up_and_nothing_else(planned, pit_after, make_cell, make_runner):
    cell = make_cell()
    pit_after(cell, [planned])
    runner, _, folder = make_runner(cell, plan_settings=MACHINED)
    status = runner.run()
    assert runner.in_tolerance and status.message.startswith('cleans up'), status.message
    laid = [s for s in cell.executed if s.kind == Kind.DEPOSIT and s.layer > planned]
    away = [np.hypot(s.midpoint[0] - PLACE[0], s.midpoint[1] - PLACE[1]) for s in laid]
    assert len(laid) > 0 and max(away) < PIT + 6e-3  # a bead around it
    run = run_of(folder)
    first, *top_ups = [p['layers'] for p in run['passes']]
    assert first == planned and 1 <= len(top_ups) <= MAX_TOP_UPS
    assert status.layers == planned + sum(top_ups)
    assert status.pass_number == status.passes == 1 + len(top_ups)
    numbers = list(range(1, status.layers + 1))
    assert [r['layer'] for r in run['layers'] if not r['final']] == numbers
    assert run['stock']['share'] >= 0.995
    told = [a for a in run['anomalies'] if a['reaction'].startswith('top-up 1')]
    assert len(told) == 1 and 'x = 20' in told[0]['text']
    assert len(load_plan(folder.path / 'plan_2.npz').layers) == top_ups[0]
    # it is judged by the surface with the top-up, which stands above that of the first plan
    assert np.nanmax(runner.context.program.final_target) > np.nanmax(
        runner.context.program.first.final_target
    )


def test_what_sinks_again_and_again_is_given_up(planned, pit_after, make_cell, make_runner):
    cell = make_cell()
    pit_after(cell, range(planned, planned + 9), depth=2.5e-3)
    runner, _, _ = make_runner(cell, plan_settings=MACHINED)
    status = runner.run()
    assert status.state == State.DONE and status.message.startswith('does not clean up')
    assert status.pass_number == 1 + MAX_TOP_UPS


@pytest.mark.parametrize(
    'fields',
    [{'loop_mode': 'open_loop'}, {'plan_settings': MACHINED[1:]}],
    ids=['open loop', 'as laid'],
)
def test_without_the_loop_or_the_finish_nothing_is_topped_up(
    fields, planned, pit_after, make_cell, make_runner
):
    cell = make_cell()
    pit_after(cell, range(2, 9))
    runner, _, _ = make_runner(cell, **({'plan_settings': MACHINED} | fields))
    status = runner.run()
    assert status.state == State.DONE and not runner.in_tolerance
    assert status.pass_number == 1


def test_without_wire_for_it_the_part_is_judged_as_it_is(
    planned, pit_after, make_cell, make_runner
):
    whole = make_cell()
    runner, _, folder = make_runner(whole, plan_settings=MACHINED)
    runner.run()
    needed = load_plan(folder.path / 'plan.npz').wire
    used = sum(r.wire_used for r in whole.reports)
    cell = make_cell()
    pit_after(cell, [planned])
    runner, _, folder = make_runner(
        cell, plan_settings=MACHINED, wire_left=max(needed, used) * 1.001
    )
    status = runner.run()
    assert status.state == State.DONE and status.message.startswith('does not clean up')
    told = [a for a in run_of(folder)['anomalies'] if a['reaction'] == 'no top-up']
    assert len(told) == 1 and 'm of wire' in told[0]['text'] and 'x = 20' in told[0]['text']
