"""What was calibrated against what the controller has: a start is refused, and the list of alarms says it. No graph."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from panel_requests import MACHINE, ask, machine_says, until, wall

from waam_calibrate import store
from waam_calibrate.results import Result
from waam_panel import calibrated

FOUND = {'steps_per_mm_x': 321.602, 'shape_x_hz': 41.5}


@pytest.fixture
def results(panel, monkeypatch) -> Path:
    """Steps of x and a shaper of x were found; the panel looks at once."""
    monkeypatch.setattr(calibrated, 'SETTLE_S', 0.0)
    monkeypatch.setattr(calibrated, 'AGAIN_S', 0.2)
    folder = panel.folder / 'calibrations'
    date = '2026-11-01T10:00:00+00:00'
    for kind, name in (('steps', 'steps_per_mm_x'), ('resonance', 'shape_x_hz')):
        told = [(name, FOUND[name])]
        store.save(folder, Result(kind, 'x', 'found', {'v': 1.0}, settings=told, date=date), '')
    panel.cell.calibrations = folder
    return folder


def alarm(panel) -> dict | None:
    found = [a for a in panel.cell.state.alarms.listing() if a['code'] == 'calibration']
    return found[0] if found else None


def asked(panel) -> int:
    return panel.operations.asked.count(('settings',))


def test_a_controller_that_lost_its_settings_is_in_the_list_of_alarms_until_it_has_them(
    panel, results
):
    panel.operations.told = dict(FOUND)
    machine_says(panel, boot=1)
    until(lambda: asked(panel), 'asked after the start')
    time.sleep(1.2)
    assert alarm(panel) is None and asked(panel) == 1  # nothing is missing: not asked again
    panel.operations.told = {'steps_per_mm_x': 320.0, 'shape_x_hz': 40.0}
    machine_says(panel, boot=2, state='ALARM')
    until(lambda: alarm(panel), 'the alarm after a loss of power')
    said = alarm(panel)
    assert said['active'] and said['severity'] == 1  # 0.498 %: a job may run
    assert 'steps_per_mm_x is 320 in the controller, 321.602 was found' in said['text']
    assert 'shape_x_hz is 40' in said['text'] and 'waam calibrate apply' in said['text']
    panel.operations.told = dict(FOUND)  # waam calibrate apply
    until(lambda: not alarm(panel)['active'], 'the end of the alarm')


def test_lengths_that_are_wrong_keep_program_part_and_queue_from_starting(
    panel, results, write_part
):
    panel.operations.told = FOUND | {'steps_per_mm_x': 319.0}
    machine_says(panel, boot=1, armed=True)
    until(lambda: alarm(panel), 'the alarm')
    assert alarm(panel)['severity'] == 2
    ask(panel, 'programs?name=wall.gcode', wall().encode())
    write_part(panel.folder / 'parts')
    for start, load in (
        ('program/start', ('program/load', {'program': 'wall.gcode'})),
        ('start', ('load', {'part': 'block.stl', 'as_found': 'block_worn.stl'})),
    ):
        panel.operations.told['steps_per_mm_x'] = 319.0
        assert ask(panel, *load)[0] == 200
        status, said = ask(panel, start, {})
        assert status == 409 and '319 steps/mm, 321.602 were found' in said['message']
        panel.operations.told['steps_per_mm_x'] = 320.5
        assert ask(panel, start, {})[0] == 200


def test_a_controller_that_does_not_say_is_asked_again_and_keeps_nothing_from_starting(
    panel, results
):
    """As `waam job run`: a robot's controller has no such settings."""
    machine_says(panel, boot=1, armed=True)
    ask(panel, 'programs?name=wall.gcode', wall().encode())
    assert ask(panel, 'program/load', {'program': 'wall.gcode'})[0] == 200
    assert ask(panel, 'program/start', {})[0] == 200
    panel.operations.told = {'shape_x_hz': 7.0}
    until(lambda: alarm(panel), 'asked again')


@pytest.mark.parametrize('machine', [{'state': 'RUN'}, {'connected': False}])
def test_nobody_asks_a_machine_that_moves_or_is_not_there(panel, results, machine):
    panel.operations.told = {'steps_per_mm_x': 1.0}
    panel.cell.mailbox.put(('machine', MACHINE | {'boot': 1} | machine))
    time.sleep(1.5)
    assert not asked(panel) and alarm(panel) is None


def test_a_result_that_comes_later_is_compared(panel, results):
    panel.operations.told = FOUND | {'wire_delay_s': 0.03}
    machine_says(panel, boot=1)
    until(lambda: asked(panel), 'asked after the start')
    date, told = '2026-11-02T10:00:00+00:00', [('wire_delay_s', 0.05)]
    store.save(results, Result('lead', '', 'found', {'v': 1.0}, settings=told, date=date), '')
    until(lambda: alarm(panel), 'the alarm after the new result')
    assert 'wire_delay_s is 0.03' in alarm(panel)['text']


def test_an_interrupted_job_goes_on_only_with_what_was_calibrated(panel, results):
    folder = panel.folder / 'jobs' / '20261101_100000_block'
    folder.mkdir(parents=True)
    (folder / 'job.yaml').write_text('job_id: x')
    (folder / 'status.json').write_text('{"state": "INTERRUPTED"}')
    panel.operations.told = FOUND | {'steps_per_mm_x': 319.0}
    machine_says(panel, boot=1, armed=True)
    assert ask(panel, 'load_job', {'id': folder.name})[0] == 200
    status, said = ask(panel, 'start', {})
    assert status == 409 and '319 steps/mm' in said['message']
    panel.operations.told = dict(FOUND)
    assert ask(panel, 'start', {})[0] == 200
    assert panel.operations.asked[-1] == ('resume_job', folder)
