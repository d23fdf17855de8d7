"""What goes wrong is kept with class, time, place and reaction, whoever has noticed it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from waam_job.model.goal import Code, JobError
from waam_job.model.records import AnomalyRecord, State
from waam_process.segment import Kind


def anomalies(folder, loop_mode: str = 'closed_loop') -> list[dict]:
    return json.loads((folder.path / 'report.json').read_text())[loop_mode]['anomalies']


def test_warnings_of_other_nodes_are_kept_with_the_job(make_cell, make_runner):
    cell = make_cell()
    cell.warnings = [AnomalyRecord(1.0, 'WARNING', 'link', 'from before the job', 'none')]
    runner, _, folder = make_runner(cell, layers=1)
    inner, told = cell._lay, []

    def lay(s):
        inner(s)
        if s.kind == Kind.DEPOSIT and not told:
            told.append(1)
            place = (0.01, 0.02, 0.03)
            cell.warnings.append(
                AnomalyRecord(7.0, 'WARNING', 'arc', 'try 2 of 3', 'retry', 1, 2, place)
            )

    cell._lay = lay
    assert runner.run().state == State.DONE
    found = [a for a in anomalies(folder) if a['class'] in ('arc', 'link')]
    assert len(found) == 1 and 'class_name' not in found[0]
    assert found[0] == {
        'time': 7.0, 'severity': 'WARNING', 'class': 'arc', 'text': 'try 2 of 3', 'reaction': 'retry',
        'layer': 1, 'bead': 2, 'position': [0.01, 0.02, 0.03],
    }  # fmt: skip
    assert not cell.anomalies or all(a.text != 'try 2 of 3' for a in cell.anomalies)


@pytest.mark.parametrize(
    'loop_mode,reaction',
    [('closed_loop', 'more than the last layer can correct'), ('open_loop', 'none')],
)
def test_height_error_is_noted_with_its_place(loop_mode, reaction, make_cell, make_runner):
    cell = make_cell()
    runner, _, folder = make_runner(cell, loop_mode=loop_mode, layers=2)
    inner, taken = cell.finish_scan, []

    def finish(*args):
        taken.append(1)
        if len(taken) == 2:  # after the first layer: a lump that nobody has planned
            spec = cell.surface.spec
            rows, cols = np.nonzero(runner.context.plan.interior)
            middle = len(rows) // 2
            taken.append((spec.x[cols[middle]], spec.y[rows[middle]]))
            cell.surface.z[rows[middle], cols[middle]] += 5e-3
        return inner(*args)

    cell.finish_scan = finish
    assert runner.run().state == State.DONE
    found = [a for a in anomalies(folder, loop_mode) if a['class'] == 'height' and a['layer'] == 1]
    assert (
        len(found) == 1 and found[0]['reaction'] == reaction and 'after layer 1' in found[0]['text']
    )
    place = next(t for t in taken if isinstance(t, tuple))
    assert found[0]['position'][:2] == pytest.approx(place)


def test_fault_of_this_software_leaves_report_machine_and_status_in_order(make_cell, make_runner):
    cell = make_cell()

    def broken(*_):
        raise KeyError('psi')

    cell.correct = broken
    runner, _, folder = make_runner(cell)
    with pytest.raises(KeyError):
        runner.run()
    assert cell.commands[-2:] == ['STOP', 'DISARM'] and cell.record_calls[-1] is False
    status = json.loads((folder.path / 'status.json').read_text())
    assert status['state'] == 'FAILED' and 'KeyError' in status['message']
    assert [a['class'] for a in anomalies(folder) if a['severity'] == 'FAULT'] == ['node']


@pytest.mark.parametrize(
    'error,kind',
    [
        (JobError(Code.NODE_LOST, 'service x did not answer'), 'node'),
        (JobError(Code.SCAN_FAILED, 'no map'), 'scan'),
    ],
)
def test_every_failed_job_has_an_anomaly_that_says_why(error, kind, make_cell, make_runner):
    cell = make_cell()

    def fails(*_):
        raise error

    cell.begin_scan = fails
    runner, _, folder = make_runner(cell)
    assert runner.run().error_code == error.code
    faults = [a for a in anomalies(folder) if a['severity'] == 'FAULT']
    assert [(a['class'], a['text']) for a in faults] == [(kind, str(error))]
    assert all(a['time'] > 0 and a['reaction'] for a in faults)


def test_lost_telemetry_is_told_where_it_was_lost(make_cell, make_runner):
    cell = make_cell()
    inner = cell.take_sums
    cell.take_sums = lambda: replace(inner(), lost=3)
    runner, _, folder = make_runner(cell, layers=1)
    runner.run()
    found = [a for a in anomalies(folder) if '3 telemetry frames' in a['text']]
    assert [(a['class'], a['layer']) for a in found] == [('link', 1)]
