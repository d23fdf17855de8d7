"""Before the first spark: everything that is wrong is said at once, and nothing is lit on a doubtful footing."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_job.run import readiness
from waam_job.store import calibration
from waam_process.segment import Kind

NOW = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)


def write_calibration(folder, days: float, **changes):
    date = (datetime.now(UTC) - timedelta(days=days)).isoformat(timespec='seconds')
    data = {'date': date, 'sha256': 'ab' * 32, 'artefact': 'block 3', **changes}
    file = folder / 'scanner.yaml'
    file.write_text(yaml.safe_dump(data))
    return str(file)


def deposits(cell) -> int:
    return sum(s.kind == Kind.DEPOSIT for s in cell.executed)


def test_all_that_is_wrong_with_the_cell_is_said_at_once(make_cell, make_runner, tmp_path):
    cell = make_cell()
    cell.machine_state = replace(cell.machine_state, state='HOLD', fault_text='gas is low')
    cell.pyrometer_plausible = False
    cell.node_parameters = {'scan_fusion': {'calibration': write_calibration(tmp_path, 31)}}
    status = make_runner(cell)[0].run()
    assert status.state == State.FAILED and status.error_code == Code.MACHINE_NOT_READY
    for words in ('gas is low', 'temperature is not believed: stuck', '31 days old, at most 30'):
        assert words in status.message
    assert not cell.executed and 'ARM' not in cell.commands


def test_a_chuck_of_a_real_machine_is_refused(make_cell, make_runner):
    cell = make_cell()
    own = {'chuck_steps_per_turn': 32000.0, 'simulated': False}
    status = make_runner(cell, own)[0].run()
    assert status.error_code == Code.MACHINE_NOT_READY
    assert 'a chuck in place of the X axis' in status.message and 'simulated only' in status.message
    assert 'ARM' not in cell.commands


def test_a_temperature_that_steps_when_the_part_is_changed_is_waited_for(make_cell, make_runner):
    cell = make_cell()
    cell.pyrometer_plausible = False
    wait = cell.wait

    def believed_after_20_s(seconds: float) -> None:
        wait(seconds)
        cell.pyrometer_plausible = cell.time > 20.0

    cell.wait = believed_after_20_s
    status = make_runner(cell)[0].run()
    assert status.state == State.DONE, status.message


@pytest.mark.parametrize(
    'file,days,simulated,words',
    [
        ('', 30, True, ''),
        ('', 30, False, 'not calibrated'),
        ('', 0, False, ''),
        ('old', 30, True, '40 days old'),
        ('old', 0, True, ''),
        ('old', 50, False, ''),
        ('future', 30, False, 'is the clock right'),
        ('gone', 30, True, 'no such file'),
        ('torn', 0, True, 'not a calibration file'),
    ],
)
def test_age_of_the_calibration(tmp_path, file, days, simulated, words):
    names = {
        '': '',
        'old': write_calibration(tmp_path, 40),
        'future': '',
        'gone': str(tmp_path / 'gone.yaml'),
    }
    if file == 'future':
        names[file] = write_calibration(tmp_path, -3)
    if file == 'torn':
        (tmp_path / 'torn.yaml').write_text('date: [2026')
        names[file] = str(tmp_path / 'torn.yaml')
    c = calibration.read(names[file])
    said = calibration.problem(c, days, simulated, datetime.now(UTC))
    assert (words in said) if words else said == ''


@settings(deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_a_calibration_or_a_trouble(tmp_path_factory, data):
    file = tmp_path_factory.mktemp('c') / 'c.yaml'
    file.write_bytes(data)
    c = calibration.read(str(file))
    assert c.trouble or not math.isnan(c.age_days(NOW))


def test_date_without_a_zone_is_utc():
    c = calibration.Calibration('f', '2026-11-20T12:00:00')
    assert c.age_days(NOW) == pytest.approx(1.0)


def test_what_would_make_an_arc_wrong_is_said_at_once(make_cell):
    machine = replace(make_cell().machine_state, homed=False, armed_job='another')
    said = readiness.spark_problems(machine, 'mine', (0.1, 0.08, 0.02))
    assert len(said) == 3 and 'homed' in said[0] and 'another' in said[1] and '100.0' in said[2]
    ready = replace(machine, homed=True, armed_job='mine', work_offset=(0.1, 0.08, 0.02))
    assert readiness.spark_problems(ready, 'mine', (0.1, 0.08, 0.02)) == []


@pytest.mark.parametrize(
    'change,words',
    [
        ({'homed': False}, 'not homed'),
        ({'work_offset': (0.1, 0.081, 0.02)}, 'work zero is [100.0, 81.0, 20.0] mm'),
        ({'armed_job': ''}, "armed for 'no job'"),
    ],
)
def test_no_arc_when_the_footing_was_lost_after_the_scan(change, words, make_cell, make_runner):
    cell = make_cell()
    runner, _, _ = make_runner(cell)
    inner = cell.finish_scan

    def finish(*args):
        scan = inner(*args)
        cell.machine_state = replace(cell.machine_state, **change)
        return scan

    cell.finish_scan = finish
    status = runner.run()
    assert status.error_code == Code.MACHINE_NOT_READY and words in status.message
    assert deposits(cell) == 0


def test_zero_that_the_controller_does_not_take_over_ends_the_job(make_cell, make_runner):
    cell = make_cell()
    inner = cell.command

    def command(name, **fields):
        inner(name, **{**fields, **({'vector': (0, 0, 0)} if name == 'SET_ZERO' else {})})

    cell.command = command
    status = make_runner(cell)[0].run()
    assert status.error_code == Code.TIMEOUT and 'work zero' in status.message
    assert not cell.executed


def test_the_first_path_begins_where_the_torch_is_after_the_work_zero(make_cell, make_runner):
    """Position and work zero come by two topics: the older position is counted from the zero before."""
    cell = make_cell()
    inner, since, start = cell.machine, [], cell.machine_state.position
    command = cell.command

    def zeroed(name, **fields):
        command(name, **fields)
        if name == 'SET_ZERO':
            since.append(cell.now())

    def machine():
        late = bool(since) and cell.now() < since[0] + 2.0
        place = (0.2, 0.1, 0.05) if late else inner().position
        at = since[0] - 0.1 if late else cell.now()
        return replace(inner(), position=place, position_at=at, state_at=since[0] if since else 0.0)

    cell.command, cell.machine = zeroed, machine
    make_runner(cell)[0].run()
    assert cell.executed[0].start == pytest.approx(start, abs=1e-9)


@pytest.mark.parametrize('limit,scans', [(900.0, 2), (0.0, 1)])
def test_old_map_is_taken_again_before_metal_is_laid_by_it(limit, scans, make_cell, make_runner):
    cell = make_cell(temperature=400.0)
    runner, _, folder = make_runner(cell, settings={'scan_max_age': limit, 'cooling_timeout': 1e9})
    inner, seen = cell.finish_scan, []

    def finish(*args):
        scan = replace(inner(*args), stamp=cell.now())
        seen.append(deposits(cell))
        return scan

    cell.finish_scan = finish
    inner_wait = cell.wait
    # while it cools, time passes a hundred times faster
    cell.wait = lambda s: inner_wait(s * 100 if cell.temperature > cell.limit else s)
    assert runner.run().state == State.DONE
    assert seen.count(0) == scans
    notes = [a for a in cell.anomalies if a.class_name == 'scan' and 's old' in a.text]
    assert len(notes) == scans - 1 and all(a.reaction == 'scanned again' for a in notes)


def test_what_a_job_starts_without_is_a_remark(make_cell, make_runner):
    cell = make_cell()
    runner, _, folder = make_runner(
        cell, settings={'simulated': False, 'calibration_max_days': 0.0}
    )
    runner.run()
    remarks = json.loads((folder.path / 'report.json').read_text())['trace']['remarks']
    for words in ('calibration', 'wire is left'):
        assert any(words in r for r in remarks)
        assert any(words in s.message for s in cell.statuses if s.state == State.PREPARING)
