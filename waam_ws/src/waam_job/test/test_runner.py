"""The job on a cell without processes: the loop closes, every fault ends in a state that says what happened."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_process.segment import Kind


def report(folder) -> dict:
    return json.loads((folder.path / 'report.json').read_text())


def first_deposit_after(runner_cell, count: int):
    """Script key: the index of the count-th deposited segment is not known before planning, so hook on enqueue."""
    cell, inner = runner_cell, runner_cell.enqueue

    def hooked(action):
        seen = {'n': 0}

        def enqueue(job_id, segments, last):
            for s in segments:
                if s.kind == Kind.DEPOSIT:
                    seen['n'] += 1
                    if seen['n'] == count:
                        cell.script[s.index] = action
            inner(job_id, segments, last)

        cell.enqueue = enqueue

    return hooked


def test_closed_loop_beats_open_loop_and_the_folder_is_complete(make_cell, make_runner):
    figures = {}
    for loop_mode in ('open_loop', 'closed_loop'):
        runner, _, folder = make_runner(make_cell(efficiency=0.8), loop_mode=loop_mode)
        status = runner.run()
        assert status.state == State.DONE, status.message
        figures[loop_mode] = report(folder)[loop_mode]['rms_mm']
        maps = sorted(p.name for p in (folder.path / 'layers').iterdir())
        assert maps == [f'scan_{i:03d}.npz' for i in range(status.layers + 1)]
        last = np.load(folder.path / 'layers' / maps[-1])
        error = (last['z'] - last['target'])[last['interior']]
        assert np.sqrt(np.nanmean(error**2)) * 1e3 == pytest.approx(figures[loop_mode], rel=1e-3)
        assert (folder.path / 'program.gcode').stat().st_size > 100
        pieces = list(np.load(folder.path / 'telemetry.npz')['t'])
        assert pieces == list(range(2, runner.context.cell.tracks_taken + 1))  # 1: before the job
    laid = [r for r in report(folder)[loop_mode]['layers'] if not r['final']]
    told = [[r[f'expected_rms{k}'] for k in ('', '_low', '_high')] for r in laid]
    assert told == [pytest.approx([1e-4, 7e-5, 1.4e-4])] * len(laid)
    # two layers, no identification in this cell: what is left is the last layer's own shortfall
    assert figures['closed_loop'] < 0.75 * figures['open_loop']


def test_a_crash_costs_ten_seconds_of_telemetry_at_most(make_cell, make_runner):
    runner, _, folder = make_runner(make_cell())
    journal, cell = runner.context.journal, runner.context.cell
    written = []
    for second in range(0, 60, 2):
        cell.time = 1000.0 + second
        bead = 1 if second < 25 else 2
        journal.checkpoint(bead, bead - 1, second, second)
        written.append(len(list((folder.path / 'track').iterdir())))
    pieces = np.diff(written, prepend=0).astype(bool)
    assert list(2 * np.flatnonzero(pieces)) == [0, 10, 20, 26, 36, 46, 56]


def test_every_layer_but_the_first_is_announced_while_the_one_before_is_laid(
    make_cell, make_runner
):
    cell = make_cell()
    runner = make_runner(cell)[0]
    status = runner.run()
    laid = [r.layer for r in cell.reports if not r.final]
    assert status.layers == len(laid) > 1
    assert [(told, coming.layer) for told, coming in cell.announced] == [
        (number - 1, number + 1) for number in laid[:-1]
    ]
    for _, coming in cell.announced:
        layer = runner.context.program.layer(coming.layer)
        assert coming.spec == cell.surface.spec
        assert (coming.planned == layer.planned).all()
        assert len(coming.beads) == len(layer.arc_paths)
    blind = make_cell()
    make_runner(blind, loop_mode='open_loop')[0].run()
    assert not blind.announced


def test_every_request_tells_how_thick_the_layer_after_it_will_be(make_cell, make_runner):
    cell = make_cell()
    inner, told = cell.correct, {}

    def correct(job_id, request):
        told[request.layer] = request
        return inner(job_id, request)

    cell.correct = correct
    runner, _, _ = make_runner(cell)
    assert runner.run().state == State.DONE
    *below, top = sorted(told)
    assert below and told[top].next_thickness == 0.0
    for number in below:
        planned = told[number + 1].planned
        assert told[number].next_thickness == pytest.approx(np.median(planned[planned > 0]))


def test_monitor_computes_but_does_not_apply(make_cell, make_runner):
    runner, _, folder = make_runner(make_cell(efficiency=0.8), loop_mode='monitor')
    runner.run()
    layers = report(folder)['monitor']['layers']
    assert any(abs(r['psi_mean']) > 0.05 for r in layers)
    assert not any(r['correction_applied'] for r in layers)
    assert all(s.psi == 0 for s in runner.context.cell.executed)
    assert not any(r['expected_rms'] for r in layers)  # of what was laid nothing was expected


def test_segments_form_one_chain_over_the_whole_job(make_cell, make_runner):
    cell = make_cell()
    make_runner(cell)[0].run()
    for before, after in zip(cell.executed, cell.executed[1:], strict=False):
        assert after.index == before.index + 1
        assert after.start == pytest.approx(before.end, abs=1e-9)


def test_alarm_in_a_layer_fails_the_job_with_the_controllers_words(make_cell, make_runner):
    cell = make_cell()

    def alarm(c):
        c.machine_state = replace(
            c.machine_state, state='ALARM', fault=300, fault_text='emergency stop'
        )

    first_deposit_after(cell, 40)(alarm)
    runner, _, folder = make_runner(cell)
    status = runner.run()
    assert status.state == State.FAILED and status.error_code == Code.DEPOSITION_FAILED
    assert 'emergency stop' in status.message
    assert cell.commands[-2:] == ['STOP', 'DISARM']
    assert report(folder)['verdict'] == 'failed'
    assert json.loads((folder.path / 'status.json').read_text())['state'] == 'FAILED'


def test_the_fault_of_a_drive_ends_the_job_as_a_matter_of_the_motion(make_cell, make_runner):
    """The controller has lost homing with it, so nothing of the job goes on; the note says what it is about."""
    cell = make_cell()

    def alarm(c):
        c.machine_state = replace(
            c.machine_state, state='ALARM', fault=308, fault_text='fault of a drive', homed=False
        )

    first_deposit_after(cell, 40)(alarm)
    status = make_runner(cell)[0].run()
    assert status.state == State.FAILED and 'fault of a drive' in status.message
    assert cell.commands[-2:] == ['STOP', 'DISARM'] and 'RESET' not in cell.commands
    (note,) = [a for a in cell.anomalies if a.severity == 'ALARM']
    assert note.class_name == 'motion' and 'arc and motion ended' in note.reaction


def test_silent_node_is_named(make_cell, make_runner):
    cell = make_cell()

    def silence(c):
        c.machine_state = replace(
            c.machine_state, state='HOLD', fault=202, silent_nodes=('scan_fusion',)
        )

    first_deposit_after(cell, 30)(silence)
    status = make_runner(cell)[0].run()
    assert status.error_code == Code.NODE_LOST and 'scan_fusion' in status.message
    assert any(a.class_name == 'node' for a in cell.anomalies)


def test_an_alarm_names_the_node_that_fell_silent_before(make_cell, make_runner):
    cell = make_cell()

    def alarm(c):
        c.machine_state = replace(
            c.machine_state,
            state='ALARM',
            fault=303,
            fault_text='process inputs lost',
            silent_nodes=('recorder',),
        )

    first_deposit_after(cell, 30)(alarm)
    status = make_runner(cell)[0].run()
    assert 'process inputs lost; recorder fell silent before' in status.message


def test_late_node_that_comes_back_is_resumed_and_counted(make_cell, make_runner):
    cell = make_cell()

    def late(c):
        c.machine_state = replace(c.machine_state, state='HOLD', fault=202, fault_text='lease')

    first_deposit_after(cell, 30)(late)
    runner, _, folder = make_runner(cell)
    assert runner.run().state == State.DONE
    assert 'RESUME' in cell.commands
    assert any('resumed' in a['reaction'] for a in report(folder)['closed_loop']['anomalies'])


def test_lost_link_ends_the_job(make_cell, make_runner):
    cell = make_cell()
    first_deposit_after(cell, 10)(
        lambda c: setattr(c, 'machine_state', replace(c.machine_state, age=9.0))
    )
    status = make_runner(cell)[0].run()
    assert status.error_code == Code.LINK_LOST


def test_pause_holds_and_resume_finishes(make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell)
    waited = {'n': 0}
    inner = cell.wait

    def wait(seconds):
        if control.paused:
            waited['n'] += 1
            if waited['n'] > 5:
                control.resume()
        inner(seconds)

    cell.wait = wait
    first_deposit_after(cell, 20)(lambda c: control.pause())
    assert runner.run().state == State.DONE
    assert 'HOLD' in cell.commands and 'RESUME' in cell.commands
    assert any(s.state == State.PAUSED for s in cell.statuses)


def test_a_pause_by_the_machine_tells_its_reason(make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell)
    inner = cell.wait

    def wait(seconds):
        if control.paused:
            control.resume()
        inner(seconds)

    def hold(c):
        why = 'robot: the torch is 3.1 mm from where it should be; the arc is cut'
        c.machine_state = replace(c.machine_state, state='HOLD', fault=200, fault_text=why)

    cell.wait = wait
    first_deposit_after(cell, 20)(hold)
    assert runner.run().state == State.DONE
    said = [s.message for s in cell.statuses if s.state == State.PAUSED]
    assert 'paused: robot: the torch is 3.1 mm' in said[0] and 'resume or abort' in said[0]


def test_a_resume_that_telemetry_shows_late_is_no_new_pause(make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell)
    inner_wait, inner_command = cell.wait, cell.command
    seen = {'pauses': 0, 'late': 0}

    def command(name, **fields) -> None:
        inner_command(name, **fields)
        if name == 'RESUME':
            cell.machine_state = replace(cell.machine_state, state='HOLD', fault=200)
            seen['late'] = 8

    def wait(seconds):
        if control.paused:
            seen['pauses'] += 1
            assert seen['pauses'] == 1, 'the job paused by itself'
            control.resume()
        if seen['late']:
            seen['late'] -= 1
            if not seen['late']:
                cell.machine_state = replace(cell.machine_state, state='RUN', fault=0)
        inner_wait(seconds)

    cell.wait, cell.command = wait, command
    first_deposit_after(cell, 20)(lambda c: control.pause())
    assert runner.run().state == State.DONE
    assert cell.commands.count('RESUME') == 1


def test_abort_stops_the_machine(make_cell, make_runner):
    cell = make_cell()
    runner, control, folder = make_runner(cell)
    first_deposit_after(cell, 20)(lambda c: control.abort('operator'))
    status = runner.run()
    assert status.state == State.ABORTED and status.error_code == Code.ABORTED
    assert 'STOP' in cell.commands and not cell.queue
    assert report(folder)['verdict'] == 'failed'


def test_implausible_scan_is_repeated_then_the_correction_is_removed(make_cell, make_runner):
    cell = make_cell()
    cell.scan_coverage = [1.0, 0.1, 0.1] + [1.0] * 50
    runner, _, folder = make_runner(cell)
    assert runner.run().state == State.DONE
    layers = report(folder)['closed_loop']['layers']
    assert layers[1]['fallback'] and layers[1]['psi_max'] == 0 and layers[1]['reasons']
    reactions = [a.reaction for a in cell.anomalies if a.class_name == 'scan']
    assert reactions == ['scanned again', 'correction removed']


def test_a_map_that_misses_a_part_is_taken_and_the_job_pauses_when_it_stays_so(
    make_cell, make_runner
):
    cell = make_cell()
    cell.scan_coverage = [1.0] + [0.8] * 60
    runner, control, folder = make_runner(
        cell, layer_height=1e-3, plan_settings=("finish_layers=0",)
    )
    paused, inner = [], cell.wait

    def wait(seconds):
        if control.paused:
            paused.append(cell.statuses[-1].message)
            control.resume()
        inner(seconds)

    cell.wait = wait
    assert runner.run().state == State.DONE
    told = [
        a for a in cell.anomalies if a.class_name == 'scan' and 'not seen that was seen' in a.text
    ]
    assert {a.reaction for a in told} >= {
        'scanned again',
        'what was seen is corrected, the rest holds the level',
    }
    layers = report(folder)['closed_loop']['layers']
    assert not any(x['fallback'] for x in layers)
    assert len(paused) >= 1 and 'clean the window of the scanner' in paused[0]
    assert len(layers) > 3


def test_a_map_that_misses_a_part_is_better_than_none(make_cell, make_runner):
    """The scan again sees nothing at all: the one before it is taken."""
    cell = make_cell()
    cell.scan_coverage = [1.0, 0.8, 0.1] + [1.0] * 50
    runner, _, folder = make_runner(cell)
    assert runner.run().state == State.DONE
    assert not any(x['fallback'] for x in report(folder)['closed_loop']['layers'])
    reactions = [a.reaction for a in cell.anomalies if a.class_name == 'scan']
    assert reactions == ['scanned again', 'what was seen is corrected, the rest holds the level']


@pytest.mark.parametrize('lost,believed', [(0.0, True), (0.3, False)])
def test_the_scan_again_goes_the_other_way_and_must_see_as_much(
    make_cell, make_runner, lost, believed
):
    """A scanner that is blind for a while in each of the two scans is not taken for ground out of its range."""
    cell = make_cell()
    cell.scan_coverage = [0.1] + [1.0] * 50
    scans = []
    inner = cell.finish_scan

    def finish(*args):
        scan = inner(*args)
        scans.append([s for s in cell.executed if s.kind == Kind.SCAN][-1])
        if len(scans) > 1:
            z = scan.map.z.copy()
            z[:, : round(lost * z.shape[1])] = np.nan
            scan = replace(scan, map=scan.map.with_z(z))
        return scan

    cell.finish_scan = finish
    status = make_runner(cell)[0].run()
    assert (status.state == State.DONE) == believed
    first, again = scans[:2]
    assert (first.end[0] - first.start[0]) * (again.end[0] - again.start[0]) < 0
    if not believed:
        assert status.error_code == Code.SCAN_FAILED
        assert 'seen by the scan before' in status.message


def test_surface_as_found_must_be_measured(make_cell, make_runner):
    cell = make_cell()
    cell.scan_coverage = [0.1, 0.1]
    status = make_runner(cell)[0].run()
    assert status.error_code == Code.SCAN_FAILED
    assert not any(s.kind == Kind.DEPOSIT for s in cell.executed)


def test_waits_for_interpass_temperature(make_cell, make_runner):
    cell = make_cell(temperature=180.0)
    runner, _, folder = make_runner(cell)
    assert runner.run().state == State.DONE
    first = report(folder)['closed_loop']['layers'][0]
    assert first['wait'] > 0 and first['temperature'] < 165


def test_unbelievable_pyrometer_stops_before_the_spark(make_cell, make_runner):
    cell = make_cell()
    cell.pyrometer_plausible = False
    status = make_runner(cell)[0].run()
    assert status.error_code == Code.MACHINE_NOT_READY and 'stuck' in status.message
    assert not any(s.arc for s in cell.executed)


def test_not_connected_says_so_before_anything_moves(make_cell, make_runner):
    cell = make_cell()
    cell.machine_state = replace(
        cell.machine_state, connected=False, message='port is no controller'
    )
    status = make_runner(cell)[0].run()
    assert status.error_code == Code.MACHINE_NOT_READY and 'no controller' in status.message
    assert not cell.executed


def in_alarm(cell, fault):
    cell.machine_state = replace(
        cell.machine_state, state='ALARM', fault=fault, fault_text='as told', homed=True
    )
    return cell


def test_starting_a_job_acknowledges_that_the_controller_was_switched_on(make_cell, make_runner):
    cell = in_alarm(make_cell(), 306)
    assert make_runner(cell)[0].run().state == State.DONE
    assert [c for c in cell.commands if c in ('RESET', 'ARM', 'HOME')][:3] == [
        'RESET',
        'ARM',
        'HOME',
    ]


@pytest.mark.parametrize('fault', [300, 301, 303, 307, 308])
def test_any_other_alarm_is_left_to_a_person(make_cell, make_runner, fault):
    cell = in_alarm(make_cell(), fault)
    status = make_runner(cell)[0].run()
    assert (
        status.error_code == Code.MACHINE_NOT_READY
        and 'ALARM: as told; see to it, then Reset and Home' in status.message
    )
    assert 'RESET' not in cell.commands


def test_every_scan_is_told_the_beads_that_were_laid_before_it(make_cell, make_runner):
    cell = make_cell()
    runner, _, folder = make_runner(cell)
    status = runner.run()
    assert status.state == State.DONE, status.message
    layers = {p.number: p for p in runner.context.program.layers}
    assert [layer for layer, _ in cell.laid] == list(range(status.layers + 1))
    assert cell.laid[0][1].paths == ()
    for layer, laid in cell.laid[1:]:
        assert len(laid.paths) == layers[layer].arc_starts
        points = np.concatenate(laid.paths)
        assert np.allclose(points, np.concatenate(layers[layer].arc_paths), atol=1e-6)
    stored = np.load(folder.path / 'layers' / 'scan_001.npz')['bead_width']
    assert stored.shape == (3,) and np.isnan(stored).all()  # this cell measures none
