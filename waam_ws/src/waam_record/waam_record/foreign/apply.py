"""A table and its mapping to messages, with a count of everything that does not become one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..bag_writer import BagError
from ..log_column import Column
from . import messages as own
from . import times
from .mapping import FileMap
from .quantities import PROFILE, ROLES, TELEMETRY, plain, si
from .tally import Tally
from .text import Table, missing, number

ARC_AMPERE = 10.0  # A; a log without a column for the arc: it burns above this current
FIELDS = {'position_x': 'x', 'position_y': 'y', 'position_z': 'z', 'arc_on': 'arc_established'}
OWN_NAMES = {
    'telemetry', 'profiles', 'temperature', 'height_map', 'correction_map', 'layer_plan', 'heat_factor', 'job_status',
    'layer_report', 'machine_state', 'anomaly', 'segment_done', 'process_estimate', 'joint_states',
}  # fmt: skip


@dataclass
class Imported:
    """Topics of a file and what is said about it: `told` lines, the first one its sum."""

    columns: list[Column]
    told: list[str]
    first_ns: int = 0


@dataclass
class _File:
    table: Table
    map: FileMap
    name: str
    stem: str
    tally: Tally = field(default_factory=Tally)
    stamps: list[int] = field(default_factory=list)
    rows: list[tuple[int, list[str]]] = field(default_factory=list)

    def role(self, role: str) -> list[str] | None:
        """Cells of the column with this role, one per row; None when there is none."""
        name = self.map.column_of(role)
        return self.cells(name) if name else None

    def cells(self, name: str) -> list[str]:
        k = self.table.head.index(name)
        return [cells[k] for _, cells in self.rows]

    def values(self, name: str) -> np.ndarray:
        """(n,) SI of a column, NaN = none; what is no number is counted."""
        column, decimal = self.map.columns[name], self.table.form.decimal
        quantity = ROLES[column.role].quantity
        out = np.full(len(self.rows), np.nan)
        for k, (line, text) in enumerate(zip(self.lines, self.cells(name), strict=True)):
            value = si(number(text, decimal), quantity, column.unit)
            if math.isfinite(value):
                out[k] = value
            elif not missing(text):
                self.tally.add(f'values of {name} left out: not a number', line)
            else:
                self.tally.add(f'rows have no {name}', line)
        return out

    @property
    def lines(self) -> list[int]:
        return [n for n, _ in self.rows]


def check(table: Table, one: FileMap, name: str) -> None:
    """BagError when mapping and columns of the file are not the same."""
    named = {*one.columns, *(c for c in (one.time.column, one.time.nanoseconds) if c)}
    if extra := [c for c in named if c not in table.head]:
        raise BagError(
            f'{name}: the mapping has column {extra[0]!r}, the file {", ".join(table.head)[:300]}'
        )
    if lacking := [c for c in table.head if c not in named]:
        raise BagError(
            f'{name}: the mapping says nothing of column {lacking[0]!r}; `{{is: ignore}}` leaves it out'
        )
    if any(one.column_of(r) for r in PROFILE) and not (
        one.column_of('profile_x') and _height_role(one)
    ):
        raise BagError(f'{name}: a profile needs profile_x and profile_height or profile_distance')
    if one.column_of('profile_height') and one.column_of('profile_distance'):
        raise BagError(f'{name}: profile_height and profile_distance contradict each other')


def _height_role(one: FileMap) -> str:
    return next((r for r in ('profile_height', 'profile_distance') if one.column_of(r)), '')


def stamps_of(table: Table, one: FileMap, tally: Tally) -> tuple[list[int], list]:
    """ns since 1970 of the rows whose time can be read, and these rows; the rest is counted."""
    time, good, found = one.time, [], []
    if time.rate_hz:
        found = [time.start_ns + round(k * times.S / time.rate_hz) for k in range(len(table.rows))]
        good = list(table.rows)
    else:
        at, read = table.head.index(time.column), times.reader(time.form)
        rest = table.head.index(time.nanoseconds) if time.nanoseconds else -1
        for line, cells in table.rows:
            try:
                found.append(read(cells[at]) + (int(cells[rest]) if rest >= 0 else 0))
                good.append((line, cells))
            except (ValueError, OverflowError) as e:
                tally.add(f'rows left out: time is {e}', line)
        if time.form in times.WRAPS:
            found = times.unwrapped(found, times.WRAPS[time.form])
        found = [ns + time.start_ns for ns in found]
    shift = round(time.offset_s * times.S)
    kept, rows = [], []
    for ns, row in zip(found, good, strict=True):
        if 0 <= ns + shift < times.LAST:
            kept.append(ns + shift)
            rows.append(row)
        else:
            tally.add('rows left out: time is outside 1970 to 2038', row[0])
    return kept, rows


def imported(table: Table, one: FileMap, name: str, stem: str) -> Imported:
    """Messages of one file. BagError when none is left, or when mapping and file do not fit."""
    check(table, one, name)
    file = _File(table, one, name, stem)
    for line, why in table.skipped:
        file.tally.add(f'lines left out: {why}', line)
    file.stamps, file.rows = stamps_of(table, one, file.tally)
    if not file.rows:
        raise BagError(
            f'{name}: no row is left: {"; ".join(file.tally.told()) or "the table is empty"}'
        )
    remarks = _order(file)
    makers = (_telemetry, _profiles, _points, _temperatures, _numbers)
    columns = [c for make in makers for c in make(file)]
    columns = [c for c in columns if list(c.messages)]
    if not columns:
        raise BagError(
            f'{name}: the mapping makes no message of it; {"; ".join(file.tally.told())}'
        )
    ignored = [c for c, m in one.columns.items() if m.role == 'ignore']
    if ignored:
        remarks.append(f'not imported: {", ".join(ignored)} ({len(file.rows)} rows each)')
    made = ', '.join(f'{len(list(c.messages))} {c.topic.name}' for c in columns)
    head = f'{name}: {len(file.rows)} of {len(table.rows) + len(table.skipped)} rows; {made}'
    return Imported(columns, [head, *remarks, *file.tally.told()], min(file.stamps))


def _order(file: _File) -> list[str]:
    """Repeated stamps are spread; steps back are told."""
    told = []
    if file.map.time.column:
        if not file.map.column_of('point_profile'):
            file.stamps, moved = times.spread(file.stamps)
            if moved:
                told.append(
                    f'{moved} rows have the stamp of the row before (truncated); spread evenly'
                )
        back = sum(b < a for a, b in zip(file.stamps, file.stamps[1:], strict=False))
        if back:
            told.append(f'{back} times the stamps go back; messages are sorted by time')
    return told


def _telemetry(file: _File) -> list[Column]:
    one = file.map
    roles = [r for r in TELEMETRY if one.column_of(r)]
    if not roles and one.travel is None:
        return []
    fields = {FIELDS.get(r, r): file.values(one.column_of(r)) for r in roles}
    if 'arc_established' not in fields and 'arc_current' in fields:
        fields['arc_established'] = (np.nan_to_num(fields['arc_current']) > ARC_AMPERE).astype(
            float
        )
    if 'arc_established' in fields:
        fields['arc_established'] = np.nan_to_num(fields['arc_established'])
    if one.travel is not None:
        fields.update(_along(file, fields))
    found = []
    for k, stamp in enumerate(file.stamps):
        values = {name: float(v[k]) for name, v in fields.items()}
        found.append((stamp, own.telemetry(stamp, k + 1, values)))
    return [Column(own.topic('/telemetry', own.TELEMETRY), found)]


def _along(file: _File, fields: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Positions from direction and speed of the mapping."""
    travel = file.map.travel
    assert travel is not None
    if any(name in fields for name in 'xyz'):
        raise BagError(f'{file.name}: travel and columns of positions contradict each other')
    way = (np.array(file.stamps) - file.stamps[0]) * 1e-9 * travel.speed
    axis, sign = 'xyz'.index(travel.direction[1]), 1.0 if travel.direction[0] == '+' else -1.0
    out = {name: np.full(len(way), travel.start[k]) for k, name in enumerate('xyz')}
    out['xyz'[axis]] = out['xyz'[axis]] + sign * way
    return out


def _profiles(file: _File) -> list[Column]:
    if file.map.column_of('point_profile') or not file.map.column_of('profile_x'):
        return []
    height = _height_role(file.map)
    texts = [
        file.role(r) or [''] * len(file.rows) for r in ('profile_x', height, 'profile_intensity')
    ]
    columns = [file.map.columns[file.map.column_of(r)] for r in ('profile_x', height)]
    factors = [si(1.0, 'length', c.unit) for c in columns]
    found: list = []
    for line, stamp, x, z, light in zip(file.lines, file.stamps, *texts, strict=True):
        lists = [_list(t, file.table.form.decimal) for t in (x, z, light)]
        sizes = [len(v) for v in lists]
        if sizes[0] != sizes[1] or sizes[2] not in (0, sizes[0]):
            file.tally.add('profiles left out: lists of different lengths', line)
            continue
        across, up = lists[0] * factors[0], lists[1] * factors[1]
        _profile(file, found, line, stamp, across, up, lists[2])
    return [Column(own.topic('/profiles', own.PROFILES), found)]


def _profile(
    file: _File, found: list, line: int, stamp: int, x: np.ndarray, z: np.ndarray, light: np.ndarray
) -> None:
    """One more profile, unless it shows nothing."""
    seen = int((np.isfinite(x) & np.isfinite(z)).sum())
    if seen < 2:
        file.tally.add(f'profiles left out: {seen or "no"} point{"s" * (not seen)}', line)
        return
    up = -z if _height_role(file.map) == 'profile_distance' else z
    found.append((stamp, own.profile(stamp, len(found), x, up, light)))


def _list(text: str, decimal: str) -> np.ndarray:
    values = np.array([number(c, decimal) for c in text.split()], float)
    return np.where(np.abs(values) < 1e9, values, np.nan)  # no length


def _points(file: _File) -> list[Column]:
    name = file.map.column_of('point_profile')
    if not name:
        return []
    height = _height_role(file.map)
    x, z = (file.values(file.map.column_of(r)) for r in ('profile_x', height))
    group = file.cells(name)
    found: list = []
    begin = 0
    for k in range(1, len(group) + 1):
        if k == len(group) or group[k] != group[begin]:
            _profile(
                file,
                found,
                file.lines[begin],
                file.stamps[begin],
                x[begin:k],
                z[begin:k],
                np.empty(0),
            )
            begin = k
    return [Column(own.topic('/profiles', own.PROFILES), found)]


def _temperatures(file: _File) -> list[Column]:
    names = [n for n, c in file.map.columns.items() if c.role == 'temperature']
    out = []
    for name in names:
        topic = '/temperature' if len(names) == 1 else f'/{file.stem}/{_topic(name)}'
        pairs = _told(file, name, own.temperature)
        out.append(Column(own.topic(topic, own.TEMPERATURE), pairs))
    return out


def _numbers(file: _File) -> list[Column]:
    out, had = [], set()
    for name in [n for n, c in file.map.columns.items() if c.role == 'number']:
        topic = again = f'/{file.stem}/{_topic(name)}'
        while again in had:
            again = f'{again}_2'
        had.add(again)
        topic = again
        pairs = _told(file, name, lambda stamp, v: own.number(v))
        out.append(Column(own.topic(topic, own.FLOAT), pairs))
    return out


def _told(file: _File, name: str, pack: Callable[[int, float], bytes]) -> list[tuple[int, bytes]]:
    values = file.values(name)
    return [(t, pack(t, float(v))) for t, v in zip(file.stamps, values, strict=True) if v == v]


def _topic(name: str) -> str:
    """A column as part of a topic; names that this software has for other things get `_value`."""
    word = ''.join(c for c in plain(name) if c.isascii()).strip('_') or 'column'
    word = f'c_{word}' if word[0].isdigit() else word
    return f'{word}_value' if word in OWN_NAMES else word
