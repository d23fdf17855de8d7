"""Every request of the job, answered later than its time-out: it acts all the same, in the order of its server."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from waam_job.model.goal import Code, JobError
from waam_job.model.records import State

BRIDGE = ('ARM', 'HOME', 'SET_ZERO', 'STOP', 'DISARM', 'enqueue')
SERVER_OF = {name: 'bridge' for name in BRIDGE} | {
    'START': 'recorder',
    'END': 'recorder',
    'begin_scan': 'scan_fusion',
    'finish_scan': 'scan_fusion',
    'correct': 'correction_server',
    'setpoints': 'feed_forward',
}


class LateCell:
    """A cell whose answer to the request `late`, the `time`-th of its kind, comes too late: the caller hears of a
    time-out; what was asked for is done before the next request to the same server, or after the end of the job."""

    def __init__(self, cell, late: str, time: int = 1) -> None:
        self.cell, self.late, self.time = cell, late, time
        self.recording = ''
        self.waiting: dict[str, list] = {}

    def __getattr__(self, name: str):
        return getattr(self.cell, name)

    def _ask(self, name: str, act):
        server = SERVER_OF.get(name, 'bridge')
        self.catch_up(server)
        if name == self.late:
            self.time -= 1
            if self.time == 0:
                self.waiting.setdefault(server, []).append(act)
                raise JobError(Code.NODE_LOST, f'service {server}/{name} did not answer')
        return act()

    def catch_up(self, server: str) -> None:
        for act in self.waiting.pop(server, []):
            act()

    def command(self, name, **fields) -> None:
        self._ask(name, lambda: self._command(name, fields))

    def _command(self, name, fields) -> None:
        self.cell.command(name, **fields)
        if name == 'STOP':
            self.cell.machine_state = replace(
                self.cell.machine_state, state='IDLE', arc_on=False, fault=0
            )

    def record(self, start, directory, custom=()) -> str:
        return self._ask('START' if start else 'END', lambda: self._record(start, directory))

    def _record(self, start, directory) -> str:
        """As `recorder/control`: one recording at a time, known by its folder."""
        if start and self.recording not in ('', directory):
            raise JobError(Code.NODE_LOST, f'recorder: {self.recording} is being recorded')
        if start or directory == self.recording:
            self.recording = directory if start else ''
        return 'ok'

    def enqueue(self, *given) -> None:
        self._ask('enqueue', lambda: self.cell.enqueue(*given))

    def begin_scan(self, *given) -> int:
        return self._ask('begin_scan', lambda: self.cell.begin_scan(*given))

    def finish_scan(self, *given):
        return self._ask('finish_scan', lambda: self.cell.finish_scan(*given))

    def correct(self, *given):
        return self._ask('correct', lambda: self.cell.correct(*given))

    def setpoints(self, *given):
        return self._ask('setpoints', lambda: self.cell.setpoints(*given))


def assert_whole(cell: LateCell, folder, runner) -> None:
    """Report and status are there; nothing burns, moves, waits or records."""
    for server in set(SERVER_OF.values()):
        cell.catch_up(server)
    status = json.loads((folder.path / 'status.json').read_text())
    assert status['state'] == runner.status.state.name in ('FAILED', 'DONE')
    report = json.loads((folder.path / 'report.json').read_text())['closed_loop']
    assert any('did not answer' in a['text'] for a in report['anomalies'])
    machine = cell.cell.machine_state
    assert cell.recording == '' and machine.armed_job == ''
    assert not cell.cell.queue and machine.state != 'RUN' and not machine.arc_on


@pytest.mark.parametrize('late', [n for n in SERVER_OF if n not in ('STOP', 'DISARM', 'END')])
def test_a_late_answer_fails_the_job_which_ends_whole(late, make_cell, make_runner):
    cell = LateCell(make_cell(), late)
    runner, _, folder = make_runner(cell, layers=1)
    status = runner.run()
    assert (status.state, status.error_code) == (State.FAILED, Code.NODE_LOST)
    assert late in status.message
    assert_whole(cell, folder, runner)
    again, _, _ = make_runner(cell, layers=1)
    assert again.run().state == State.DONE, again.status.message
    assert cell.recording == ''


@pytest.mark.parametrize('late', ['enqueue', 'begin_scan', 'finish_scan', 'correct', 'setpoints'])
def test_so_does_one_in_the_second_layer(late, make_cell, make_runner):
    cell = LateCell(make_cell(), late, time=2)
    runner, _, folder = make_runner(cell, loop_mode='closed_loop')
    assert runner.run().error_code == Code.NODE_LOST
    assert_whole(cell, folder, runner)


@pytest.mark.parametrize('late', ['DISARM', 'END'])
def test_at_the_end_it_is_told_and_the_job_stays_done(late, make_cell, make_runner):
    cell = LateCell(make_cell(), late)
    runner, _, folder = make_runner(cell, layers=1)
    assert runner.run().state == State.DONE, runner.status.message
    assert_whole(cell, folder, runner)


def test_a_failed_job_whose_stop_is_answered_late_is_disarmed_and_recorded_to_its_end(
    make_cell, make_runner
):
    cell = LateCell(make_cell(), 'STOP')
    runner, control, folder = make_runner(cell, layers=1)
    cell.cell.on_deposit(5, lambda: control.abort('test'))
    assert runner.run().state == State.ABORTED
    cell.catch_up('bridge')
    assert cell.recording == '' and cell.cell.machine_state.armed_job == ''
    assert not cell.cell.queue and (folder.path / 'report.json').exists()


@pytest.mark.parametrize('broken', ['status.json', 'report.json', 'records.json'])
def test_a_disk_that_takes_nothing_more_keeps_neither_arc_nor_record(
    broken, make_cell, make_runner, monkeypatch
):
    cell = LateCell(make_cell(), '')
    runner, control, folder = make_runner(cell, layers=1)
    inner, full = type(folder).write_json, []

    def write_json(self, name, data):
        if full and name == broken:
            raise OSError(28, 'No space left on device')
        inner(self, name, data)

    monkeypatch.setattr(type(folder), 'write_json', write_json)
    cell.cell.on_deposit(5, lambda: full.append(1) or control.abort('test'))
    assert runner.run().state == State.ABORTED
    assert cell.cell.commands[-2:] == ['STOP', 'DISARM'] and cell.recording == ''
    assert cell.cell.statuses[-1].state == State.ABORTED
