"""The mapping file: which column of a log is what, in which unit, and how its time is written. Read and checked here;
what is wrong in it is refused by name."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from ..bag_writer import BagError
from . import times
from .quantities import MANY, ROLES, UNITS
from .text import DELIMITERS, Form

VERSION = 1
AXES = ('+x', '-x', '+y', '-y')


@dataclass(frozen=True)
class Time:
    """column '' = none, the rows come at rate_hz. start_ns: what relative times count from. offset_s is added to all
    stamps: clocks of two files that differ. nanoseconds: a second column that is added, as ROS has it."""

    column: str = ''
    form: str = 's'
    start_ns: int = 0
    rate_hz: float = 0.0
    offset_s: float = 0.0
    nanoseconds: str = ''


@dataclass(frozen=True)
class Travel:
    """Where the torch was when the file does not say: from start (m) along an axis, at speed (m/s)."""

    direction: str
    speed: float
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Column:
    """role: a key of ROLES; unit: of its quantity, '' = none."""

    role: str
    unit: str = ''


@dataclass(frozen=True)
class FileMap:
    """One file."""

    form: Form
    time: Time
    columns: Mapping[str, Column]
    travel: Travel | None = None
    notes: Mapping[str, str] = field(
        default_factory=dict
    )  # what of a proposal is guessed, by place

    def column_of(self, role: str) -> str:
        """The column with a role; '' when there is none."""
        return next((name for name, c in self.columns.items() if c.role == role), '')


def read_mapping(text: str, name: str) -> dict[str, FileMap]:
    """File name or pattern -> its map. BagError says which entry is wrong, and what is allowed."""
    try:
        data = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as e:
        raise BagError(f'{name}: not YAML: {" ".join(str(e).split())[:200]}') from None
    top = _block(data, name, ('waam_import', 'files'))
    if top.get('waam_import') != VERSION:
        raise BagError(f'{name}: waam_import must be {VERSION}, is {top.get("waam_import")!r}')
    files = _block(top.get('files'), f'{name}: files', None)
    if not files:
        raise BagError(f'{name}: files is empty')
    return {str(k): _file(v, f'{name}: {k}') for k, v in files.items()}


def map_for(mapping: Mapping[str, FileMap], file: str, name: str) -> FileMap:
    """Of a file by its name, then by the first pattern (*.csv) that fits. BagError when there is none."""
    if file in mapping:
        return mapping[file]
    for pattern, one in mapping.items():
        if fnmatch.fnmatchcase(file, pattern):
            return one
    raise BagError(f'{name}: nothing about {file}; it has {", ".join(mapping)}')


def _block(value: Any, where: str, keys: tuple[str, ...] | None) -> dict:
    if not isinstance(value, dict):
        raise BagError(f'{where}: names and values are wanted, not {value!r:.60}')
    for key in value:
        if keys is not None and key not in keys:
            raise BagError(f'{where}: unknown entry {key!r:.60}; known are {", ".join(keys)}')
    return value


def _real(value: Any, where: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise BagError(f'{where}: a number from {low:g} to {high:g} is wanted, not {value!r:.60}')
    return float(value)


def _one_of(value: Any, where: str, allowed: tuple[str, ...]) -> str:
    if value not in allowed or not isinstance(value, str):
        raise BagError(f'{where}: {value!r:.60} is none of {", ".join(allowed)}')
    return value


def _file(value: Any, where: str) -> FileMap:
    keys = ('delimiter', 'decimal', 'header_line', 'time', 'columns', 'travel')
    block = _block(value, where, keys)
    delimiter = _one_of(block.get('delimiter'), f'{where}: delimiter', tuple(DELIMITERS))
    decimal = _one_of(block.get('decimal', '.'), f'{where}: decimal', ('.', ','))
    if delimiter == decimal == ',':
        raise BagError(f'{where}: delimiter and decimal sign cannot both be a comma')
    line = _real(block.get('header_line', 1), f'{where}: header_line', 0, 1e6)
    columns = _columns(block.get('columns'), f'{where}: columns')
    travel = _travel(block['travel'], f'{where}: travel') if block.get('travel') else None
    time = _time(block.get('time'), f'{where}: time')
    for name in (time.column, time.nanoseconds):
        if name in columns:
            raise BagError(f'{where}: column {name} is the time and stands under columns, too')
    return FileMap(Form(delimiter, decimal, int(line)), time, columns, travel)


def _columns(value: Any, where: str) -> dict[str, Column]:
    found: dict[str, Column] = {}
    for name, entry in _block(value, where, None).items():
        block = _block(entry, f'{where}: {name}', ('is', 'unit'))
        role = _one_of(block.get('is'), f'{where}: {name}: is', tuple(ROLES))
        units = UNITS[ROLES[role].quantity]
        unit = str(block.get('unit', '') or '')
        if '' in units and unit:
            raise BagError(f'{where}: {name}: {role} has no unit')
        if unit not in units:
            raise BagError(f'{where}: {name}: unit {unit!r} is none of {", ".join(units)}')
        twice = next((n for n, c in found.items() if c.role == role and role not in MANY), None)
        if twice:
            raise BagError(f'{where}: {twice} and {name} are both {role}')
        found[str(name)] = Column(role, unit)
    return found


def _time(value: Any, where: str) -> Time:
    block = _block(
        value, where, ('column', 'nanoseconds', 'format', 'start', 'rate_hz', 'offset_s')
    )
    offset = _real(block.get('offset_s', 0.0), f'{where}: offset_s', -1e9, 1e9)
    start = 0
    if block.get('start') is not None:
        start = _start(block['start'], where)
    column = block.get('column')
    if column is None:
        rate = _real(block.get('rate_hz'), f'{where}: rate_hz (there is no column)', 1e-6, 1e6)
        return Time('', '', start, rate, offset)
    if 'rate_hz' in block:
        raise BagError(f'{where}: column and rate_hz contradict each other')
    form = _one_of(block.get('format'), f'{where}: format', times.FORMATS)
    rest = block.get('nanoseconds')
    return Time(str(column), form, start, 0.0, offset, '' if rest is None else str(rest))


def _start(value: Any, where: str) -> int:
    text = value.isoformat() if hasattr(value, 'isoformat') else str(value)
    try:
        ns = times.date_ns(text)
    except (ValueError, OverflowError) as e:
        raise BagError(f'{where}: start {text[:40]!r}: {e}; as in 2026-01-31T08:00:00Z') from None
    if not 0 <= ns < times.LAST:
        raise BagError(f'{where}: start {text[:40]!r} is outside 1970 to 2038')
    return ns


def _travel(value: Any, where: str) -> Travel:
    block = _block(value, where, ('direction', 'speed_mm_s', 'start_mm'))
    direction = _one_of(block.get('direction'), f'{where}: direction', AXES)
    speed = _real(block.get('speed_mm_s'), f'{where}: speed_mm_s', 1e-3, 1e4) * 1e-3
    start = block.get('start_mm', [0, 0, 0])
    if not isinstance(start, list) or len(start) != 3:
        raise BagError(f'{where}: start_mm: three numbers are wanted')
    x, y, z = (_real(v, f'{where}: start_mm', -1e5, 1e5) * 1e-3 for v in start)
    return Travel(direction, speed, (x, y, z))


def written(files: Mapping[str, FileMap]) -> str:
    """The mapping file; what is guessed has a comment that says from what."""
    lines = [f'waam_import: {VERSION}', 'files:']
    for name, one in files.items():
        lines += [f'  {_key(name)}:', *_written(one)]
    return '\n'.join(lines) + '\n'


def _key(text: str) -> str:
    return yaml.safe_dump(text, allow_unicode=True, width=10**6).removesuffix('...\n').strip()


def _written(one: FileMap) -> list[str]:
    note = {k: f'  # {v}' for k, v in one.notes.items()}
    form, time = one.form, one.time
    lines = [
        f'    delimiter: {_key(form.delimiter)}',
        f'    decimal: {_key(form.decimal)}{note.get("decimal", "")}',
        f'    header_line: {form.header_line}{note.get("header", "")}',
        '    time:',
    ]
    if time.column:
        lines.append(f'      column: {_key(time.column)}')
        if time.nanoseconds:
            lines.append(f'      nanoseconds: {_key(time.nanoseconds)}')
        lines.append(f'      format: {time.form}{note.get("format", "")}')
    else:
        lines.append(f'      rate_hz: {time.rate_hz:g}{note.get("rate", "")}')
    if time.start_ns:
        lines.append(f'      start: {times.words(time.start_ns)}{note.get("start", "")}')
    lines.append(f'      offset_s: {time.offset_s:g}{note.get("offset", "")}')
    if one.travel:
        t = one.travel
        start = ', '.join(f'{v * 1e3:g}' for v in t.start)
        values = f"direction: '{t.direction}', speed_mm_s: {t.speed * 1e3:g}, start_mm: [{start}]"
        lines.append(f'    travel: {{{values}}}{note.get("travel", "")}')
    lines.append('    columns:' + ('' if one.columns else ' {}'))
    for name, c in one.columns.items():
        unit = f', unit: {c.unit}' if c.unit else ''
        lines.append(f'      {_key(name)}: {{is: {c.role}{unit}}}{note.get(f"column {name}", "")}')
    return lines
