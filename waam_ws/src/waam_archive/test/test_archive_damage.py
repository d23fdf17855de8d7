"""Damaged job folders and damaged archives: an error that names the file, and nothing else is lost."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from waam_archive.archive import Archive, SqlError
from waam_archive.catalog import ArchiveError
from waam_archive.ingest import ingest
from waam_archive.rows import Told, all_rows
from waam_archive.schema import names
from waam_archive.selection import Selection
from waam_archive.verify import repair, verify

sys.path.insert(0, str(Path(__file__).parent))
from killing import counted  # noqa: E402
from made_jobs import make_job  # noqa: E402

FIXTURE = [HealthCheck.function_scoped_fixture]


@pytest.fixture(scope='module')
def pristine(tmp_path_factory):
    """Two job folders, and an archive of them."""
    root = tmp_path_factory.mktemp('pristine')
    make_job(root / 'jobs', 1, layers=1)
    make_job(root / 'jobs', 2, layers=1)
    ingest(Archive(root / 'archive').store, [root / 'jobs'])
    return root


def damaged(file: Path, data: st.DataObject) -> None:
    """Cuts the file, or changes some of its bytes."""
    content = bytearray(file.read_bytes())
    if data.draw(st.booleans(), label='cut'):
        del content[data.draw(st.integers(0, len(content) - 1), label='at') :]
    else:
        for at in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=20)):
            content[at] = data.draw(st.integers(0, 255))
    file.write_bytes(content)


@given(st.data())
@settings(max_examples=25, deadline=None, suppress_health_check=FIXTURE)
def test_a_damaged_job_folder_costs_what_is_damaged_and_nothing_else(
    tmp_path_factory, pristine, data
):
    root = tmp_path_factory.mktemp('damaged')
    shutil.copytree(pristine / 'jobs', root / 'jobs')
    first, second = sorted((root / 'jobs').iterdir())
    files = sorted(f for f in first.rglob('*') if f.is_file())
    file = data.draw(st.sampled_from(files))
    damaged(file, data)
    archive = Archive(root / 'archive')
    outcome = ingest(archive.store, [root / 'jobs'])
    assert second.name in outcome.added
    said = outcome.refused + outcome.notes + outcome.running
    assert all(str(first) in line for line in said)
    if not said:
        assert len(outcome.added) == 2
    if outcome.notes and not outcome.refused:
        assert str(file) in outcome.notes[0] and len(outcome.added) == 2
    assert verify(archive.store).sound


@pytest.mark.parametrize('name', ['job.yaml', 'report.json'])
@pytest.mark.parametrize('content', ['', '[1]', '{"a": ', 'x: [', '\x00', '"' * 5, '[' * 5000])
def test_a_job_that_says_nothing_is_refused_with_the_name_of_the_file(tmp_path, name, content):
    folder = make_job(tmp_path, layers=1, arrays=False)
    (folder / name).write_text(content)
    outcome = ingest(Archive(tmp_path / 'archive').store, [folder])
    assert not outcome.added and str(folder / name) in outcome.refused[0]


JSON = (
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=5)
    | st.lists(st.none() | st.integers() | st.floats(), max_size=3)
)  # fmt: skip
KNOWN = st.sampled_from(
    ['goal', 'notes', 'layers', 'anomalies', 'trace', 'calibration', 'position', 'severity', 'created', 'rms_mm',
     'closed_loop', 'loop_mode', 'profile', 'tolerance_map', 'parameters', 'learned', 'mounting', 'mount_xyz',
     'layer', 'verdict']
)  # fmt: skip
FLAT = st.dictionaries(KNOWN, JSON, max_size=4)
RUN = st.dictionaries(KNOWN, FLAT | st.lists(FLAT, max_size=2) | JSON, max_size=5)
THING = st.dictionaries(KNOWN, RUN | JSON, max_size=5)


@given(THING, THING, THING, THING)
@settings(max_examples=60, deadline=None)
def test_whatever_a_report_says_becomes_rows_of_the_schema(asked, report, records, status):
    from waam_archive import arrow

    told = Told(asked, report, records, status)
    rows = all_rows('j', told, 0.009, 0.92)
    for table, found in rows.items():
        assert all(set(r) <= set(names(table)) for r in found)
        assert arrow.table(table, found).num_rows == len(found)


@given(st.data())
@settings(max_examples=8, deadline=None, suppress_health_check=FIXTURE)
def test_a_damaged_archive_says_which_file_and_is_mended(tmp_path_factory, pristine, data):
    root = tmp_path_factory.mktemp('archive')
    shutil.copytree(pristine / 'archive', root / 'archive')
    archive = Archive(root / 'archive')
    expected = counted(pristine / 'archive')
    files = sorted(
        f for f in (root / 'archive').rglob('*') if f.suffix == '.parquet' or f.stem.isdigit()
    )
    file = data.draw(st.sampled_from([f for f in files if f.is_file()]))
    before = file.read_bytes()
    damaged(file, data)
    verdict = verify(archive.store)
    assert verdict.sound == (file.read_bytes() == before) or file.suffix == '.json'
    if verdict.sound:
        return
    assert any(str(file) in line for line in verdict.problems)
    assert repair(archive.store, verdict)
    assert verify(archive.store).sound
    assert counted(archive.store.root) == expected


def test_a_question_to_a_damaged_archive_is_an_error_with_the_way_out(pristine, tmp_path):
    shutil.copytree(pristine / 'archive', tmp_path / 'a')
    (file,) = (tmp_path / 'a' / 'segments').glob('*/jobs.parquet')
    file.write_bytes(file.read_bytes()[:-10])
    with pytest.raises(ArchiveError, match='verify --repair'):
        Archive(tmp_path / 'a').jobs(Selection())
    (marker,) = (tmp_path / 'a' / 'segments').glob('*.json')
    marker.write_text(marker.read_text().replace('"stamp"', '"stomp"', 1))
    with pytest.raises(ArchiveError, match=str(marker)):
        Archive(tmp_path / 'a').jobs(Selection())


def test_sql_over_a_damaged_file_names_it(pristine, tmp_path):
    shutil.copytree(pristine / 'archive', tmp_path / 'a')
    (file,) = (tmp_path / 'a').rglob('beads.parquet')
    file.write_bytes(file.read_bytes()[:-10])
    with pytest.raises(SqlError, match=f'{file.name}.*verify --repair'):
        Archive(tmp_path / 'a').sql('SELECT avg(energy_J) FROM beads')
    assert Archive(tmp_path / 'a').sql('SELECT count(*) FROM jobs')[1] == [(2,)]


def test_a_writer_leaves_an_archive_with_a_damaged_marker_alone(pristine, tmp_path):
    shutil.copytree(pristine, tmp_path, dirs_exist_ok=True)
    (marker,) = (tmp_path / 'archive/segments').glob('*.json')
    marker.write_text(marker.read_text()[:-20])
    files = sorted(f for f in (tmp_path / 'archive').rglob('*'))
    with pytest.raises(ArchiveError), Archive(tmp_path / 'archive').store.writing():
        pytest.fail('not reached')
    assert [f for f in sorted((tmp_path / 'archive').rglob('*')) if f.name != '.lock'] == [
        f for f in files if f.name != '.lock'
    ]


def test_what_cannot_be_taken_again_is_named_and_kept(pristine, tmp_path):
    shutil.copytree(pristine, tmp_path, dirs_exist_ok=True)
    archive = Archive(tmp_path / 'archive')
    (file,) = (tmp_path / 'archive/segments').glob('*/layers.parquet')
    file.write_bytes(b'nothing')
    marker = next((tmp_path / 'archive/segments').glob('*.json'))
    data = json.loads(marker.read_text())
    assert all(str(pristine) in e['source'] for e in data['jobs'].values())
    moved = pristine.with_name('elsewhere')
    pristine.rename(moved)
    try:
        said = repair(archive.store, verify(archive.store))
    finally:
        moved.rename(pristine)
    assert sum('is gone' in line for line in said) == 2
    assert list((tmp_path / 'archive/segments').glob('*.bad/jobs.parquet'))


def test_a_changed_source_is_found(pristine, tmp_path):
    shutil.copytree(pristine / 'jobs', tmp_path / 'jobs')
    archive = Archive(tmp_path / 'archive')
    ingest(archive.store, [tmp_path / 'jobs'])
    assert verify(archive.store, sources=True).sound
    first = sorted((tmp_path / 'jobs').iterdir())[0]
    (first / 'layers/scan_000.npz').unlink()
    assert verify(archive.store, sources=True).changed == [first.name]
    assert verify(archive.store).sound
