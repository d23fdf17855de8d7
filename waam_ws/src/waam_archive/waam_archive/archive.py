"""Questions to the archive: DuckDB in memory, with the tables as views over the Parquet files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import duckdb

from .catalog import ArchiveError, Catalog
from .schema import SQL_TYPES, TABLES, select_list
from .selection import Selection
from .store import Store, literal

Row = dict[str, Any]
Answer = TypeVar('Answer')
SEARCHED = (
    'job', 'name', 'part', 'material', 'operator', 'wire_lot', 'gas', 'verdict', 'message', 'cell',
)  # fmt: skip


# report and job without the names of their entries, or `arc` would be found in every report ("arc_on_s": ...)
PLAIN_TEXT = """regexp_replace(concat_ws(' ', regexp_replace(report, '"[A-Za-z0-9_.]+":', '', 'g'),
    regexp_replace(asked, '(?m)^[ -]*[A-Za-z0-9_]+:', '', 'g')), '\\s+', ' ', 'g')"""
EXCERPT = "regexp_extract(told, '(?i).{0,30}' || regexp_escape($1) || '.{0,30}')"


class NoJob(ArchiveError):
    """No job of that name."""


class SqlError(ValueError):
    """A query of a user that cannot be answered; the text says why."""


class Archive:
    """Reads an archive. A merge in another process between two looks is waited out by looking again."""

    def __init__(self, root: Path) -> None:
        self.store = Store(root)
        self._open: dict[tuple[str, ...], tuple[tuple[int, ...], duckdb.DuckDBPyConnection]] = {}

    # ---- connections -----------------------------------------------------------------------------

    def _connection(self, tables: tuple[str, ...]) -> duckdb.DuckDBPyConnection:
        """That of the last question about these tables when the archive is the same, else a new one."""
        catalog = self.store.catalog()
        seen = tuple(catalog.segments)
        before = self._open.get(tables)
        if before is not None and before[0] == seen:
            return before[1]
        self._forget(tables)
        made = self.connect(tables, catalog)
        self._open[tables] = seen, made
        return made

    def _forget(self, tables: tuple[str, ...]) -> None:
        before = self._open.pop(tables, None)
        if before is not None:
            before[1].close()

    def connect(
        self,
        tables: tuple[str, ...],
        catalog: Catalog | None = None,
    ) -> duckdb.DuckDBPyConnection:
        """A new database in memory with these tables as views. Close it."""
        catalog = catalog or self.store.catalog()
        db = duckdb.connect(config={'temp_directory': ''})
        stale = catalog.stale()
        db.execute('CREATE TEMP TABLE stale (file VARCHAR, job VARCHAR)')
        for table in tables:
            files = self._files(catalog, table)
            db.execute(f'CREATE VIEW "{table}" AS {self._view(table, catalog, files, bool(stale))}')
            of_stale = [(f, job) for n, f in files for number, job in stale if n == number]
            if of_stale:
                db.executemany('INSERT INTO stale VALUES (?, ?)', of_stale)
        return db

    def _files(self, catalog: Catalog, table: str) -> list[tuple[int, str]]:
        found = catalog.small_files(table)
        return [(n, str((self.store.root / f).resolve())) for n, f in found]

    @staticmethod
    def _view(table: str, catalog: Catalog, files: list[tuple[int, str]], stale: bool) -> str:
        if not files:
            nothing = (f'NULL::{SQL_TYPES[c.kind]} AS "{c.name}"' for c in TABLES[table])
            return f'SELECT {", ".join(nothing)} WHERE false'
        by_version: dict[int, list[str]] = {}
        for n, file in files:
            by_version.setdefault(catalog.segments[n].schema, []).append(literal(file))
        parts = (_select(table, v, ', '.join(f), stale) for v, f in sorted(by_version.items()))
        return ' UNION ALL '.join(parts)

    def ask(self, tables: tuple[str, ...], question: Callable[[Any], Answer]) -> Answer:
        """Answer of a question to a connection; asked again when a merge has taken a file away. ArchiveError names a
        damaged file."""
        for last in (False, True):
            try:
                return question(self._connection(tables))
            except (duckdb.IOException, duckdb.InvalidInputException, FileNotFoundError) as e:
                self._forget(tables)
                if last:
                    raise ArchiveError(
                        f'{self.store.root}: a file is missing or damaged ({_first_line(e)}); '
                        'waam jobs verify --repair'
                    ) from None
        raise AssertionError('not reached')

    def rows(
        self, tables: tuple[str, ...], query: str, values: list[Any] | None = None
    ) -> list[Row]:
        """Rows of a query of this software."""
        return self.ask(tables, lambda db: as_rows(db.execute(query, values or [])))

    # ---- questions -------------------------------------------------------------------------------

    def jobs(self, selection: Selection, limit: int = 0) -> list[Row]:
        """Rows of the table jobs, newest first. limit: 0 = all."""
        where, values = selection.where()
        query = f'SELECT * FROM jobs WHERE {where} ORDER BY created DESC NULLS LAST, job DESC'
        if limit:
            query += ' LIMIT ?'
            values.append(limit)
        return self.rows(('jobs',), query, values)

    def job_named(self, name: str) -> str:
        """The one job whose id is, or begins with, or contains this text. NoJob names the candidates."""
        return self._one_named('job', name)

    def part_named(self, name: str) -> str:
        """The one part whose file name is, or contains, this text. NoJob names the candidates."""
        return self._one_named('part', name)

    def _one_named(self, column: str, name: str) -> str:
        query = f'SELECT DISTINCT {column} FROM jobs WHERE contains(lower({column}), lower(?)) ORDER BY 1'
        found = [str(r[column]) for r in self.rows(('jobs',), query, [name])]
        if name in found:
            return name
        if len(found) == 1:
            return found[0]
        if not found:
            raise NoJob(f"there is no {column} '{name}' in {self.store.root} (waam jobs list)")
        more = f' and {len(found) - 5} more' if len(found) > 5 else ''
        raise NoJob(
            f"'{name}' is in the name of {len(found)} {column}s: {', '.join(found[:5])}{more}"
        )

    def of_job(self, table: str, job: str) -> list[Row]:
        """Rows of a table of one job."""
        if table not in TABLES:
            raise SqlError(f"there is no table '{table}'; known are {', '.join(TABLES)}")
        return self.rows((table,), f'SELECT * FROM "{table}" WHERE job = ?', [job])

    def find(self, text: str, selection: Selection) -> list[Row]:
        """Jobs with this text in a name, a message, an anomaly or a report: job, created, verdict, where, text."""
        where, values = selection.where()
        own = ' UNION ALL '.join(
            f'SELECT job, \'{name}\' AS place, "{name}" AS said FROM jobs WHERE contains(lower("{name}"), lower($1))'
            for name in SEARCHED
        )
        query = f"""
            WITH hits AS ({own}
              UNION ALL SELECT job, 'anomaly', severity || ' ' || class_name || ': ' || text || ' (' || reaction || ')'
                FROM anomalies WHERE contains(lower(concat_ws(' ', class_name, text, reaction)), lower($1))
              UNION ALL SELECT job, 'report', {EXCERPT} FROM (SELECT job, {PLAIN_TEXT} AS told FROM reports)
                WHERE contains(lower(told), lower($1))),
            best AS (SELECT job, min_by(place, rank) AS place, min_by(said, rank) AS said, count(*) AS hits FROM
              (SELECT *,
              CASE place WHEN 'anomaly' THEN 1 WHEN 'report' THEN 2 ELSE 0 END AS rank FROM hits) GROUP BY job)
            SELECT best.job, created, verdict, place, said, hits FROM best JOIN jobs USING (job)
            WHERE {_numbered(where, 2)} ORDER BY created DESC NULLS LAST, best.job"""
        return self.rows(('jobs', 'anomalies', 'reports'), query, [text, *values])

    # ---- a user's own SQL ------------------------------------------------------------------------

    def sql(self, query: str, limit: int = 0) -> tuple[list[str], list[tuple]]:
        """Columns and rows of one SELECT of a user, which can read the tables of this archive and nothing else.
        SqlError. Only the files of the tables that it names are opened."""
        db = None
        try:
            db = self.connect(tables_of(query))
            self._lock(db)
            kinds = [s.type for s in db.extract_statements(query)]
            if kinds != [duckdb.StatementType.SELECT]:
                raise SqlError('exactly one SELECT is allowed here: the archive is read-only')
            result = db.execute(query)
            columns = [d[0] for d in result.description or []]
            return columns, result.fetchmany(limit) if limit else result.fetchall()
        except (duckdb.Error, FileNotFoundError) as e:
            ours = str(self.store.root.resolve()) in str(e)
            hint = '; waam jobs verify --repair' if ours else ''
            raise SqlError(f'{_first_line(e)}{hint}') from None
        finally:
            if db is not None:
                db.close()

    def _lock(self, db: duckdb.DuckDBPyConnection) -> None:
        """From here on nothing outside the archive can be read, and no setting changed."""
        folder = literal(str(self.store.root.resolve()))
        db.execute(f'SET allowed_directories = [{folder}]')
        db.execute('SET enable_external_access = false')
        db.execute("SET autoinstall_known_extensions = false")
        db.execute('SET lock_configuration = true')


def _select(table: str, version: int, listed: str, stale: bool) -> str:
    """Rows of files of one version of the schema, without those of stale jobs."""
    columns = select_list(table, version)
    if not stale:
        return f'SELECT {columns} FROM read_parquet([{listed}])'
    return (
        f'SELECT {columns} FROM read_parquet([{listed}], filename=true) p WHERE NOT EXISTS '
        '(SELECT 1 FROM stale s WHERE s.file = p.filename AND s.job = p.job)'
    )


def tables_of(query: str) -> tuple[str, ...]:
    """The tables of the archive that a query names; all where it cannot be read."""
    with duckdb.connect(config={'enable_external_access': 'false'}) as db:
        if [s.type for s in _statements(db, query)] != [duckdb.StatementType.SELECT]:
            return tuple(TABLES)
        for table in TABLES:
            db.execute(f'CREATE TABLE "{table}" AS {Archive._view(table, Catalog(), [], False)}')
        try:
            named = db.get_table_names(query)
        except (duckdb.Error, RuntimeError):
            return tuple(TABLES)
    return tuple(t for t in TABLES if t in {n.lower() for n in named})


def _statements(db: duckdb.DuckDBPyConnection, query: str) -> list[Any]:
    try:
        return db.extract_statements(query)
    except duckdb.Error:
        return []


def as_rows(result: duckdb.DuckDBPyConnection) -> list[Row]:
    """Rows of a result as dicts."""
    columns = [d[0] for d in result.description or []]
    return [dict(zip(columns, r, strict=True)) for r in result.fetchall()]


def _first_line(e: Exception) -> str:
    return ' '.join(str(e).split('\n\n')[0].split())


def _numbered(where: str, first: int) -> str:
    """? of a condition as $first, $first+1 ..."""
    parts = where.split('?')
    return parts[0] + ''.join(f'${first + i}{p}' for i, p in enumerate(parts[1:]))
