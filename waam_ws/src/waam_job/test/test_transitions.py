"""The state machine of docs/job.md, transition by transition: every drawn one is gone through, no other one is seen."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_process.segment import Kind

DOC = Path(__file__).parents[4] / 'docs' / 'job.md'
LAYER = 'COOLING CORRECTING DEPOSITING SCANNING'
START, END = 'PREPARING SCANNING', 'FINISHING DONE'


class Script:
    """Acts on a cell the first time that a job reports `state` in layer `layer`."""

    def __init__(self, state: str, action, layer: int | None = None) -> None:
        self.state, self.action, self.layer, self.done = state, action, layer, False

    def attach(self, cell, control) -> None:
        inner = cell.status

        def status(s) -> None:
            inner(s)
            if not self.done and s.state.name == self.state and self.layer in (None, s.layer):
                self.done = True
                self.action(cell, control)

        cell.status = status


def in_a_bead(action):
    """`action` once the tenth piece of a bead that is queued from now on has been laid."""

    def act(cell, control) -> None:
        inner = cell.enqueue

        def enqueue(job_id, segments, last) -> None:
            beads = [s.index for s in segments if s.kind == Kind.DEPOSIT]
            if beads:
                cell.script[beads[10]] = lambda c: action(c, control)
            inner(job_id, segments, last)

        cell.enqueue = enqueue

    return act


def machine(**changes):
    def act(cell, _control) -> None:
        cell.machine_state = replace(cell.machine_state, **changes)

    return act


def pause_then(after):
    """The operator pauses; `after(cell, control)` happens in the pause."""

    def act(cell, control) -> None:
        control.pause()
        inner, looks = cell.wait, {'n': 0}

        def wait(seconds: float) -> None:
            if control.paused and cell.statuses[-1].state == State.PAUSED:
                looks['n'] += 1
                if looks['n'] == 3:
                    after(cell, control)
            inner(seconds)

        cell.wait = wait

    return act


def held_at_the_machine(cell, control) -> None:
    """Somebody presses hold at the controller; resume comes from the panel."""
    cell.machine_state = replace(cell.machine_state, state='HOLD', fault=200)
    pause_then(lambda _, c: c.resume())(cell, control)
    control.resume()  # the pause is the job's own finding, not the operator's switch


def the_wire_jams(cell, control) -> None:
    """The controller holds with its queue; the operator mends it and resumes."""
    text = 'the wire is slower than commanded'
    cell.machine_state = replace(cell.machine_state, state='HOLD', fault=206, fault_text=text)
    pause_then(lambda _, c: c.resume())(cell, control)
    control.resume()  # the pause is the job's own finding, not the operator's switch


def resume(_cell, control) -> None:
    control.resume()


def abort(_cell, control) -> None:
    control.abort('operator')


def wish(name: str):
    return lambda _cell, control: control.request(name)


def unbelieved(cell, _control) -> None:
    cell.pyrometer_plausible = False


def stays_hot(cell, _control) -> None:
    cell.limit = 10.0


def unseen(cell, _control) -> None:
    cell.scan_coverage = [0.1] * 100


def no_zero(cell, _control) -> None:
    inner = cell.command
    cell.command = lambda name, **f: None if name == 'SET_ZERO' else inner(name, **f)


def not_homed(cell, _control) -> None:
    cell.machine_state = replace(cell.machine_state, homed=False)


# name: (where, what happens there, goal, path, error code)
CASES = {
    'undisturbed': (None, None, {}, f'{START} {LAYER} {END}', 0),
    'two layers': (None, None, {'layers': 2}, f'{START} {LAYER} {LAYER} {END}', 0),
    'open loop': (
        None, None, {'loop_mode': 'open_loop'}, f'{START} COOLING DEPOSITING SCANNING {END}', 0),
    'not ready': ('PREPARING', machine(connected=False), {}, 'PREPARING FAILED', Code.MACHINE_NOT_READY),
    'zero refused': ('PREPARING', no_zero, {}, 'PREPARING FAILED', Code.TIMEOUT),
    'aborted at once': ('PREPARING', abort, {}, 'PREPARING ABORTED', Code.ABORTED),
    'paused while homing': (
        'PREPARING', pause_then(resume), {}, f'PREPARING PAUSED {START} {LAYER} {END}', 0),
    'nothing seen': ('SCANNING', unseen, {}, f'{START} FAILED', Code.SCAN_FAILED),
    'aborted scanning': ('SCANNING', abort, {}, f'{START} ABORTED', Code.ABORTED),
    'paused scanning': (
        'SCANNING', pause_then(resume), {}, f'{START} PAUSED SCANNING {LAYER} {END}', 0),
    'pyrometer lost': ('COOLING', unbelieved, {}, f'{START} COOLING FAILED', Code.MACHINE_NOT_READY),
    'stays hot': ('COOLING', stays_hot, {}, f'{START} COOLING FAILED', Code.TIMEOUT),
    'aborted cooling': ('COOLING', abort, {}, f'{START} COOLING ABORTED', Code.ABORTED),
    'paused cooling': (
        'COOLING', pause_then(resume), {}, f'{START} COOLING PAUSED {LAYER} {END}', 0),
    'rescan': (
        'COOLING', wish('rescan'), {}, f'{START} COOLING SCANNING CORRECTING DEPOSITING SCANNING {END}', 0),
    'rescan in open loop': (
        'COOLING', wish('rescan'), {'loop_mode': 'open_loop'},
        f'{START} COOLING SCANNING DEPOSITING SCANNING {END}', 0),
    'first layer skipped': (
        'COOLING', wish('skip_layer'), {'layers': 2}, f'{START} {LAYER} {END}', 0),
    'last layer skipped': ('COOLING', wish('skip_layer'), {}, f'{START} COOLING {END}', 0),
    'not homed any more': (
        'CORRECTING', not_homed, {}, f'{START} COOLING CORRECTING FAILED', Code.MACHINE_NOT_READY),
    'alarm': (
        'DEPOSITING', in_a_bead(machine(state='ALARM', fault=300)), {},
        f'{START} COOLING CORRECTING DEPOSITING FAILED', Code.DEPOSITION_FAILED),
    'link lost': (
        'DEPOSITING', machine(age=9.0), {},
        f'{START} COOLING CORRECTING DEPOSITING FAILED', Code.LINK_LOST),
    'controller unplugged': (
        'DEPOSITING', machine(connected=False), {},
        f'{START} COOLING CORRECTING DEPOSITING FAILED', Code.LINK_LOST),
    'node silent': (
        'DEPOSITING', in_a_bead(machine(state='HOLD', fault=202, silent_nodes=('recorder',))), {},
        f'{START} COOLING CORRECTING DEPOSITING FAILED', Code.NODE_LOST),
    'aborted depositing': (
        'DEPOSITING', abort, {}, f'{START} COOLING CORRECTING DEPOSITING ABORTED', Code.ABORTED),
    'paused depositing': (
        'DEPOSITING', pause_then(resume), {},
        f'{START} COOLING CORRECTING DEPOSITING PAUSED DEPOSITING SCANNING {END}', 0),
    'held at the machine': (
        'DEPOSITING', in_a_bead(held_at_the_machine), {},
        f'{START} COOLING CORRECTING DEPOSITING PAUSED DEPOSITING SCANNING {END}', 0),
    'the wire jams': (
        'DEPOSITING', in_a_bead(the_wire_jams), {},
        f'{START} COOLING CORRECTING DEPOSITING PAUSED DEPOSITING SCANNING {END}', 0),
    'aborted in a pause': (
        'DEPOSITING', pause_then(abort), {},
        f'{START} COOLING CORRECTING DEPOSITING PAUSED ABORTED', Code.ABORTED),
    'alarm in a pause': (
        'DEPOSITING', pause_then(machine(state='ALARM', fault=301)), {},
        f'{START} COOLING CORRECTING DEPOSITING PAUSED FAILED', Code.DEPOSITION_FAILED),
    'link lost in a pause': (
        'DEPOSITING', pause_then(machine(age=9.0)), {},
        f'{START} COOLING CORRECTING DEPOSITING PAUSED FAILED', Code.LINK_LOST),
}  # fmt: skip


@pytest.mark.parametrize('name', CASES)
def test_path_through_the_states(name, make_cell, make_runner):
    where, what, goal, path, code = CASES[name]
    cell = make_cell()
    runner, control, _ = make_runner(cell, **{'layers': 1, **goal})
    if where:
        Script(where, what).attach(cell, control)
    status = runner.run()
    states = [s.state.name for s in cell.statuses]
    seen = [a for a, b in pairwise([*states, '']) if a != b]
    assert (' '.join(seen), status.error_code) == (path, int(code)), status.message


@pytest.mark.parametrize(
    'fault,kind',
    [(204, 'arc'), (207, 'gas'), (209, 'arc'), (210, 'temperature'), (203, 'link')],
)
def test_hold_of_the_controller_ends_the_job_with_class_and_place(
    fault, kind, make_cell, make_runner
):
    cell = make_cell()
    runner, control, _ = make_runner(cell, layers=1)

    in_a_bead(machine(state='HOLD', fault=fault, fault_text='told'))(cell, control)
    assert runner.run().error_code == Code.DEPOSITION_FAILED
    found = [a for a in cell.anomalies if a.severity == 'FAULT']
    assert len(found) == 1 and found[0] == runner.journal.anomalies[-1]
    a = found[0]
    assert (a.class_name, a.reaction) == (kind, 'hold, job ended') and 'told' in a.text
    assert a.layer == 1 and a.bead >= 1 and a.time > 1000.0
    assert a.position == cell.machine_state.position and a.position != (0.0, 0.0, 0.1)


@pytest.mark.parametrize('fault,kind', [(205, 'arc'), (206, 'wire'), (211, 'wire')])
def test_a_job_without_wire_or_arc_waits_with_the_reason_and_goes_on(
    fault, kind, make_cell, make_runner
):
    """Source 002, 3.4: underfeed pauses the job."""
    cell = make_cell()
    runner, control, _ = make_runner(cell, layers=1)
    said: list[str] = []

    def mend(cell, control) -> None:
        said.append(runner.status.message)
        control.resume()

    def jam(cell, control) -> None:
        machine(state='HOLD', fault=fault, fault_text='too slow')(cell, control)
        control.resume()
        pause_then(mend)(cell, control)
        control.resume()

    in_a_bead(jam)(cell, control)
    assert runner.run().state == State.DONE, runner.status.message
    assert said == ['paused: too slow; resume or abort'] and 'RESUME' in cell.commands
    (a,) = [a for a in cell.anomalies if a.severity == 'FAULT']
    assert (a.class_name, a.text) == (kind, 'too slow') and 'job paused' in a.reaction


@pytest.mark.parametrize('state', ['COOLING', 'DEPOSITING'])
def test_a_pause_may_last_over_night(state, make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell, layers=1)

    def next_morning(cell, control) -> None:
        cell.time += 15 * 3600.0
        control.resume()

    Script(state, pause_then(next_morning)).attach(cell, control)
    assert runner.run().state == State.DONE, runner.status.message


def test_machine_that_finishes_nothing_any_more_ends_the_job(make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell, layers=1)

    def stuck(cell, _control) -> None:
        cell.pace = 0  # it says RUN and does nothing
        inner = cell.wait
        cell.wait = lambda s: inner(s + 1.0)

    in_a_bead(stuck)(cell, control)
    status = runner.run()
    assert status.error_code == Code.TIMEOUT and 'no segment was finished' in status.message


def test_lease_that_runs_out_again_and_again_ends_the_job(make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell, layers=1)
    inner = cell.command

    def command(name, **fields) -> None:
        inner(name, **fields)
        if name == 'RESUME':
            machine(state='HOLD', fault=202)(cell, control)

    cell.command = command
    in_a_bead(machine(state='HOLD', fault=202))(cell, control)
    status = runner.run()
    assert status.error_code == Code.DEPOSITION_FAILED and '4 times in this job' in status.message
    assert cell.commands.count('RESUME') == runner.context.settings.limits.lease_retries


def drawn() -> set[tuple[str, str]]:
    """The pairs of the table in docs/job.md."""
    table = DOC.read_text().split('| from | to | when |')[1].split('\n\n')[0]
    rows = re.findall(r'^\| ([A-Z]+) \| ([A-Z, ]+) \|', table, re.M)
    return {(a, b.strip()) for a, targets in rows for b in targets.split(',')}


def test_every_drawn_transition_is_gone_through_and_every_one_seen_is_drawn():
    seen = {pair for case in CASES.values() for pair in pairwise(case[3].split())}
    in_the_node = {('IDLE', 'VALIDATING'), ('VALIDATING', 'PREPARING'), ('VALIDATING', 'FAILED')}
    assert drawn() == seen | in_the_node
