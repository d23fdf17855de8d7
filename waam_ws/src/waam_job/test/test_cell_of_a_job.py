"""A job and the cell file: the machine must be as the file says; the job keeps a copy."""

from __future__ import annotations

import json

import pytest

from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_job.store.cell_file import compared, keep
from waam_job.store.folder import JobFolder
from waam_process.cell_file import new, parse

NEW = new('cell')


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'gantry.yaml'
    path.write_text(NEW)
    return path


def nodes() -> dict:
    """Parameters as the nodes have them when they were started with this file."""
    return parse(NEW, 'x').parameters(simulated=True)


def test_a_machine_that_is_not_as_the_file_says_is_refused_by_name(make_cell, make_runner, file):
    cell = make_cell()
    cell.node_parameters = nodes()
    file.write_text(NEW.replace('envelope_mm: 400', 'envelope_mm: 500'))
    status = make_runner(cell, settings={'cell_file': str(file)})[0].run()
    assert status.state == State.FAILED and status.error_code == Code.MACHINE_NOT_READY
    assert 'gantry.yaml:10: axes.x.envelope_mm is 500, bridge has envelope_x 0.4' in status.message
    assert 'waam stop, waam up' in status.message
    assert not cell.executed and 'ARM' not in cell.commands


def test_a_machine_as_the_file_says_lays_its_job(make_cell, make_runner, file):
    cell = make_cell()
    cell.node_parameters = nodes()
    file.write_text(NEW + '# a remark of later\n')
    runner, _, folder = make_runner(cell, settings={'cell_file': str(file)})
    assert runner.run().state == State.DONE
    remarks = json.loads((folder.path / 'report.json').read_text())['trace']['remarks']
    assert not any('gantry.yaml' in r for r in remarks)


def test_another_work_zero_than_that_of_the_file_is_a_remark(make_cell, make_runner, file):
    cell = make_cell()
    cell.node_parameters = nodes()
    file.write_text(NEW.replace('zero_mm: [100, 80, 20]', 'zero_mm: [100, 80, 21]'))
    runner, _, folder = make_runner(cell, settings={'cell_file': str(file)})
    runner.run()
    remarks = json.loads((folder.path / 'report.json').read_text())['trace']['remarks']
    assert any(':50: work.zero_mm is [100, 80, 21], job_sequencer has' in r for r in remarks), (
        remarks
    )


@pytest.mark.parametrize('text', [None, 'waam_cell: 7', '\x00', '['])
def test_a_file_that_cannot_be_read_any_more_refuses(text, tmp_path):
    path = tmp_path / 'gone.yaml'
    if text is not None:
        path.write_text(text)
    said = compared(str(path), nodes(), True).refused
    assert len(said) == 1 and 'gone.yaml' in said[0]
    assert 'trouble' in keep(JobFolder.create(tmp_path / 'jobs', 'a'), str(path))


def test_a_bridge_that_does_not_answer_refuses(file):
    assert 'bridge did not say' in compared(str(file), {}, True).refused[0]


def test_without_a_file_there_is_nothing_to_compare():
    assert compared('', {}, False) == compared('', nodes(), True)


def test_the_job_keeps_the_file_of_every_run(file, tmp_path):
    folder = JobFolder.create(tmp_path / 'jobs', 'a')
    kept = keep(folder, str(file))
    assert (folder.path / 'cell.yaml').read_text() == NEW
    cell = parse(NEW, 'x')
    assert (kept['sha256'], kept['machine_sha256']) == (cell.sha256, cell.machine_sha256)
    keep(folder, str(file), 2)
    assert (folder.path / 'cell_2.yaml').exists()
