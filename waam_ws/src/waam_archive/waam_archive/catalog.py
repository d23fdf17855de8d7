"""What is in the archive: the markers of its segments, and which of them count. Pure.

A segment holds the small tables of one or many jobs. It is there from the moment that its marker is: the marker is
written last, in one step. A marker may replace other segments; those do not count any more. Of a job that several
segments hold, the segment with the highest number counts.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from waam_process.safe_files import parse_json

from .schema import FIRST_VERSION, TABLES, VERSION

FORMAT = 'waam archive segment'
_HEAD = re.compile(r'\{"crc32": (\d{1,10}),')


class ArchiveError(ValueError):
    """The archive, or a part of it, cannot be used; the text names the file."""


@dataclass(frozen=True)
class File:
    """A Parquet file: name below the archive, hash, size, rows."""

    name: str
    sha256: str
    bytes: int
    rows: int


@dataclass(frozen=True)
class Entry:
    """A job in a segment. sha256, stamp and source as of `Content`."""

    sha256: str
    source: str
    stamp: str
    has_report: bool


@dataclass(frozen=True)
class Segment:
    """One marker. files: small table -> file; schema: version of their tables."""

    number: int
    replaces: tuple[int, ...]
    jobs: Mapping[str, Entry]
    files: dict[str, File]
    schema: int = VERSION

    def text(self) -> str:
        """JSON; its first line is a CRC-32 over the bytes of the others. `parse` reads it."""
        jobs = {job: asdict(e) for job, e in self.jobs.items()}
        files = {table: asdict(f) for table, f in self.files.items()}
        told = {'number': self.number, 'replaces': self.replaces, 'jobs': jobs, 'files': files}
        data = {'format': FORMAT, **told, 'schema': self.schema}
        body = json.dumps(data, indent=0)[1:]
        return f'{{"crc32": {zlib.crc32(body.encode())},{body}'


def parse(content: str, name: str) -> Segment:
    """ArchiveError when the text is torn, changed, of another kind, or of a newer version."""
    try:
        head = _HEAD.match(content)
        if head is None or int(head.group(1)) != zlib.crc32(content[head.end() :].encode()):
            raise ValueError('the check sum does not fit')
        data = parse_json(content, name)
        if data['format'] != FORMAT:
            raise ValueError('another kind of file')
        schema = data.pop('schema')
    except (ValueError, KeyError, TypeError, AttributeError) as e:
        why = e if type(e) is ValueError else type(e).__name__
        raise ArchiveError(f'{name}: damaged ({why}); waam jobs verify --repair') from None
    check_version(schema, name)
    for entry in data['jobs'].values():
        entry.pop('bulk', None)  # up to schema 2: files of telemetry and maps
    jobs = {j: Entry(**e) for j, e in data['jobs'].items()}
    files = _files(data['files'])
    return Segment(data['number'], tuple(data['replaces']), jobs, files, schema)


def check_version(schema: Any, name: str) -> None:
    """ArchiveError for a version of the schema that cannot be read."""
    if schema not in range(FIRST_VERSION, VERSION + 1):
        known = f'{FIRST_VERSION} to {VERSION}'
        raise ArchiveError(f'{name}: schema {schema}; this software reads schemas {known}')


def _files(data: dict[str, dict[str, Any]]) -> dict[str, File]:
    return {table: File(**f) for table, f in data.items()}


@dataclass
class Catalog:
    """The segments that count, and where every job is."""

    segments: dict[int, Segment] = field(default_factory=dict)
    home: dict[str, int] = field(default_factory=dict)  # job -> segment
    replaced: set[int] = field(default_factory=set)  # on disk still, but do not count

    @classmethod
    def of(cls, segments: Iterable[Segment]) -> Catalog:
        """From all markers on disk, in any order."""
        found = {s.number: s for s in segments}
        replaced = {n for s in found.values() for n in s.replaces} & set(found)
        live = {n: found[n] for n in sorted(found) if n not in replaced}
        home = {job: n for n, s in live.items() for job in s.jobs}
        return cls(live, home, replaced)

    def entry(self, job: str) -> Entry | None:
        """None when the archive does not have the job."""
        number = self.home.get(job)
        return None if number is None else self.segments[number].jobs[job]

    def entries(self) -> dict[str, Entry]:
        """All jobs."""
        return {job: self.segments[n].jobs[job] for job, n in self.home.items()}

    def stale(self) -> list[tuple[int, str]]:
        """(segment, job) whose rows do not count, because a newer segment has the job."""
        return [(n, j) for n, s in self.segments.items() for j in s.jobs if self.home[j] != n]

    def small_files(self, table: str) -> list[tuple[int, str]]:
        """(segment, file) of a small table."""
        found = ((n, s.files.get(table)) for n, s in self.segments.items())
        return [(n, f.name) for n, f in found if f is not None and f.rows]

    def to_merge(self, fan: int) -> list[int]:
        """Segments of one order of size, when there are `fan` of them: merged they become one of the next order."""
        classes: dict[int, list[int]] = {}
        for number, segment in self.segments.items():
            classes.setdefault(_order(len(segment.jobs), fan), []).append(number)
        full = [numbers for _, numbers in sorted(classes.items()) if len(numbers) >= fan]
        return full[0] if full else []


def _order(jobs: int, fan: int) -> int:
    order = 0
    while jobs >= fan:
        jobs //= fan
        order += 1
    return order


def small_name(number: int, table: str) -> str:
    """Name of a segment's file of a small table below the archive."""
    if table not in TABLES:
        raise ValueError(f'{table} is not one of {", ".join(TABLES)}')
    return f'segments/{number:08d}/{table}.parquet'


def marker_name(number: int) -> str:
    """Name of the marker of a segment below the archive."""
    return f'segments/{number:08d}.json'
