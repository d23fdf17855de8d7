"""Alarms, state, parts, setup, history, pictures: the parts of the panel that need neither ROS nor a server."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from waam_panel import alarms, history, pictures
from waam_panel.alarms import AlarmLog
from waam_panel.parts import PartFolders, PartsError
from waam_panel.setup_form import FormError, JobSetup, parse
from waam_panel.state import PanelState, Sample
from waam_process.grid import GridSpec
from waam_process.names import ANOMALY_CLASSES
from waam_process.unrolled import Unrolled

ROOT = Path(__file__).parents[4]
MATERIALS = ('er70s-6', '316l')

# ---- alarms


def test_every_controller_code_of_the_link_has_its_line():
    text = (ROOT / 'docs/link_protocol.md').read_text()
    part = text.split('## Codes')[1].split('\n## ')[0]
    codes = set(re.findall(r'(?<![\dE])([1-3]\d\d)(?!x|\d)', part))
    assert len(codes) >= 20
    assert codes <= alarms.table()['controller'].keys()


def test_every_job_code_and_anomaly_class_has_its_line():
    source = ROOT / 'waam_ws/src/waam_msgs'
    codes = re.findall(r'^int32 [A-Z_]+=(\d+)', (source / 'action/RunJob.action').read_text(), re.M)
    assert {c for c in codes if c != '0'} == alarms.table()['job'].keys()
    assert set(ANOMALY_CLASSES) == alarms.table()['anomaly'].keys()


def test_every_line_says_cause_and_action_and_the_manual_has_the_table():
    for rows in alarms.table().values():
        for advice in rows.values():
            assert all(len(v) > 2 for v in dataclasses.astuple(advice))
    assert alarms.markdown() in (ROOT / 'waam_ws/src/waam_panel/doc/alarms.md').read_text()
    assert alarms.advice('job', 4711).action


def test_alarms_are_counted_end_and_are_acknowledged():
    log = AlarmLog()
    log.set('fault', 1.0, 'controller', 204, 2, 'arc lost')
    log.set('fault', 2.0, 'controller', 204, 2, 'arc lost')
    log.event(3.0, 'anomaly', 'scan', 1, 'dirty')
    log.event(4.0, 'anomaly', 'scan', 1, 'dirty')
    first, second = log.listing()[::-1]
    assert (first['code'], first['active'], first['title']) == ('204', True, 'Arc lost')
    assert second['count'] == 2 and not second['active']
    log.set('fault', 5.0, 'controller', 300, 3, 'emergency stop')
    assert [a['active'] for a in log.listing()] == [True, False, False]
    assert log.acknowledge(first['id']) == 1 and log.acknowledge(first['id']) == 0
    assert log.acknowledge() == 2
    before = log.version
    log.clear('fault')
    assert log.version > before and not any(a.active for a in log)


def test_the_controller_s_words_in_an_anomaly_are_not_listed_twice():
    state = PanelState(10)
    anomaly = {'class': 'arc', 'severity': 2, 'text': 'HOLD E205 no arc'}
    hold = MACHINE | {'state': 'HOLD', 'fault': 205, 'fault_text': 'no arc'}
    state.apply('anomaly', anomaly, 0, 1.0)
    state.apply('machine', hold, 0, 2.0)
    state.apply('anomaly', anomaly, 0, 3.0)
    assert [(a['kind'], a['code'], a['active']) for a in state.alarms.listing()] == [
        ('controller', '205', True)
    ]
    state.alarms.acknowledge()
    state.apply('machine', MACHINE, 0, 4.0)
    state.apply('machine', hold, 0, 5.0)  # again: a new alarm
    assert [a['acknowledged'] for a in state.alarms.listing()] == [False, True]


def test_the_list_is_bounded_and_forgets_what_was_dealt_with_first():
    log = AlarmLog(kept=5)
    for i in range(4):
        log.event(i, 'job', 100 + i, 3, '')
    log.acknowledge(2)
    for i in range(4, 7):
        log.event(i, 'job', 100 + i, 3, '')
    assert [a['code'] for a in log.listing()] == ['106', '105', '104', '103', '102']


def code_of(top) -> str | None:
    return top.code if top else None


def test_the_banner_has_the_cause_of_the_end_of_a_job_and_nothing_of_a_job_before():
    log = AlarmLog()
    log.job(alarms.RUNNING)
    log.event(1.0, 'anomaly', 'scan', 1, 'dirty')
    log.set('fault', 2.0, 'controller', 204, 2, 'arc lost')
    assert code_of(log.top()) == '204'
    log.clear('fault')
    log.job(alarms.ENDED)
    log.event(3.0, 'job', 108, 2, 'layer 2: HOLD E204 arc lost')
    assert code_of(log.top()) == '204'
    log.event(4.0, 'job', 107, 2, 'too few points')  # says all itself, and is newer
    assert code_of(log.top()) == '107'
    log.acknowledge(log.top().id)
    assert log.acknowledge(log.top().id) == 2  # the cause, and the end that it has caused
    assert code_of(log.top()) == 'scan'
    log.set('link', 5.0, 'condition', 'disconnected', 3, '')
    log.job(alarms.RUNNING)
    assert code_of(log.top()) == 'disconnected'  # it still holds
    log.clear('link')
    assert log.top() is None and log.worst() is None
    assert [a['history'] for a in log.listing()] == [True] * 5
    log.event(6.0, 'anomaly', 'scan', 1, 'dirty')  # again, in this job
    assert code_of(log.top()) == 'scan' and log.top().count == 2


def test_a_generic_end_of_a_job_gives_way_to_the_newest_fault_of_it():
    log = AlarmLog()
    log.job(alarms.RUNNING)
    log.set('gone', 1.0, 'condition', 'gone', 3, 'no answer from scan_fusion')
    log.clear('gone')
    log.job(alarms.ENDED)
    log.event(2.0, 'job', 109, 2, 'scan_fusion did not answer')
    assert code_of(log.top()) == 'gone'
    log = AlarmLog()
    log.event(2.0, 'job', 108, 2, 'E205 no arc')  # nobody told of E205
    assert code_of(log.top()) == '108'


def test_what_to_do_depends_on_what_the_job_does():
    log = AlarmLog()
    log.job(alarms.RUNNING)
    log.event(1.0, 'controller', 202, 2, 'lease ran out')
    log.event(1.0, 'controller', 204, 2, 'arc lost')

    def action(code: str) -> str:
        return next(a['action'] for a in log.listing() if a['code'] == code)

    assert 'resumes by itself' in action('202') and 'start the job again' in action('204')
    log.job(alarms.PAUSED)
    assert 'resumes by itself' not in action('202')
    assert 'spool' in action('204') and 'Resume' in action('204')
    log.job(alarms.ENDED)
    assert 'does not go on by itself' in action('202') and 'Resume' not in action('204')
    log.job(alarms.RUNNING)  # another job: these belong to the one before
    assert 'does not go on by itself' in action('202')


def test_no_text_for_an_ended_job_speaks_of_resuming_it():
    for kind, rows in alarms.otherwise()[alarms.ENDED].items():
        assert set(rows) <= set(alarms.table()[kind])
        assert not [c for c, text in rows.items() if re.search(r'\bResume\b|by itself when', text)]
    for kind, rows in alarms.table().items():
        for code, advice in rows.items():
            waits = re.search(r'job (waits|resumes)|Resume strikes', advice.action)
            assert not waits or code in alarms.otherwise()[alarms.ENDED].get(kind, {}), (kind, code)


# ---- state


def sample(i: int, **changes) -> Sample:
    values = {
        't': 100.0 + i, 'position': (0.01, 0.02, 0.03), 'current': 180.0, 'voltage': 22.0, 'feed_commanded': 0.1,
        'feed': 0.099, 'speed': 0.01, 'state': 'RUN', 'arc': True, 'arc_enabled': True, 'gas': True,
        'speed_override': 0.8, 'wire_override': 1.0, 'lease_left': 0.4,
    }  # fmt: skip
    return Sample(**{**values, **changes})


MACHINE = {
    'connected': True,
    'silent': [],
    'state': 'RUN',
    'fault': 0,
    'fault_text': '',
    'message': '',
}


def test_a_page_gets_each_sample_once_and_sees_what_is_old():
    state = PanelState(kept=50)
    for i in range(30):
        state.apply('telemetry', sample(i), 10.0, 0.0)
    frame = state.frame(10.5, 0)
    assert len(frame['samples']) == 30 and 'telemetry' not in frame['stale']
    assert 'temperature' in frame['stale']
    state.apply('telemetry', sample(30), 11.0, 0.0)
    assert [s[0] for s in state.frame(11.0, 30)['samples']] == [130.0]
    for i in range(200):
        state.apply('telemetry', sample(i), 12.0, 0.0)
    assert len(state.frame(12.0, 31)['samples']) == 50  # a page that was away: what is kept
    assert 'telemetry' in state.frame(14.0, 0)['stale']
    nan = float('nan')
    state.apply('telemetry', sample(1, current=nan, position=(nan, 0.0, 0.0)), 14.0, 0.0)
    json.dumps(state.frame(14.0, 0), allow_nan=False)


def test_a_torch_over_a_shaft_is_shown_in_its_first_turn():
    state = PanelState(kept=50)
    state.shaft = shaft = Unrolled(0.04)
    x = 0.05 + 3 * shaft.period
    state.apply('telemetry', sample(0, position=(x, 0.02, 0.03)), 10.0, 0.0)
    shown = state.sections['telemetry']
    assert shown['position'][0] == pytest.approx(x * 1e3, abs=1e-3)
    assert shown['place'] == pytest.approx([50.0, 20.0, 30.0], abs=1e-3)
    assert state.frame(10.1, 0)['samples'][0][9] == pytest.approx(50.0, abs=1e-3)


def test_commanded_speed_is_that_of_the_nearest_segment_with_the_override():
    state = PanelState(10)
    ends = np.array([[0.0, 0.02], [0.02, 0.02]]), np.array([[0.02, 0.02], [0.02, 0.06]])
    plan = {'path': {}, 'start': ends[0], 'end': ends[1], 'speed': np.array([0.01, 0.03])}
    state.apply('plan', plan, 0.0, 0.0)
    state.apply('telemetry', sample(0), 0.0, 0.0)
    assert state.sections['telemetry']['speed_commanded'] == 8.0
    state.apply('telemetry', sample(0, arc=False), 0.0, 0.0)
    assert state.sections['telemetry']['speed_commanded'] is None


def test_the_power_up_alarm_is_acknowledged_by_the_reset_that_ends_it():
    """A job resets the controller itself; its banner must not stand over the job."""
    state = PanelState(10)
    power_up = MACHINE | {'state': 'ALARM', 'fault': 306, 'fault_text': 'power-up: reset needed'}
    state.apply('machine', power_up, 0, 1.0)
    (alarm,) = state.alarms.listing()
    assert alarm['active'] and not alarm['acknowledged']
    state.apply('machine', MACHINE, 0, 2.0)
    (alarm,) = state.alarms.listing()
    assert not alarm['active'] and alarm['acknowledged']
    state.apply('machine', power_up, 0, 3.0)  # switched on again: a new alarm
    assert [a['acknowledged'] for a in state.alarms.listing()] == [False, True]
    emergency = MACHINE | {'state': 'ALARM', 'fault': 300, 'fault_text': 'emergency stop'}
    state.apply('machine', emergency, 0, 4.0)
    state.apply('machine', MACHINE, 0, 5.0)
    assert not state.alarms.listing()[0]['acknowledged']  # that one a person has to see


def program(**changes) -> dict:
    row = {'node': 'recorder', 'level': 0, 'message': 'ready', 'viewer': '', 'restarted': ''}
    return row | changes


def test_a_node_that_was_started_again_is_said_once_with_its_reason():
    state = PanelState(10)
    state.apply('diagnostics', [program()], 0, 1.0)
    assert not state.alarms.listing()
    for t in (2.0, 3.0):
        state.apply('diagnostics', [program(restarted='recorder gave no sign of life')], 0, t)
    (alarm,) = state.alarms.listing()
    assert (alarm['code'], alarm['count']) == ('restarted', 1)
    assert alarm['text'] == 'recorder gave no sign of life' and alarm['severity'] == 1


def test_faults_of_the_machine_become_alarms_and_end():
    state = PanelState(10)
    state.apply('machine', MACHINE | {'state': 'HOLD', 'fault': 206, 'fault_text': 'wire'}, 0, 1.0)
    state.apply('machine', MACHINE | {'state': 'ALARM', 'fault': 300}, 0, 2.0)
    state.apply('machine', MACHINE | {'connected': False, 'message': 'no answer'}, 0, 3.0)
    state.apply('machine', MACHINE | {'silent': ['scan_fusion']}, 0, 4.0)  # late for a moment
    assert 'silent' not in [a['code'] for a in state.alarms.listing()]
    state.apply('machine', MACHINE | {'silent': ['scan_fusion']}, 0, 6.0)
    found = [(a['code'], a['active']) for a in state.alarms.listing()]
    state.apply('machine', MACHINE | {'state': 'HOLD', 'fault': 200}, 0, 5.0)  # a pause
    assert [a['code'] for a in state.alarms.listing()] == [code for code, _ in found]
    assert found == [('silent', True), ('disconnected', False), ('300', False), ('206', False)]


def test_the_end_of_a_job_is_an_alarm_only_when_it_happens_now():
    state = PanelState(10)
    ended = {'state': 'FAILED', 'error_code': 108, 'message': 'arc lost', 'dir': ''}
    state.apply('job', ended, 0, 0)  # latched from before the panel started
    assert not state.alarms.listing() and state.job_ends == 0
    state.apply('job', ended | {'state': 'DEPOSITING'}, 0, 0)
    assert state.job_running
    state.apply('job', ended, 0, 0)
    assert [a['code'] for a in state.alarms.listing()] == ['108'] and state.job_ends == 1


# ---- parts, setup, history, pictures


def test_uploads_keep_their_names_and_overwrite_nothing(tmp_path):
    folders = PartFolders((tmp_path / 'up', tmp_path / 'given'))
    (tmp_path / 'given').mkdir()
    (tmp_path / 'given/jaw.stl').write_bytes(b'1')
    assert folders.save('block.stl', b'a') == 'block.stl'
    assert folders.save('block.stl', b'a') == 'block.stl'
    assert folders.save('block.stl', b'b') == 'block-2.stl'
    assert {p['name'] for p in folders.listing()} == {'block.stl', 'block-2.stl', 'jaw.stl'}
    assert folders.find('jaw.stl').read_bytes() == b'1'
    for name in ('../x.stl', 'x.txt', '.stl', 'a/b.stl', '', 'x' * 90 + '.stl', 'ü.stl'):
        with pytest.raises(PartsError):
            folders.save(name, b'x')
    with pytest.raises(PartsError, match='empty'):
        folders.save('empty.stl', b'')


@given(st.text(max_size=30))
def test_no_name_leads_out_of_the_part_folders(tmp_path_factory, name):
    root = tmp_path_factory.getbasetemp()
    (root / 'secret.stl').write_bytes(b'x')
    (root / 'parts').mkdir(exist_ok=True)
    folders = PartFolders((root / 'parts',))
    for tried in (name, f'../{name}', '../secret.stl', f'{root}/secret.stl'):
        with pytest.raises(PartsError):
            folders.find(tried)


def test_a_setup_names_everything_that_is_wrong():
    good = parse({'part': 'a.stl', 'layers': 2, 'k_gain': None, 'tolerance_mm': 0.1}, MATERIALS)
    assert good == JobSetup(part='a.stl', layers=2, tolerance_mm=0.1) or np.isnan(good.k_gain)
    bad = {
        'part': 'a.stl', 'layers': 1.5, 'material': 'lead', 'mode': 'weld', 'tolerance_mm': 9, 'k_gain': 0.6,
        'layer_height_mm': float('nan'), 'operator_name': 'x\ny', 'pwd': 1,
    }  # fmt: skip
    with pytest.raises(FormError) as e:
        parse(bad, MATERIALS)
    for name in bad.keys() - {'part'}:
        assert name in str(e.value)
    with pytest.raises(FormError, match='choose one'):
        parse({}, MATERIALS)


def test_wire_and_gas_are_noted_only_when_somebody_told_them():
    told = parse({'part': 'a.stl', 'wire_lot': ' 4711 ', 'gas': 'M21'}, MATERIALS)
    assert told.notes == ['started_from=panel', 'wire_lot=4711', 'gas=M21']
    assert parse({'part': 'a.stl', 'gas': ''}, MATERIALS).notes == ['started_from=panel']


@given(
    st.dictionaries(
        st.sampled_from([f.name for f in dataclasses.fields(JobSetup)]),
        st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.none()),
    )
)
def test_a_setup_is_refused_or_within_its_limits(data):
    try:
        setup = parse(data, MATERIALS)
    except FormError:
        return
    assert 0 <= setup.layers <= 1000 and 0.02 <= setup.tolerance_mm <= 5
    json.dumps(setup.as_dict(), allow_nan=False)


def test_history_lists_jobs_newest_first_and_survives_broken_files(tmp_path):
    assert history.jobs(tmp_path / 'none') == []
    for name, files in {
        '20260101T000000Z_a': {'report.json': '{"verdict": "in tolerance", "closed_loop": {"rms_mm": 0.2}}'},
        '20260102T000000Z_b': {'status.json': '{"state": "FAILED", "message": "arc", "profile": "monitor"}'},
        '20260103T000000Z_c': {'status.json': 'torn', 'report.json': '[1]'},
        'parts': {'x.stl': ''},
        '.run': {'state.json': '{}'},
    }.items():  # fmt: skip
        (tmp_path / name).mkdir()
        for file, text in files.items():
            (tmp_path / name / file).write_text(text)
    (tmp_path / 'latest').symlink_to('20260103T000000Z_c')
    c, b, a = history.jobs(tmp_path)
    assert (a['id'], a['state'], a['verdict'], a['rms_mm']) == (
        '20260101T000000Z_a',
        'DONE',
        'in tolerance',
        0.2,
    )
    assert (b['state'], b['message'], b['report']) == ('FAILED', 'arc', False)
    assert (a['loop_mode'], b['loop_mode']) == ('closed_loop', 'monitor')
    assert c['state'] == 'UNKNOWN'
    assert history.find(tmp_path, a['id']) == tmp_path / a['id']
    for name in ('parts', '.run', '..', '../x', 'latest', '', a['id'] + '/..'):
        with pytest.raises(history.HistoryError):
            history.find(tmp_path, name)


def test_maps_survive_the_way_to_the_page_and_are_thinned():
    z = np.linspace(-1e-3, 2e-3, 600 * 300).reshape(300, 600)
    z[0, 0] = np.nan
    picture = pictures.height_map(GridSpec(-0.005, 0.01, 5e-4, 300, 600), z)
    assert picture['cols'] <= pictures.MAX_PICTURE_CELLS and picture['cell'] == pytest.approx(
        1.5e-3
    )
    values = np.frombuffer(base64.b64decode(picture['data']), '<i2')
    values = values.reshape(picture['rows'], picture['cols'])
    assert values[0, 0] == pictures.UNKNOWN
    assert values[5, 7] * 1e-6 == pytest.approx(z[15, 21], abs=1e-6)


def test_paths_join_where_segments_meet_and_split_where_the_arc_changes():
    start = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [5, 5, 0]]) * 1e-3
    end = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [6, 5, 0]]) * 1e-3
    strips = pictures.paths(np.array([True, True, False, False]), start, end)['strips']
    assert [(s['arc'], len(s['points']) // 3) for s in strips] == [
        (True, 3),
        (False, 2),
        (False, 2),
    ]
    assert strips[0]['points'][-3:] == [1.0, 1.0, 0.0]


def test_parameters_file_readme_and_code_agree():
    from waam_node.params import markdown
    from waam_panel.panel_node import PanelParams

    package = Path(__file__).parents[1]
    listed = yaml.safe_load((package / 'config/panel.yaml').read_text())
    listed = listed['/**/panel']['ros__parameters']
    expected = {f.name: f.default for f in dataclasses.fields(PanelParams)}
    assert {k: tuple(v) if isinstance(v, list) else v for k, v in listed.items()} == expected
    assert markdown(PanelParams) in (package / 'README.md').read_text()


# ---- standoff


def test_what_the_standoff_control_says_is_shown_in_millimetres():
    from waam_msgs.msg import Standoff
    from waam_panel.conversions import CONVERT

    said = Standoff(source=1, alarm=0, known=True, set_distance=0.1, measured_distance=0.0995)
    said.correction = -0.75e-3
    shown = CONVERT['standoff'](said)
    assert shown == {
        'source': 'laser', 'set_mm': 100.0, 'measured_mm': 99.5, 'correction_mm': -0.75, 'alarm': '',
    }  # fmt: skip
    said.measured_distance, said.alarm = float('nan'), Standoff.ALARM_NO_READING
    shown = CONVERT['standoff'](said)
    assert (shown['measured_mm'], shown['alarm']) == (None, 'no reading')
    state = PanelState(10)
    state.apply('standoff', shown, 5.0, 1.0)
    assert state.sections['standoff'] == shown
    assert 'standoff' not in state.stale(8.0) and 'standoff' in state.stale(10.0)


def test_the_temperature_of_a_real_cell_is_shown_whoever_publishes_it_and_unknown_as_unknown():
    """There is no node `cell` then; a pyrometer that dies is an alarm."""
    from sensor_msgs.msg import Temperature

    from waam_panel.conversions import CONVERT

    state = PanelState(10)
    state.apply('temperature', CONVERT['temperature'](Temperature(temperature=312.44)), 5.0, 1.0)
    assert state.sections['temperature'] == {'value': 312.4}
    assert 'temperature' not in state.stale(6.0)
    assert state.stale(8.0)['temperature'] == 'nothing on temperature for 3 s'
    state.apply('temperature', CONVERT['temperature'](Temperature(temperature=np.nan)), 9.0, 1.0)
    assert state.sections['temperature'] == {'value': None}
    state.sources.lives('pyrometer', 9.0)
    state.look(10.0, 1.0)
    assert state.alarms.listing() == []
    state.look(20.0, 1.0)
    assert 'pyrometer' in state.alarms.listing()[0]['text']


def test_the_end_of_tracking_has_the_line_of_its_code():
    state = PanelState(10)
    anomaly = {'class': 'height', 'severity': 1, 'text': 'E212 the distance contradicts the arc'}
    state.apply('anomaly', anomaly, 0, 1.0)
    (shown,) = state.alarms.listing()
    assert (shown['kind'], shown['code'], shown['title']) == (
        'controller', '212', 'Torch distance not held',
    )  # fmt: skip


# ---- process control and bead width


def test_what_the_process_control_says_is_shown_with_its_unit():
    from waam_msgs.msg import ProcessControl
    from waam_panel.conversions import CONVERT

    said = ProcessControl(
        value=ProcessControl.VALUE_HEAT_INPUT, reference=255e3, measured=np.nan, speed_factor=1.04,
        wire_factor=1.0, operator_speed_factor=0.9, operator_wire_factor=1.0, frozen=True, reason='no arc',
    )  # fmt: skip
    shown = CONVERT['process'](said)
    assert (shown['value'], shown['unit'], shown['set'], shown['measured']) == (
        'heat input', 'J/mm', 255.0, None,
    )  # fmt: skip
    assert (shown['speed'], shown['operator_speed'], shown['frozen']) == (1.04, 0.9, 'no arc')
    said.frozen, said.limited = False, True
    assert CONVERT['process'](said) == shown | {'frozen': '', 'limited': True}
    state = PanelState(10)
    state.apply('process', shown, 5.0, 1.0)
    assert state.sections['process'] == shown
    assert 'process' not in state.stale(8.0) and 'process' in state.stale(10.0)


def test_the_bead_width_of_the_newest_scan_that_shows_one_is_shown():
    from waam_msgs.msg import HeightMap
    from waam_node.conversions import floats, grid_to_msg
    from waam_panel.conversions import CONVERT

    spec = GridSpec(0.0, 0.0, 1e-3, 3, 4)
    said = HeightMap(layer=2, grid=grid_to_msg(spec), z=floats(np.zeros(spec.shape)))
    said.bead_width, said.bead_width_u, said.bead_width_expected = 6.42e-3, 0.07e-3, 6.1e-3
    said.bead_width_sections = 40
    state = PanelState(10)
    state.apply('height', CONVERT['height'](said), 0.0, 0.0)
    shown = {'layer': 2, 'width_mm': 6.42, 'u_mm': 0.07, 'expected_mm': 6.1, 'sections': 40}
    assert state.sections['width'] == shown
    said.layer, said.bead_width_sections = 3, 0
    state.apply('height', CONVERT['height'](said), 0.0, 0.0)
    assert state.sections['width'] == shown


def test_the_correction_says_what_it_expects_of_the_surface_after_its_layer():
    from waam_msgs.msg import CorrectionMap
    from waam_node.conversions import floats, grid_to_msg
    from waam_panel.conversions import correction

    spec = GridSpec(0.0, 0.0, 1e-3, 3, 4)
    m = CorrectionMap(grid=grid_to_msg(spec), layer=4, law='unet', psi=floats(np.zeros(spec.shape)))
    assert correction(m)['psi']['title'] == 'for layer 4, unet'
    m.expected_rms, m.expected_rms_low, m.expected_rms_high = 1.2e-4, 8e-5, 1.8e-4
    title = correction(m)['psi']['title']
    assert title == 'for layer 4, unet; expected after it: RMS 0.12 mm (0.08 to 0.18)'
