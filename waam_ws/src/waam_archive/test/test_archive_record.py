"""A recording alone becomes a job; its folder, when it turns up, knows more."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from waam_archive.archive import Archive
from waam_archive.ingest import ingest, sources
from waam_archive.verify import verify

sys.path.insert(0, str(Path(__file__).parent))
from made_jobs import make_job  # noqa: E402
from made_record import T0, make_record  # noqa: E402

JOB = '20260201T000000Z_jaw'


@pytest.fixture(scope='module')
def record(tmp_path_factory):
    asked = {
        'job_id': JOB,
        'goal': {'part': '/p/jaw.stl', 'operator_name': 'Ada', 'notes': ['wire_lot=4711']},
    }
    custom = {'job_id': JOB, 'job.yaml': yaml.safe_dump(asked)}
    return make_record(tmp_path_factory.mktemp('r') / 'record', custom=custom)


def test_a_recording_alone_becomes_a_job(record, tmp_path):
    archive = Archive(tmp_path / 'archive')
    outcome = ingest(archive.store, [record])
    assert outcome.added == [JOB] and not outcome.notes
    (job,) = archive.of_job('jobs', JOB)
    assert (job['kind'], job['state'], job['part'], job['wire_lot']) == (
        'record',
        'DONE',
        'jaw.stl',
        '4711',
    )
    assert job['rms_mm'] == pytest.approx(0.12) and job['verdict'] is None and not job['has_report']
    assert (
        job['material'] == 'er70s-6'
        and job['wire_m'] == pytest.approx(0.7)
        and job['message'] == 'done'
    )
    assert [r['final'] for r in archive.of_job('layers', JOB)] == [False, True]
    (anomaly,) = archive.of_job('anomalies', JOB)
    assert (anomaly['severity'], anomaly['text']) == ('WARNING', 'lit twice')


def test_one_file_alone_says_what_job_it_was(record, tmp_path):
    lone = tmp_path / 'from_a_stick.mcap'
    lone.write_bytes(next(record.glob('*.mcap')).read_bytes())
    archive = Archive(tmp_path / 'archive')
    ingest(archive.store, [lone])
    (job,) = archive.of_job('jobs', JOB)
    assert (job['part'], job['operator'], job['wire_lot']) == ('jaw.stl', 'Ada', '4711')


def test_a_recording_of_before_tells_its_loop_mode_by_the_old_name(tmp_path):
    """The layout of the message is the same; its definition, which the recording carries, names the field otherwise."""
    asked = {'job_id': JOB, 'goal': {'part': '/p/jaw.stl', 'profile': 'monitor'}}
    old = make_record(tmp_path / 'old', old_names=True)
    told = make_record(
        tmp_path / 'told', old_names=True, custom={'job.yaml': yaml.safe_dump(asked)}
    )
    for record, expected in ((old, 'closed_loop'), (told, 'monitor')):
        archive = Archive(tmp_path / f'{record.name}_archive')
        outcome = ingest(archive.store, [record])
        assert outcome.added == [JOB] and not outcome.notes
        assert archive.of_job('jobs', JOB)[0]['loop_mode'] == expected


def test_its_telemetry_is_thinned_and_its_beads_are_those_of_the_plan(record, tmp_path):
    archive = Archive(tmp_path / 'archive')
    ingest(archive.store, [record])
    track = archive.of_job('telemetry', JOB)
    assert len(track) == 100 and {r['layer'] for r in track} == {1}
    assert track[0]['t_s'] == pytest.approx(T0) and track[1]['t_s'] == pytest.approx(T0 + 0.1)
    assert {r['temperature_C'] for r in track} == {150.0}
    beads = archive.of_job('beads', JOB)
    assert [b['bead'] for b in beads] == [2, 1] and {b['current_A'] for b in beads} == {180.0}
    assert all(b['arc_on_s'] == pytest.approx(4.0, abs=0.15) for b in beads)
    maps = {(r['layer'], r['name']): r['data'] for r in archive.of_job('maps', JOB)}
    assert maps[1, 'z'] == [pytest.approx(1e-3)] * 12 and maps[0, 'count'] == [1.0] * 12


def test_the_folder_takes_the_place_of_the_recording_and_not_the_other_way_round(record, tmp_path):
    archive = Archive(tmp_path / 'archive')
    ingest(archive.store, [record])
    folder = make_job(tmp_path / 'jobs', job_id=JOB)
    assert ingest(archive.store, [folder]).updated == [JOB]
    assert archive.of_job('jobs', JOB)[0]['kind'] == 'folder'
    outcome = ingest(archive.store, [record])
    assert outcome.unchanged == [JOB] and not outcome.refused
    assert archive.of_job('jobs', JOB)[0]['kind'] == 'folder'
    shutil.copytree(record, folder / 'record')
    assert list(sources(folder / 'record')) == [folder.resolve()]
    assert ingest(archive.store, [folder / 'record']).unchanged == [JOB]


@given(st.data())
@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_damaged_recording_gives_what_is_whole_and_says_what_is_not(
    record, tmp_path_factory, data
):
    root = tmp_path_factory.mktemp('damaged')
    shutil.copytree(record, root / 'record')
    (file,) = (root / 'record').glob('*.mcap')
    content = bytearray(file.read_bytes())
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    for at in data.draw(st.lists(st.integers(0, max(0, len(content) - 1)), max_size=5)):
        content[at : at + 1] = bytes([data.draw(st.integers(0, 255))])
    archive = Archive(root / 'archive')
    changed = bytes(content) != file.read_bytes()
    file.write_bytes(content)
    outcome = ingest(archive.store, [root / 'record'])
    assert bool(outcome.added) != bool(outcome.refused)
    if changed and outcome.added:
        assert verify(archive.store).sound


@pytest.mark.parametrize('content', [b'', b'\x89MCAP0\r\n', b'nothing at all'])
def test_a_file_without_a_job_is_refused_by_name(tmp_path, content):
    (tmp_path / 'x.mcap').write_bytes(content)
    outcome = ingest(Archive(tmp_path / 'archive').store, [tmp_path / 'x.mcap'])
    assert str(tmp_path / 'x.mcap') in outcome.refused[0]
