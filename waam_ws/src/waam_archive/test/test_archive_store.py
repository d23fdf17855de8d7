"""Taking in, again, changed, deleted, merged, killed: every job is there once and whole."""

from __future__ import annotations

import json
import random
import shutil
import sys
import zlib
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_archive import arrow
from waam_archive import ingest as ingesting
from waam_archive import store as storing
from waam_archive.archive import Archive
from waam_archive.catalog import ArchiveError, Catalog, Entry, File, Segment, parse
from waam_archive.ingest import ingest
from waam_archive.schema import TABLES, VERSION
from waam_archive.selection import Selection
from waam_archive.verify import repair, verify

sys.path.insert(0, str(Path(__file__).parent))
from killing import counted, ingest_in_child, troubles  # noqa: E402
from made_jobs import make_job  # noqa: E402


@pytest.fixture
def jobs(tmp_path):
    return tmp_path / 'jobs'


@pytest.fixture
def archive(jobs):
    return Archive(jobs / 'archive')


def ids(archive) -> list[str]:
    return sorted(r['job'] for r in archive.jobs(Selection()))


def test_a_job_is_taken_in_once(jobs, archive):
    folder = make_job(jobs)
    assert ingest(archive.store, [jobs]).added == [folder.name]
    before = counted(archive.store.root)
    again = ingest(archive.store, [jobs])
    assert again.unchanged == [folder.name] and not again.added
    (folder / 'report.json').touch()  # the stamp is another, the content is not
    assert ingest(archive.store, [jobs]).unchanged == [folder.name]
    assert counted(archive.store.root) == before
    assert all(before[t][folder.name] for t in TABLES)


def test_only_what_is_new_is_read(jobs, archive, monkeypatch):
    make_job(jobs, 1)
    ingest(archive.store, [jobs])
    new, read = make_job(jobs, 2), []
    monkeypatch.setattr(
        ingesting, 'read', lambda s, inner=ingesting.read: read.append(s) or inner(s)
    )
    ingest(archive.store, [jobs])
    assert read == [new]


def written_by_schema_1(root: Path) -> None:
    """Turns an archive into one of the software that called the loop mode `profile`."""
    for marker in sorted((root / 'segments').glob('*.json')):
        segment = parse(marker.read_text(), str(marker))
        file = root / segment.files['jobs'].name
        found = pq.read_table(file)
        found = found.rename_columns(
            ['profile' if n == 'loop_mode' else n for n in found.column_names]
        )
        old = File(name=segment.files['jobs'].name, **arrow.write(file, found))
        files = {**segment.files, 'jobs': old}
        marker.write_text(replace(segment, files=files, schema=1).text())
    (root / 'archive.json').write_text('{"schema": 1}')


def test_an_archive_of_the_schema_before_is_read_and_written_on(jobs, archive):
    first, second = make_job(jobs, 1), make_job(jobs, 2)
    ingest(archive.store, [first])
    root = archive.store.root
    written_by_schema_1(root)
    archive = Archive(root)
    assert [r['loop_mode'] for r in archive.jobs(Selection(loop_mode='closed*'))] == ['closed_loop']
    assert archive.store.check_version() == 1  # reading changes nothing
    ingest(archive.store, [second])
    assert archive.store.check_version() == VERSION and verify(archive.store).sound
    assert [r['loop_mode'] for r in archive.jobs(Selection())] == ['closed_loop'] * 2
    assert archive.sql('SELECT count(loop_mode) FROM jobs')[1] == [(2,)]
    with archive.store.writing() as writer:
        writer.rewrite(list(writer.catalog.segments), lambda job, entry: entry)
    (segment,) = archive.store.catalog().segments.values()
    assert segment.schema == VERSION and ids(archive) == [first.name, second.name]
    assert {r['loop_mode'] for r in archive.jobs(Selection())} == {'closed_loop'}


def test_stale_rows_of_the_schema_before_do_not_count(jobs, archive):
    folder = make_job(jobs, rms=1e-4)
    make_job(jobs, 2)
    ingest(archive.store, [jobs])
    written_by_schema_1(archive.store.root)
    shutil.rmtree(folder)
    make_job(jobs, rms=3e-4)
    with Archive(archive.store.root).store.writing() as writer:
        writer.add([ingesting.read(folder)])  # without tidying up, as after a kill
    rows = {r['job']: r['rms_mm'] for r in Archive(archive.store.root).jobs(Selection())}
    assert len(rows) == 2 and rows[folder.name] == pytest.approx(0.3)


def test_a_marker_of_the_schema_before_is_made_again_from_its_files(jobs, archive):
    job = make_job(jobs)
    ingest(archive.store, [jobs])
    written_by_schema_1(archive.store.root)
    (marker,) = (archive.store.root / 'segments').glob('*.json')
    marker.write_text('torn')
    archive = Archive(archive.store.root)
    assert repair(archive.store, verify(archive.store))
    assert archive.store.segment(1).schema == 1 and verify(archive.store).sound
    assert archive.of_job('jobs', job.name)[0]['loop_mode'] == 'closed_loop'


def test_a_job_that_changed_takes_the_place_of_what_was_there(jobs, archive):
    folder = make_job(jobs, rms=1e-4)
    make_job(jobs, 2)
    ingest(archive.store, [jobs])
    shutil.rmtree(folder)
    make_job(jobs, rms=3e-4, layers=1)
    assert ingest(archive.store, [jobs]).updated == [folder.name]
    (row,) = archive.of_job('jobs', folder.name)
    assert row['rms_mm'] == pytest.approx(0.3) and row['layers'] == 1
    assert len(ids(archive)) == 2


def test_two_folders_of_one_id_are_refused_by_name(jobs, archive, tmp_path):
    here = make_job(jobs, job_id='20260101T000000Z_x')
    there = make_job(tmp_path / 'other', job_id='20260101T000000Z_x', rms=3e-4)
    ingest(archive.store, [jobs])
    outcome = ingest(archive.store, [there])
    assert (
        not outcome.added and str(here) in outcome.refused[0] and str(there) in outcome.refused[0]
    )
    assert ingest(archive.store, [there], replace=True).updated == [here.name]
    both = ingest(Archive(tmp_path / 'a').store, [here, there])
    assert len(both.added) == len(both.refused) == 1


def test_a_job_that_runs_is_left_for_later_and_one_that_was_cut_off_is_taken(jobs, archive):
    folder = make_job(jobs)
    (folder / 'report.json').rename(jobs / 'report')
    (folder / 'status.json').write_text('{"state": "DEPOSITING"}')
    outcome = ingest(archive.store, [jobs])
    assert not outcome.added and 'DEPOSITING' in outcome.running[0]
    (folder / 'status.json').write_text('{"state": "INTERRUPTED", "error_code": 0}')
    layers = json.loads((jobs / 'report').read_text())['closed_loop']['layers'][:1]
    (folder / 'records.json').write_text(json.dumps({'layers': layers, 'elapsed': 12.5}))
    assert ingest(archive.store, [jobs]).added == [folder.name]
    (row,) = archive.of_job('jobs', folder.name)
    assert row['state'] == 'INTERRUPTED' and not row['has_report'] and row['verdict'] is None
    assert (
        row['layers'] == 1
        and row['duration_s'] == 12.5
        and row['created'] == datetime(2026, 1, 5, 9)
    )


def test_a_deleted_job_comes_back_only_when_it_is_named(jobs, archive):
    folder, other = make_job(jobs, 1), make_job(jobs, 2)
    ingest(archive.store, [jobs])
    with archive.store.writing() as writer:
        writer.delete({folder.name})
    assert ids(archive) == [other.name]
    assert not any(folder.name in c for c in counted(archive.store.root).values())
    assert not ingest(archive.store, [jobs], named=False).added
    assert ingest(archive.store, [folder]).added == [folder.name]


def test_many_segments_become_few(jobs, archive, monkeypatch):
    monkeypatch.setattr(ingesting, 'BATCH_JOBS', 1)
    monkeypatch.setattr(storing, 'FAN', 3)
    for n in range(1, 8):
        make_job(jobs, n, arrays=False)
    ingest(archive.store, [jobs])
    assert len(ids(archive)) == len(set(ids(archive))) == 7
    assert len(archive.store.marker_numbers()) <= 6
    assert verify(archive.store, sources=True).sound


def test_six_kills_lose_and_double_nothing(jobs, tmp_path):
    for n in range(1, 5):
        make_job(jobs, n, layers=1)
    assert not ingest_in_child(tmp_path / 'whole', jobs, 60.0)
    expected, rng, killed = counted(tmp_path / 'whole'), random.Random(1), 0
    for trial in range(6):
        place = tmp_path / f'a{trial}'
        killed += ingest_in_child(place, jobs, rng.uniform(0.0, 0.2))
        assert not troubles(place, expected)
        ingest(Archive(place).store, [jobs])
        assert counted(place) == expected and verify(Archive(place).store).sound
    assert killed


def test_remains_of_a_killed_writer_go_with_the_next_one(jobs, archive):
    make_job(jobs, 1)
    ingest(archive.store, [jobs])
    root = archive.store.root
    (root / 'segments/new-00000002').mkdir()
    (root / 'segments/00000003').mkdir()
    (root / 'segments/00000004.json.new').write_text('{')
    make_job(jobs, 2)
    ingest(archive.store, [jobs])
    assert len(ids(archive)) == 2 and not list(root.rglob('*new*'))
    assert not (root / 'segments/00000003').exists()


def test_another_version_or_another_folder_is_refused_by_name(tmp_path):
    (tmp_path / 'archive.json').write_text('{"schema": 99}')
    with pytest.raises(ArchiveError, match='schema 99'):
        Archive(tmp_path).jobs(Selection())
    (tmp_path / 'archive.json').write_text('[]')
    with pytest.raises(ArchiveError, match='not the head of an archive'):
        Archive(tmp_path).jobs(Selection())


# ---- markers -------------------------------------------------------------------------------------

TEXT = st.text(max_size=12)
FILES = st.builds(File, name=TEXT, sha256=TEXT, bytes=st.integers(0), rows=st.integers(0))
ENTRIES = st.builds(
    Entry, sha256=TEXT, source=TEXT, stamp=TEXT, has_report=st.booleans(),
)  # fmt: skip
SEGMENTS = st.builds(
    Segment, number=st.integers(1, 10**7), replaces=st.lists(st.integers(1, 99)).map(tuple),
    jobs=st.dictionaries(TEXT, ENTRIES, max_size=3), files=st.dictionaries(st.sampled_from(list(TABLES)), FILES),
)  # fmt: skip


@given(SEGMENTS)
def test_a_marker_says_what_was_written(segment):
    assert parse(segment.text(), 'm') == segment


@given(SEGMENTS, st.data())
@settings(max_examples=60)
def test_a_damaged_marker_is_refused_by_name(segment, data):
    text = segment.text()
    at = data.draw(st.integers(0, len(text) - 1))
    new = data.draw(st.sampled_from(['', '0', '7', '"', '}', 'x', ' ']))
    torn = text[:at] + new + text[at + 1 :]
    try:
        found = parse(torn, 'segments/1.json')
    except ArchiveError as e:
        assert 'segments/1.json' in str(e)
    else:
        assert found == segment  # blanks between fields mean nothing


OPERATIONS = st.lists(
    st.tuples(st.sampled_from(['add', 'delete', 'merge']), st.integers(0, 3), st.integers(0, 5)), max_size=25
)  # fmt: skip


@given(OPERATIONS)
def test_the_catalog_holds_what_was_added_last(operations):
    """Against a plain dict; every order of reading the markers gives the same."""
    disk, model = {}, {}
    for kind, job, version in operations:
        catalog = Catalog.of(disk.values())
        number, name = max(disk, default=0) + 1, f'j{job}'
        if kind == 'add':
            disk[number] = Segment(number, (), {name: entry(version)}, {})
            model[name] = entry(version)
        else:
            gone = {name} if kind == 'delete' else set()
            jobs = {j: e for j, e in catalog.entries().items() if j not in gone}
            disk[number] = Segment(number, tuple(catalog.segments), jobs, {})
            model.pop(name, None) if gone else None
            if version % 2:  # the old markers are removed, or a kill leaves them
                disk = {number: disk[number]}
    shuffled = list(disk.values())
    random.Random(len(operations)).shuffle(shuffled)
    assert Catalog.of(shuffled).entries() == model


def entry(version: int) -> Entry:
    return replace(Entry('', 's', '', True), sha256=str(version))


def test_an_archive_of_schema_2_is_read_and_its_arrays_are_left_alone(jobs, archive):
    make_job(jobs, 1)
    ingest(archive.store, [jobs])
    root = archive.store.root
    (marker,) = (root / 'segments').glob('*.json')
    old = parse(marker.read_text(), 'm')
    data = json.loads(old.text()) | {'schema': 2}
    del data['crc32']
    for job in data['jobs'].values():
        job['bulk'] = {'maps': {'name': 'maps/a.parquet', 'sha256': '', 'bytes': 1, 'rows': 1}}
    body = json.dumps(data, indent=0)[1:]
    marker.write_text(f'{{"crc32": {zlib.crc32(body.encode())},{body}')
    (root / 'archive.json').write_text('{"schema": 2}')
    (root / 'maps').mkdir()
    (root / 'maps/a.parquet').write_bytes(b'1')
    make_job(jobs, 2)
    again = Archive(root)
    ingest(again.store, [jobs])
    assert len(ids(again)) == 2 and (root / 'maps/a.parquet').exists()
