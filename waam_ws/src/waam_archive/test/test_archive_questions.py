"""Filters, search, a user's SQL and attempts to get out of it; the documented schema is the one that is written."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path

import duckdb
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_archive.archive import Archive, NoJob, SqlError
from waam_archive.export import export
from waam_archive.ingest import ingest
from waam_archive.metrics import METRICS
from waam_archive.schema import SQL_TYPES, TABLES, VERSION, markdown, names
from waam_archive.selection import TEXTS, Selection, SelectionError, moment
from waam_archive.trend import values_of

sys.path.insert(0, str(Path(__file__).parent))
from made_jobs import BEADS, make_job  # noqa: E402

TABLES_PAGE = Path(__file__).parents[1] / 'doc' / 'tables.md'
NASTY = (
    "x'; DROP TABLE jobs; --", "' OR '1'='1", '" OR 1=1 --', "'); ATTACH '/tmp/x.db' AS x; --", '%', '_', '\\',
    '[a-z]*',
    'Ünïcode', '?', "*' UNION SELECT * FROM jobs --", '$1', '-',
)  # fmt: skip


@pytest.fixture(scope='module')
def archive(tmp_path_factory):
    root = tmp_path_factory.mktemp('asked')
    make_job(root / 'jobs', 1, part='jaw.stl', operator='Ada', rms=1e-4)
    make_job(
        root / 'jobs',
        2,
        part='jaw.stl',
        operator="O'Neil; --",
        wire_lot='4712',
        rms=3e-4,
        verdict='out of tolerance',
    )
    make_job(
        root / 'jobs',
        3,
        part='roller "A".stl',
        operator='',
        message='arc lost at bead 7',
        verdict='failed',
    )
    make_job(
        root / 'jobs',
        4,
        part=NASTY[0] + '.stl',
        operator=NASTY[1],
        job_id=f"20260201T000000Z_{NASTY[0].replace('/', '')}",
    )
    found = Archive(root / 'archive')
    assert len(ingest(found.store, [root / 'jobs']).added) == 4
    return found


def parts(rows) -> list[str]:
    return sorted(r['part'] for r in rows)


# ---- the schema ----------------------------------------------------------------------------------


def test_the_documented_schema_is_the_one_that_is_written(archive):
    text = TABLES_PAGE.read_text()
    assert markdown().strip() in text, 'waam_archive.schema.markdown() prints what belongs there'
    assert f'Schema version {VERSION}.' in text
    for table in TABLES:
        files = archive._files(archive.store.catalog(), table)
        assert files
        for _, file in files:
            told = duckdb.sql(f"DESCRIBE SELECT * FROM '{file}'").fetchall()
            assert [(t[0], t[1]) for t in told] == [
                (c.name, SQL_TYPES[c.kind]) for c in TABLES[table]
            ]


def test_a_table_without_rows_has_its_columns(tmp_path):
    make_job(tmp_path / 'jobs', arrays=False)
    empty = Archive(tmp_path / 'archive')
    ingest(empty.store, [tmp_path / 'jobs'])
    for table in TABLES:
        columns, _ = empty.sql(f'SELECT * FROM {table}')
        assert columns == names(table)


def test_values_are_those_of_the_job(archive):
    job = archive.job_named('_jaw_1')
    (row,) = archive.of_job('jobs', job)
    assert (row['part'], row['operator'], row['wire_lot'], row['gas']) == (
        'jaw.stl',
        'Ada',
        '4711',
        'M21',
    )
    assert row['created'] == datetime(2026, 1, 5, 9) and row['rms_mm'] == pytest.approx(0.1)
    assert row['area_mm2'] == pytest.approx(400) and row['grown_mm3'] == pytest.approx(800)
    volume = row['wire_m'] * np.pi * 0.6**2 * 1e3  # mm3 of wire
    assert row['efficiency'] == row['material_use'] == pytest.approx(800 / volume)
    assert row['metal_kg'] == pytest.approx(row['wire_kg'] * 0.92)
    assert (row['defect_cells'], row['judged_cells']) == (6, 200)
    assert (row['beads'], row['strikes']) == (2 * BEADS, 2 * BEADS + 1)


def test_beads_are_numbered_by_the_plan_and_measured(archive):
    beads = archive.of_job('beads', archive.job_named('_jaw_1'))
    of_first = [b for b in beads if b['layer'] == 1]
    assert [b['bead'] for b in of_first] == [4, 3, 2, 1]  # the plan counts from the far side
    assert [b['current_A'] for b in of_first] == [170, 171, 172, 173]
    assert all(b['numbered'] == 'plan' and b['strikes'] == 1 for b in beads)
    assert of_first[0]['arc_on_s'] == pytest.approx(2.0, abs=1e-3)
    assert of_first[0]['energy_J'] == pytest.approx(170 * 22 * 2, rel=1e-3)


# ---- filters -------------------------------------------------------------------------------------


def test_filters(archive):
    assert parts(archive.jobs(Selection(part='JAW*'))) == ['jaw.stl', 'jaw.stl']
    assert len(archive.jobs(Selection(part='jaw.stl', wire_lot='4712'))) == 1
    assert len(archive.jobs(Selection(operator="o'neil; --"))) == 1
    assert parts(archive.jobs(Selection(operator='-'))) == ['roller "A".stl']
    assert parts(archive.jobs(Selection(verdict='failed'))) == ['roller "A".stl']
    assert len(archive.jobs(Selection(since=datetime(2026, 1, 5, 10)))) == 3
    assert len(archive.jobs(Selection(until=datetime(2026, 1, 5, 10)))) == 1
    assert len(archive.jobs(Selection(), limit=2)) == 2


@pytest.mark.parametrize('asked', NASTY)
def test_what_is_typed_into_a_filter_is_only_a_value(archive, asked):
    name = 'operator' if 'OR' in asked else 'part'
    found = archive.jobs(Selection(**{name: asked}))
    if asked == '-':
        assert all(r[name] is None for r in found)
    else:
        pattern = re.escape(asked.lower()).replace(r'\*', '.*').replace(r'\?', '.')
        assert all(re.fullmatch(pattern, str(r[name]).lower()) for r in found)
    archive.find(asked, Selection(**{name: asked}))
    assert len(archive.jobs(Selection())) == 4


@given(st.sampled_from(TEXTS), st.text(max_size=20))
def test_a_filter_never_becomes_sql(name, asked):
    where, values = Selection(**{name: asked}).where()
    plain = Selection(**{name: 'x'}).where()[0]
    assert where in (plain, 'true', f'true AND jobs."{name}" IS NULL') and len(
        values
    ) == where.count('?')


def test_nasty_names_are_found_and_shown(archive):
    job = archive.job_named('DROP TABLE')
    assert archive.of_job('jobs', job)[0]['part'] == NASTY[0] + '.stl'
    with pytest.raises(NoJob, match='no job'):
        archive.job_named("'; DROP TABLE jobs; --x")
    with pytest.raises(NoJob, match='2 jobs'):
        archive.job_named('jaw')
    with pytest.raises(SqlError, match='no table'):
        archive.of_job('jobs"; DROP VIEW jobs; --', job)


def test_times():
    now = datetime(2026, 11, 24)
    assert moment('30d', now) == now - timedelta(days=30)
    assert moment('2026-11-21T09:30+01:00', now) == datetime(2026, 11, 21, 8, 30)
    for wrong in ('', 'd', 'yesterday', '99999999999d', '2026-13-01', "'; --"):
        with pytest.raises(SelectionError, match='is no time'):
            moment(wrong, now)


def test_find(archive):
    (hit,) = archive.find('ARC LOST at', Selection())
    assert hit['place'] == 'message' and hit['verdict'] == 'failed'
    assert len(archive.find('twice', Selection())) == 4
    assert len(archive.find('twice', Selection(verdict='failed'))) == 1
    assert archive.find('abc123', Selection())[0]['place'] == 'report'
    assert archive.find('nowhere to be found', Selection()) == []


@pytest.mark.parametrize('name', METRICS)
def test_every_metric_has_a_value_per_job(archive, name):
    found = values_of(archive, name, Selection())
    assert len(found.jobs) == len(found.values) == 4 and np.isfinite(found.values).all()
    assert found.created.tolist() == sorted(found.created.tolist())
    one = values_of(archive, name, Selection(job=found.jobs[1]))
    assert one.values.tolist() == [found.values[1]]


def test_a_trend_of_a_bead_figure_is_that_of_the_beads(archive):
    text = 'SELECT job, avg(current_A) AS value FROM beads GROUP BY job'
    plain = {r['job']: r['value'] for r in archive.rows(('beads',), text)}
    found = values_of(archive, 'current', Selection())
    assert dict(zip(found.jobs, found.values, strict=True)) == pytest.approx(plain)


def test_an_archive_that_is_held_open_sees_what_is_written(tmp_path):
    make_job(tmp_path / 'jobs', 1)
    held = Archive(tmp_path / 'archive')
    ingest(held.store, [tmp_path / 'jobs'])
    assert len(values_of(held, 'current', Selection()).values) == 1
    make_job(tmp_path / 'jobs', 2, rms=0.3e-3)
    ingest(Archive(tmp_path / 'archive').store, [tmp_path / 'jobs'])
    assert len(values_of(held, 'current', Selection()).values) == 2
    assert values_of(held, 'rms', Selection()).values.tolist() == pytest.approx([0.1, 0.3])


# ---- SQL of a user -------------------------------------------------------------------------------


def test_a_select_is_answered(archive):
    columns, rows = archive.sql(
        'SELECT part, count(*) AS n FROM jobs JOIN layers USING (job) GROUP BY part ORDER BY n DESC'
    )
    assert columns == ['part', 'n'] and rows[0] == ('jaw.stl', 6)


ESCAPES = (
    '', 'nonsense', 'SELECT 1; SELECT 2', 'DROP VIEW jobs', 'CREATE TABLE x AS SELECT 1',
    "INSERT INTO jobs SELECT * FROM jobs",
    'DELETE FROM jobs', "UPDATE jobs SET part = 'x'", "COPY jobs TO '{out}'", "COPY (SELECT 1) TO '{out}'",
    "EXPLAIN ANALYZE COPY jobs TO '{out}'", "EXPORT DATABASE '{out}'", "ATTACH '{out}' AS x", 'INSTALL httpfs',
    'LOAD httpfs',
    "SET enable_external_access = true", "SET allowed_directories = ['/']", 'RESET enable_external_access',
    "PRAGMA enable_external_access = true", "SELECT * FROM read_csv('/etc/passwd')",
    "SELECT * FROM read_text('/etc/passwd')",
    "SELECT * FROM '/etc/passwd'", "SELECT * FROM glob('/etc/*')",
    "SELECT * FROM read_blob('{root}/../jobs/*/report.json')",
    "SELECT * FROM read_parquet('https://example.com/x.parquet')", "SELECT * FROM query('COPY jobs TO ''{out}''')",
    "WITH x AS (DELETE FROM jobs RETURNING *) SELECT * FROM x", 'CALL pragma_version()', 'BEGIN; SELECT 1',
    "PREPARE p AS SELECT 1", "CREATE MACRO m() AS 1", "SELECT getenv('HOME')", "PIVOT jobs ON part USING count(*)",
    "SELECT * FROM sniff_csv('/etc/passwd')", 'CHECKPOINT', "SELECT * FROM read_json('/etc/hostname')",
)  # fmt: skip


@pytest.mark.parametrize('attempt', ESCAPES)
def test_nothing_gets_out_and_nothing_is_written(archive, tmp_path, attempt):
    files = {f: f.stat().st_mtime_ns for f in archive.store.root.rglob('*')}
    out = tmp_path / 'out'
    with pytest.raises(SqlError):
        archive.sql(attempt.format(out=out, root=archive.store.root))
    assert not out.exists()
    assert {f: f.stat().st_mtime_ns for f in archive.store.root.rglob('*')} == files


@given(st.text(max_size=30))
@settings(max_examples=8, deadline=None)
def test_any_text_is_answered_or_refused(archive, text):
    try:
        archive.sql(text)
    except SqlError as e:
        assert str(e)


# ---- other programs ------------------------------------------------------------------------------


@pytest.mark.parametrize('kind', ['parquet', 'csv', 'json'])
def test_export(archive, tmp_path, kind):
    counts = export(archive, Selection(part='jaw*'), kind, TABLES, tmp_path / "it's here")
    assert counts['jobs'] == 2 and counts['layers'] == 6
    file = tmp_path / "it's here" / f'jobs.{kind}'
    found = duckdb.sql(f"""SELECT part FROM '{str(file).replace("'", "''")}'""").fetchall()
    assert found == [('jaw.stl',)] * 2
    with pytest.raises(ValueError, match='exists'):
        export(archive, Selection(), kind, TABLES, tmp_path / "it's here")


def test_files_are_readable_without_this_software(archive):
    """By pyarrow, which pandas and polars readers share."""
    from pyarrow import dataset

    files = [str(f) for f in archive.store.root.glob('segments/*/jobs.parquet')]
    table = dataset.dataset(files).to_table(columns=['job', 'rms_mm'])
    assert table.num_rows == 4
    layout = json.loads((archive.store.root / 'archive.json').read_text())
    assert layout == {'schema': VERSION}


def test_reading_verbs_need_no_pyarrow():
    """It takes half a second to import; only taking in needs it."""
    code = 'import sys, waam_archive.archive, waam_archive.commands.ask; sys.exit("pyarrow" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
