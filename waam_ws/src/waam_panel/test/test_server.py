"""What the page asks for and gets: commands with their limits, uploads, reports, pages that hang. No ROS."""

from __future__ import annotations

import asyncio
import json
import math
import socket
import sys
from pathlib import Path
from urllib.parse import quote
from urllib.request import urlopen

import aiohttp
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from panel_client import post
from panel_requests import MACHINE, ask, get, tell, until

from waam_panel.api import COMMANDS
from waam_panel.commanding import SAFE
from waam_panel.shop_api import QUEUE

SETUP = {'part': 'block.stl', 'as_found': 'block_worn.stl'}


def test_commands_arrive_in_si(panel):
    for name, data, asked in (
        ('jog', {'axis': 'x', 'direction': -1, 'step': 10}, ('jog', (-0.01, 0.0, 0.0), 0.02)),
        ('jog', {'axis': 'z', 'direction': 1, 'step': 50, 'held': True}, ('jog', (0.0, 0.0, 0.0075), 0.03)),
        ('jog_wire', {'mm': -10}, ('jog_wire', -0.01)),
        ('override', {'speed': 0.8, 'wire': 1.2}, ('override', 0.8, 1.2)),
        ('gain', {'value': 0.1}, ('adjust', 'SET_K_GAIN', 0.1)),
        ('skip_layer', {}, ('adjust', 'SKIP_LAYER', 0.0)),
        ('home', {}, ('command', 'HOME')),
        ('zero', {}, ('set_zero',)),
    ):  # fmt: skip
        assert ask(panel, name, data)[0] == 200, name
        assert panel.operations.asked[-1] == asked


def test_values_out_of_their_limits_are_refused_and_go_nowhere(panel):
    for name, data in (
        ('jog', {'axis': 'a', 'direction': 1, 'step': 1}), ('jog', {'axis': 'x', 'direction': 1, 'step': 500}),
        ('jog', {'axis': 'x', 'direction': 2, 'step': 1}), ('jog_wire', {'mm': 51}), ('jog_wire', {'mm': 'x'}),
        ('jog_wire', {'mm': True}), ('override', {'speed': 2.1}), ('override', {'wire': 0.4}), ('override', {}),
        ('override', {'speed': 1, 'x': 1}), ('gain', {'value': 0.6}), ('acknowledge', {'id': 'all'}),
    ):  # fmt: skip
        status, answer = ask(panel, name, data)
        assert status == 400 and not answer['ok'] and answer['message'], (name, data)
    assert panel.operations.asked == []


def test_what_makes_the_cell_safe_is_done_whatever_else_is_asked(panel):
    for name in SAFE:
        status, answer = ask(panel, name, {'idd': 3})
        assert status == 200 and answer['ok'] and panel.operations.asked, name


def test_a_field_that_a_command_does_not_know_is_refused_by_name(panel):
    """What was meant may have been narrower: `acknowledge` with a mistyped id acknowledged all alarms."""
    panel.cell.state.alarms.set('x', 1.0, 'controller', '204', 3, 'the arc was lost')
    with_care = [n for n in COMMANDS if n not in SAFE]
    for name in (*with_care, *QUEUE, 'standoff', 'notify_test', 'program/start'):
        status, answer = ask(panel, name, {'idd': 3})
        assert status in (400, 409), name
        assert 'unknown field' in answer['message'] and 'idd' in answer['message']
    assert panel.operations.asked == []
    assert not any(a['acknowledged'] for a in panel.cell.state.alarms.listing())


STANDOFF = {
    'source': 'arc', 'law': 'relay', 'set_mm': None, 'up_mm': 5, 'down_mm': 0, 'wander_mm': 1.2,
}  # fmt: skip


def test_the_standoff_control_is_read_and_set_in_mm(panel):
    shown = json.loads(get(panel, '/api/standoff')[1])
    assert [shown[n] for n in STANDOFF] == ['laser', 'pid', 100.0, 6.0, 4.0, 1.6]
    assert 'arc' in shown['sources'] and shown['limits_mm']['up_mm'] == [0.0, 20.0]
    assert ask(panel, 'standoff', STANDOFF)[0] == 200
    (name, wanted), *_ = panel.operations.asked
    assert name == 'set_standoff' and math.isnan(wanted.distance)
    assert (wanted.source, wanted.law, wanted.up, wanted.down) == ('arc', 'relay', 0.005, 0.0)
    assert wanted.wander == pytest.approx(0.0012)


def test_a_standoff_that_means_nothing_goes_nowhere(panel):
    for wrong in (
        {'source': 'sonar'}, {'law': None}, {'set_mm': 4}, {'up_mm': 21}, {'down_mm': None}, {'up_mm': True},
        {'wander_mm': 5.1}, {'wander_mm': -0.1}, {'wander_mm': None},
    ):  # fmt: skip
        status, answer = ask(panel, 'standoff', STANDOFF | wrong)
        assert status == 400 and next(iter(wrong)) in answer['message'], wrong
    assert panel.operations.asked == []


def test_the_standoff_control_is_not_set_while_a_job_runs(panel):
    panel.cell.state.sections['job'] = {'state': 'DEPOSITING'}
    status, answer = ask(panel, 'standoff', STANDOFF)
    assert status == 409 and 'a job is running' in answer['message']
    assert panel.operations.asked == []


def test_the_page_is_told_the_limits_of_the_overrides(panel):
    limits = json.loads(get(panel, '/api/choices')[1])['override_limits']
    assert set(limits) == {'speed', 'wire'}
    for name, (low, high) in limits.items():
        found = [ask(panel, 'override', {name: x})[0] for x in (low - 0.01, low, high, high + 0.01)]
        assert found == [400, 200, 200, 400], name
    said = ask(panel, 'override', {})[1]['message']
    assert said == 'override: speed 0.1 to 2, wire 0.5 to 1.5'


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.sampled_from(['jog', 'override', 'load', 'gain', 'acknowledge', 'jog_wire']),
    st.binary(max_size=60),
)
def test_no_body_brings_the_server_down(panel, name, body):
    assert post(panel, name, body)[0] in (400, 409)


def test_words_of_the_machine_reach_the_operator(panel):
    panel.operations.refuse = 'HOME: the controller is in ALARM, not IDLE'
    status, answer = ask(panel, 'home')
    assert (status, answer['message']) == (409, panel.operations.refuse)


def test_load_arm_start_in_this_order_only(panel, write_part):
    write_part(panel.folder / 'parts')
    for name in ('arm', 'start', 'preview'):
        assert ask(panel, name) == (409, {'ok': False, 'message': 'load a part first'})
    status, answer = ask(panel, 'load', SETUP | {'material': 'lead'})
    assert status == 409 and 'material' in answer['message']
    status, answer = ask(panel, 'load', SETUP | {'part': '../block.stl'})
    assert status == 409
    assert ask(panel, 'load', SETUP)[0] == 200
    tell(panel, 'machine', MACHINE)
    assert ask(panel, 'start')[1]['message'] == 'press Arm first'
    assert ask(panel, 'arm')[0] == 200
    tell(panel, 'machine', MACHINE | {'armed': True})
    assert ask(panel, 'start')[0] == 200
    name, setup, part, jobs = panel.operations.asked[-1]
    assert (name, setup.part, part.name, jobs) == (
        'start',
        'block.stl',
        'block.stl',
        panel.folder / 'jobs',
    )
    tell(panel, 'job', {'state': 'DEPOSITING', 'dir': ''})
    for name, data in (('start', {}), ('load', SETUP)):
        assert ask(panel, name, data)[1]['message'] == 'a job is running'
    assert ask(panel, 'pause')[0] == 200
    assert panel.operations.asked[-1] == ('pause', True)


def test_an_interrupted_job_goes_on_after_arm_and_start(panel):
    folder = panel.folder / 'jobs/20260101T000000Z_anvil'
    folder.mkdir(parents=True)
    (folder / 'job.yaml').write_text('job_id: x')
    (folder / 'status.json').write_text('{"state": "DONE"}')
    status, answer = ask(panel, 'load_job', {'id': folder.name})
    assert (status, answer['ok']) == (409, False)
    (folder / 'status.json').write_text('{"state": "INTERRUPTED"}')
    assert json.loads(get(panel, '/api/jobs')[1])[0]['can_go_on']
    assert ask(panel, 'load_job', {'id': '../jobs'})[0] == 409
    assert ask(panel, 'load_job', {'id': folder.name})[0] == 200
    assert ask(panel, 'arm')[0] == 200
    tell(panel, 'machine', MACHINE | {'armed': True})
    assert ask(panel, 'start')[0] == 200
    assert panel.operations.asked[-1] == ('resume_job', folder)


def test_preview_plans_the_part_and_says_why_it_cannot(panel, write_part):
    part, _ = write_part(panel.folder / 'parts')
    assert get(panel, '/api/preview.png')[0] == 404
    ask(panel, 'load', SETUP)
    status, answer = ask(panel, 'preview')
    assert status == 200, answer
    assert 'layer' in answer['table'] and get(panel, '/api/preview.png')[1].startswith(b'\x89PNG')
    torn = panel.folder / 'parts/torn.stl'
    torn.write_bytes(part.read_bytes()[:200])
    status, answer = ask(panel, 'load', SETUP | {'part': 'torn.stl'})
    assert status == 409 and 'torn.stl' in answer['message']  # nothing lies on the table then
    torn.write_bytes(part.read_bytes())
    assert ask(panel, 'load', SETUP | {'part': 'torn.stl'})[0] == 200
    torn.write_bytes(part.read_bytes()[:200])
    status, answer = ask(panel, 'preview')
    assert status == 409 and 'torn.stl' in answer['message']
    assert get(panel, '/api/preview.png')[0] == 404


def test_uploads_are_stored_bounded_and_never_overwrite(panel):
    assert ask(panel, 'parts?name=a.stl', b'solid')[1]['name'] == 'a.stl'
    assert ask(panel, 'parts?name=a.stl', b'other')[1]['name'] == 'a-2.stl'
    assert ask(panel, 'parts?name=../a.stl', b'x')[0] == 409
    assert sorted(f.name for f in (panel.folder / 'parts').iterdir()) == ['a-2.stl', 'a.stl']
    assert ask(panel, 'parts?name=big.stl', bytes(3 << 20))[0] == 413


def test_report_of_a_job_is_made_when_missing_and_served_without_scripts(panel):
    sys.path.insert(0, str(Path(__file__).parents[2] / 'waam_view/test'))
    from synthetic_job import write_job

    folder = panel.folder / 'jobs/20260101T000000Z_anvil'
    write_job(folder, layers=1)
    jobs = json.loads(get(panel, '/api/jobs')[1])
    assert [j['id'] for j in jobs] == [folder.name] and jobs[0]['report']

    with urlopen(f'{panel.url}/jobs/{folder.name}/report.html', timeout=60) as answer:
        policy, page = answer.headers['Content-Security-Policy'], answer.read().decode()
    assert 'tolerance' in page and (folder / 'report.html').is_file()
    assert 'sandbox' in policy and 'allow-scripts' not in policy
    assert get(panel, '/jobs/20990101T000000Z_none/report.html')[0] == 404


def test_alarms_are_acknowledged_once(panel):
    panel.cell.mailbox.put(('anomaly', {'class': 'scan', 'severity': 1, 'text': 'dirty'}))
    until(lambda: panel.cell.state.alarms.listing(), 'alarm')
    assert ask(panel, 'acknowledge', {'id': None})[1]['message'] == '1 acknowledged'
    assert panel.cell.state.alarms.listing()[0]['acknowledged']


def test_a_page_that_hangs_changes_nothing_for_the_others(panel):
    """A page that never reads: the pump and other pages go on, and nothing is queued for it."""
    start = (
        f'GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{panel.server.port}\r\nOrigin: {panel.url}\r\n'
        'Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
        'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n'
    )
    hanging = []
    for _ in range(3):
        s = socket.socket()
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        s.connect(('127.0.0.1', panel.server.port))
        s.sendall(start.encode())
        hanging.append(s)
    until(lambda: panel.cell.pages == 3, 'three pages')
    panel.cell.state.sections['setup'] = {'ballast': 'x' * 300_000}

    async def watch() -> list[dict]:
        async with aiohttp.ClientSession() as session:
            async with session.ws_connect(
                f'{panel.url}/stream', headers={'Origin': panel.url}, max_msg_size=0
            ) as ws:
                return [await ws.receive_json(timeout=30) for _ in range(20)]

    assert len(asyncio.run(watch())) == 20
    assert ask(panel, 'home')[0] == 200
    for s in hanging:
        s.close()
    until(lambda: panel.cell.pages == 0, 'pages let go')


def test_a_message_that_cannot_be_read_is_reported_and_the_next_one_is_shown(panel):
    panel.cell.mailbox.put(('machine', 'no message'))
    tell(panel, 'link', {'rate': 100})
    assert 'machine' in panel.cell.problem


def test_all_jobs_answer_with_rows_and_a_chart_and_link_what_the_panel_has(panel, made_jobs):
    for n, operator in ((1, 'Ada'), (2, 'Kim'), (3, 'Ada')):
        made_jobs(n, rms=n * 1e-4, operator=operator, arrays=False)
    status, body = get(panel, '/api/archive?operator=ada')
    found = json.loads(body)
    assert status == 200 and found['count'] == 2
    assert [j['operator'] for j in found['jobs']] == ['Ada', 'Ada']
    assert found['chart']['means'] == pytest.approx([0.1, 0.3])
    assert found['jobs'][0]['report'] == f'/jobs/{found["jobs"][0]["job"]}/report.html'


def test_new_jobs_are_not_taken_in_beside_a_running_one(panel, made_jobs):
    made_jobs(1, arrays=False)
    assert json.loads(get(panel, '/api/archive')[1])['count'] == 1
    made_jobs(2, arrays=False)
    asked = panel.cell.archive.answer
    assert asked({}, look=False)['count'] == 1
    assert asked({}, look=True)['count'] == 2


def test_questions_that_mean_nothing_are_refused(panel):
    for query in ('figure=rms;DROP', 'figure=%00', 'since=yesterday', f'part={"x" * 81}'):
        status, body = get(panel, f'/api/archive?{query}')
        assert status == 400 and json.loads(body)['message'], query


def test_no_filter_becomes_sql_or_a_path(panel, made_jobs):
    made_jobs(1, arrays=False)
    for text in ("' OR 1=1 --", '[a', '../../etc/passwd', '%', '\\'):
        status, body = get(panel, f'/api/archive?part={quote(text)}')
        assert status == 200 and json.loads(body)['count'] == 0, text


def test_a_job_whose_node_died_is_told_to_other_cells_as_unknown(panel, monkeypatch):
    """In the list of cells at once, in the audit log a little later; the queue starts nothing meanwhile."""
    from waam_panel.shop_link import view_of

    monkeypatch.setattr('waam_panel.state.GONE_S', 4.0)
    link = panel.cell.shop
    panel.speak(('machine', MACHINE), ('job', panel.job('DEPOSITING')))
    until(lambda: link.status(panel.cell).job_state == 'DEPOSITING', 'the job')
    panel.living = ('bridge',)
    del panel.saying['job']
    until(lambda: link.status(panel.cell).job_state == 'UNKNOWN', 'not known')
    assert link.status(panel.cell).job_message.startswith('job_sequencer does not answer since')
    assert view_of(panel.cell).job_state == ''
    until(lambda: panel.cell.state.lost_job, 'given up')
    told = link.status(panel.cell)
    assert (told.job, told.job_message) == (
        '20260101_jaw',
        'ended unknown: job_sequencer died or hangs',
    )
    status, answer = ask(panel, 'load', SETUP)
    assert status == 409 and 'job_sequencer does not answer since' in answer['message']
    panel.speak(('machine', MACHINE), ('job', panel.job('IDLE')))  # it was started again
    until(lambda: view_of(panel.cell).job_state == 'IDLE', 'back')
    assert link.status(panel.cell).job_message.startswith('ended unknown')
    panel.saying['job'] = panel.job('SCANNING', id='20260102_next')
    until(lambda: link.status(panel.cell).job == '20260102_next', 'the next job')


def test_programs_are_not_started_again_while_the_cell_works(panel):
    stands = ('machine', MACHINE), ('telemetry', panel.still()), ('job', panel.job('IDLE'))
    for name, value, why in (
        ('telemetry', panel.still(arc_enabled=True), 'the arc is on'),
        ('telemetry', panel.still(state='RUN'), 'moves or holds'),
        ('machine', MACHINE | {'state': 'HOLD'}, 'moves or holds'),
        ('job', panel.job('COOLING'), 'a job is running'),
    ):
        panel.speak(*stands)
        panel.saying[name] = value
        until(lambda w=why: w in ask(panel, 'restart_programs')[1]['message'], why)
        panel.operations.asked.clear()  # of before the cell had said anything
        assert why in ask(panel, 'restart_programs')[1]['message'] and not panel.operations.asked
    panel.speak(*stands)
    until(lambda: ask(panel, 'restart_programs')[0] == 200, 'started again')


def test_a_job_whose_program_was_started_again_at_once_has_ended_unknown(panel):
    """The new job_sequencer tells IDLE before the old one was missed."""
    state, job = panel.cell.state, {'error_code': 0, 'message': '', 'layer': 1, 'layers': 3}
    state.apply('job', job | {'id': 'one', 'state': 'DEPOSITING'}, 1.0, 1.0)
    state.apply('job', job | {'id': '', 'state': 'IDLE'}, 2.0, 2.0)
    assert state.lost_job == {'id': 'one', 'why': 'ended unknown: job_sequencer died or hangs'}
    state.apply('job', job | {'id': 'two', 'state': 'VALIDATING'}, 3.0, 3.0)
    assert state.lost_job is None
