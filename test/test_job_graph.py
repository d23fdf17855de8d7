"""A whole job through real processes: loop, record, report, refusals."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh

from waam_msgs.action import RunJob
from waam_msgs.msg import JobStatus, MachineState
from waam_process import materials
from waam_process.learned import Taught, nothing, parse

CODES = RunJob.Result
LAYERS = [1, 2, 3]  # finishing layers of 1.0 mm fill the trough of 3.6 mm


# of a job before with the same wire
LEARNED = nothing('simulated', 'er70s-6', 'w600_h200').after(Taught(0.94, 0.02, 5), 'b')


@pytest.fixture(scope='module')
def learned_file(bench):
    """What a job before has taught the cell."""
    file = bench.jobs / 'learned' / 'simulated' / 'er70s-6_w600_h200.json'
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(LEARNED.text())
    return file


@pytest.fixture(scope='module')
def done(bench, learned_file):
    """One closed-loop job, the second of its cell; most tests look at what it left."""
    result = bench.job(loop_mode='closed_loop', note=['wire_lot=4711'], fresh=False)
    assert result.error_code == 0, result.message
    return Path(result.job_dir)


def run_of(folder: Path) -> dict:
    return json.loads((folder / 'report.json').read_text())['closed_loop']


def test_metal_went_where_it_was_missing(done):
    run = run_of(done)
    assert run['as_found_rms_mm'] > 2.5
    assert run['rms_mm'] < 0.35
    first = np.load(done / 'layers' / 'scan_000.npz')
    last = np.load(sorted((done / 'layers').glob('*.npz'))[-1])
    grown = (last['z'] - first['z'])[first['region']]
    assert np.nanmean(grown) == pytest.approx(
        np.nanmean((first['nominal'] - first['z'])[first['region']]), rel=0.15
    )
    outside = (last['z'] - first['z'])[~first['region'] & np.isfinite(first['nominal'])]
    assert np.nanmedian(np.abs(outside)) < 0.05e-3


def test_it_starts_with_what_was_learned_and_adds_to_it(done, learned_file):
    """Replays below start with the same, not with the file of today."""
    first = run_of(done)['layers'][0]
    # beside it the level that the network tells of the layer (3 %); a job that begins afresh is 6 % further off
    assert first['flow_factor'] == pytest.approx(1 / LEARNED.efficiency, rel=0.045)
    told = json.loads((done / 'report.json').read_text())['trace']['learned']
    after = parse(learned_file.read_text())
    assert told['jobs'] == 1 and told['sha256'] == LEARNED.sha256
    assert told['sha256_after'] == after.sha256
    assert after.jobs == 2 and after.last_job == done.name and after.wire_lot == '4711'


def test_every_layer_reports_what_it_did(done):
    layers = run_of(done)['layers']
    assert [r['layer'] for r in layers if not r['final']] == LAYERS
    wire = materials.get('er70s-6')
    least, most = (wire.set_current(feed) for feed in (wire.feed_min, wire.feed_max))
    for r in layers[:-1]:
        assert r['arc_on_time'] > 5 and r['wire_used'] > 0.1
        assert 0.8 * least < r['current_mean'] < 1.2 * most
        assert r['arc_starts'] >= 1 and r['heat_input'] > 1e4
    assert layers[1]['correction_applied'] and layers[1]['psi_min'] < layers[1]['psi_max']


def test_nothing_is_lost(done):
    run = run_of(done)
    assert run['telemetry_lost'] == 0
    assert run['profiles_rejected'] == 0
    track = np.load(done / 'telemetry.npz')
    steps = np.diff(track['t'])
    assert np.all(steps > 0) and steps.max() < 1.0, 'a piece of the track is missing'
    assert track['t'][-1] - track['t'][0] > sum(r['duration'] for r in run['layers'])


def test_record_opens_in_a_third_party_reader_with_all_topics(done):
    from rosbags.highlevel import AnyReader

    with AnyReader([done / 'record']) as reader:
        count = {c.topic: c.msgcount for c in reader.connections}
        for topic in ('/telemetry', '/profiles', '/height_map', '/correction_map', '/layer_plan', '/job_status',
                      '/layer_report', '/heat_factor', '/temperature', '/machine_state', '/segment_done'):  # fmt: skip
            assert count.get(topic, 0) > 0, topic
        maps = [c for c in reader.connections if c.topic == '/height_map']
        _, _, raw = next(reader.messages(connections=maps))
        height_map = reader.deserialize(raw, maps[0].msgtype)
        stored = np.load(done / 'layers' / 'scan_000.npz')['z']
        assert np.array_equal(height_map.z.reshape(stored.shape), stored, equal_nan=True)
        telemetry = [c for c in reader.connections if c.topic == '/telemetry']
        sequence = [
            reader.deserialize(r, telemetry[0].msgtype).sequence
            for _, _, r in reader.messages(connections=telemetry)
        ]
        assert np.all(np.diff(sequence) == 1)


def test_every_frame_that_a_message_names_is_in_the_tree(done):
    """Of the whole graph, as a stock reader finds it in the record."""
    from rosbags.highlevel import AnyReader

    named, above = {}, {}
    with AnyReader([done / 'record']) as reader:
        for connection in reader.connections:
            if '/_' in connection.topic:  # events of services, parts of actions
                continue
            for count, (_, _, raw) in enumerate(reader.messages(connections=[connection])):
                if connection.topic not in ('/tf', '/tf_static') and count:
                    break  # one tells the frame of its topic
                msg = reader.deserialize(raw, connection.msgtype)
                if connection.topic in ('/tf', '/tf_static'):
                    above |= {t.child_frame_id: t.header.frame_id for t in msg.transforms}
                elif frame := getattr(getattr(msg, 'header', None), 'frame_id', ''):
                    named[connection.topic] = frame
    assert set(named.values()) >= {'work', 'machine', 'scanner'}
    tree = {*above, *above.values()}
    assert set(above.values()) - set(above) == {'machine'}  # the one root
    assert not {topic: frame for topic, frame in named.items() if frame not in tree}


def test_record_opens_in_rerun_with_every_topic(done):
    """Messages of several publishers are not in the order of their publication: rerun notes that, and reads them."""
    from waam_record.bag_reader import info
    from waam_view.web_viewer import binary

    command = [binary(), 'mcap', 'check', done / 'record/record_0.mcap']
    checked = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    rows = [line.split(maxsplit=4) for line in checked.stdout.splitlines() if ' /' in line]
    found = {row[3]: (row[0], row[4]) for row in rows if len(row) == 5}
    assert set(found) == set(info(done / 'record').topics)
    assert not [n for n, (status, why) in found.items() if status != 'ok' and 'order' not in why]


def test_offline_replay_reproduces_every_map_psi_and_setpoint(done):
    from waam_replay.tune import tune

    again = tune(done)
    scans, laid = len(list((done / 'layers').glob('*.npz'))), len(LAYERS)
    assert again.identical == {
        'maps': (scans, scans),
        'psi': (laid, laid),
        'setpoints': (laid, laid),
    }
    assert tune(done).digest == again.digest


def test_recording_for_the_viewer_and_page_exist(done):
    from waam_view.report import write_report

    assert (done / 'job.rrd').stat().st_size > 10_000
    page = write_report(done).read_text()
    assert 'tolerance' in page and f'{run_of(done)["rms_mm"]:.3f}' in page


def test_job_yaml_traces_versions_parameters_and_notes(done):
    text = (done / 'job.yaml').read_text()
    for word in ('part_sha256', 'wire_lot=4711', 'software', 'numpy', 'work_offset'):
        assert word in text


def test_second_job_is_refused_while_one_runs(bench, background):
    from waam_bringup.client import ClientError

    bench.load()
    first = background(bench, layers=1)
    bench.wait(
        lambda: bench.client.job and bench.client.job.state == JobStatus.SCANNING, 30, 'scanning'
    )
    with pytest.raises(ClientError, match='running already'):
        bench.run_job(bench.goal())
    bench.client.trigger('job_sequencer/abort')
    assert first.join().error_code == CODES.ABORTED


def test_what_needs_no_scan_is_refused_at_once_and_before_arming(bench, tmp_path):
    foot, roof = trimesh.creation.box((20, 20, 20)), trimesh.creation.box((60, 20, 10))
    roof.apply_translation((0, 0, 15))
    part = tmp_path / 'mushroom.stl'
    trimesh.util.concatenate([foot, roof]).export(part)
    goal = bench.goal(mode='build', part=part, wire_left=0.5, k_gain=0.4)
    result = bench.run_job(goal)
    assert result.error_code == CODES.BAD_GOAL
    for words in ('overhang of 8', 'm of wire', 'allows 0.3 (k_gain_max)'):
        assert words in result.message
    assert not (Path(result.job_dir) / 'record').exists()
    goal = bench.goal(set=['speed=fast', 'nonsense=1'])
    result = bench.run_job(goal)
    assert result.error_code == CODES.BAD_GOAL and not result.job_dir
    for words in ("'fast' is not a float", 'no setting nonsense', 'known: '):
        assert words in result.message


def test_pause_in_a_bead_holds_without_arc_and_resume_finishes(bench, background):
    bench.load()
    before = bench.count('arc on')
    job = background(bench)
    bench.wait(lambda: bench.count('arc on') > before, 60, 'arc on')
    bench.client.trigger('job_sequencer/pause')
    bench.wait(lambda: bench.client.job.state == JobStatus.PAUSED, 20, 'pause')
    bench.wait(lambda: bench.count('arc off') == bench.count('arc on'), 20, 'arc off')
    strikes = bench.count('arc on')
    bench.client.trigger('job_sequencer/resume')
    result = job.join()
    assert result.error_code == 0, result.message
    assert bench.count('state HOLD E200') >= 1 and bench.count('arc on') > strikes


def test_report_traces_the_nodes_that_really_ran(done):
    trace = json.loads((done / 'report.json').read_text())['trace']
    assert trace['operator'] == 'test' and trace['wire_lot'] == '4711'
    assert trace['not_told'] == ['gas']
    assert trace['controller']['identity'] and trace['controller']['firmware']
    assert len(trace['calibration']['mounting']['mount_xyz']) == 3
    assert trace['programs']['program.gcode']['sha256']
    asked = (done / 'job.yaml').read_text()
    for node in (
        'scan_fusion',
        'correction_server',
        'feed_forward',
        'thermal_compensator',
        'bridge',
    ):
        assert f'  {node}:' in asked
    assert 'interpass_limit' in asked and (done / 'tolerance_map.csv').stat().st_size > 1000


def test_every_verb_of_waam_job_steers_the_running_job(bench, background, capfd):
    from waam_bringup.cli import main

    def waam(*words: str) -> int:
        return main(['job', *words, '--run', str(bench.run), '--domain', str(bench.domain)])

    bench.load()
    before = bench.count('arc on')
    job = background(bench, layer_height=1.0)  # many layers: it is not to end between two verbs
    bench.wait(lambda: job.raise_error() or bench.count('arc on') > before, 90, 'the first arc')
    bench.client.trigger('job_sequencer/pause')  # a new process would take longer than the layer
    bench.wait(lambda: bench.client.job.state == JobStatus.PAUSED, 30, 'pause')
    assert waam('pause') == 0  # a paused job stays paused
    assert waam('gain', '0.1') == 0 and waam('rescan') == 0
    assert waam('feed', '--speed', '0.9') == 0 and 'travel speed x 0.9' in capfd.readouterr().out
    assert waam('gain', '0.9') == 2 and 'must be 0 to 0.5' in capfd.readouterr().err
    assert waam('feed', '--wire', '9') == 2 and '0.5 to 1.5' in capfd.readouterr().err
    assert waam('resume') == 0
    bench.wait(lambda: bench.client.job.state != JobStatus.PAUSED, 30, 'resumed')
    assert waam('pause') == 0
    bench.wait(lambda: bench.client.job.state == JobStatus.PAUSED, 30, 'pause by the verb')
    assert waam('feed', '--speed', '1') == 0
    assert waam('resume') == 0
    result = job.join()
    assert result.error_code == 0, result.message
    run = run_of(Path(result.job_dir))
    assert [r['k_gain'] for r in run['layers'] if not r['final']][1] == pytest.approx(0.1)
    said = ' '.join(f'{a["text"]} {a["reaction"]}' for a in run['anomalies'])
    for words in ('paused', 'k_gain set to 0.1', 'another scan was asked for', 'speed 0.9'):
        assert words in said
    assert waam('abort') == 2 and 'no job is running' in capfd.readouterr().err


@pytest.mark.parametrize(
    'change,code,word',
    [
        ({'part': Path('/nowhere/part.stl')}, CODES.BAD_PART, 'part.stl'),
        ({'material': 'unobtainium'}, CODES.UNKNOWN_MATERIAL, 'unobtainium'),
        ({'loop_mode': 'loop'}, CODES.BAD_GOAL, 'loop'),
        ({'tolerance': 50.0}, CODES.BAD_GOAL, 'tolerance'),
    ],
)
def test_bad_goal_is_refused_and_leaves_nothing(bench, change, code, word):
    before = set(bench.jobs.iterdir()) if bench.jobs.exists() else set()
    result = bench.run_job(bench.goal(**change))
    assert result.error_code == code and word in result.message
    assert (set(bench.jobs.iterdir()) if bench.jobs.exists() else set()) == before
    assert bench.client.machine.state == MachineState().state


def test_arc_loss_fails_the_job_with_the_place(bench):
    from waam_msgs.srv import InjectFault

    seen = {'armed': False}

    def in_the_bead(
        status,
    ):  # while no arc has struck yet, the job would pause: no arc after the last try
        if status.state == JobStatus.DEPOSITING and status.bead and not seen['armed']:
            seen['armed'] = True
            request = InjectFault.Request(fault='arc_loss', value=600.0)
            bench.client.node.create_client(InjectFault, 'cell/inject_fault').call_async(request)

    bench.load()
    result = bench.run_job(bench.goal(layers=1), in_the_bead)
    bench.client.call(InjectFault, 'cell/inject_fault', InjectFault.Request(fault='none'))
    assert result.error_code == CODES.DEPOSITION_FAILED, result.message
    report = json.loads((Path(result.job_dir) / 'report.json').read_text())['closed_loop']
    assert report['verdict'] == 'failed' and report['faults'] >= 1
    assert any(a['class'] == 'arc' for a in report['anomalies'])
