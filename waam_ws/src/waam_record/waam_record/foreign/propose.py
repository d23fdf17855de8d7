"""A mapping from the header and the values. What does not stand in the file is a guess, and says from what."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import median

from . import times
from .mapping import Column, FileMap, Time, Travel
from .quantities import PROFILE, ROLES, TELEMETRY, TIME_NAMES, UNITS, parts_of
from .text import Table, missing, number

ROS_HEADER = ('header', 'seq', 'frame_id', 'rosbagtimestamp')
SAMPLE = 2000  # rows that are looked at
GUESSED = 'GUESSED'
START = '2000-01-01T00:00:00Z'
STEPS = {  # quantity -> upper ends of the median of |value| and the unit below each
    'travel': ((0.06, 'm/s'), (3.5, 'm/min'), (80.0, 'mm/s'), (math.inf, 'mm/min')),
    'wire': ((0.4, 'm/s'), (30.0, 'm/min'), (400.0, 'mm/s'), (math.inf, 'mm/min')),
    'length': ((1.5, 'm'), (math.inf, 'mm')),
    'current': ((1.0, 'kA'), (math.inf, 'A')),
    'voltage': ((1000.0, 'V'), (math.inf, 'mV')),
    'temperature': ((math.inf, 'C'),),
}


def propose(table: Table) -> FileMap:
    """The map of a file with `notes` for everything that was guessed or not understood."""
    notes: dict[str, str] = {}
    if not table.form.header_line:
        notes['header'] = 'no line with names; columns are called column_1 ...'
    if table.form.decimal == ',':
        notes['decimal'] = 'from the values'
    time = _time(table, notes)
    columns: dict[str, Column] = {}
    listed = [h for h in table.head if _kind(table, h) == 'list']
    points = _is_points(table)
    for name in table.head:
        if name in (time.column, time.nanoseconds):
            continue
        column, note = _column(table, name, columns, bool(listed), points)
        columns[name] = column
        if note:
            notes[f'column {name}'] = note
    one = FileMap(table.form, time, columns, notes=notes)
    return _travel(one, notes)


def _values(table: Table, name: str) -> list[str]:
    k = table.head.index(name)
    step = max(1, len(table.rows) // SAMPLE)
    return [cells[k] for _, cells in table.rows[::step]]


def _kind(table: Table, name: str) -> str:
    """'number', 'list' (numbers between blanks), 'empty' or 'text': of most cells."""
    filled = [t for t in _values(table, name) if not missing(t)]
    if not filled:
        return 'empty'
    need = times.MIN_SHARE_OF_FORMAT * len(filled)
    decimal = table.form.decimal
    if sum(not math.isnan(number(t, decimal)) for t in filled) >= need:
        return 'number'
    lists = [t.split() for t in filled[:50]]
    good = sum(len(v) > 1 and not any(math.isnan(number(c, decimal)) for c in v) for v in lists)
    return 'list' if good >= 0.5 * len(lists) else 'text'


def _time(table: Table, notes: dict[str, str]) -> Time:
    lower = {h.lower(): h for h in table.head}
    if {'secs', 'nsecs'} <= set(lower) and _kind(table, lower['secs']) == 'number':
        return Time(lower['secs'], 's', nanoseconds=lower['nsecs'])  # the stamp of a ROS message
    best = None
    for wanted in TIME_NAMES:
        for name in table.head:
            if (
                parts_of(name)[0] == wanted
                or name.strip().lower() == wanted
                or _timed(name, wanted)
            ):
                texts = [t for t in _values(table, name) if not missing(t)]
                found = times.guess(texts, name) if texts else None
                if found and best is None:
                    best = name, *found
    if best is None:
        for name in table.head:  # any column of dates
            texts = [t for t in _values(table, name) if not missing(t)]
            found = times.guess(texts, name) if texts else None
            if found and found[0] in (*times.DATES, *times.WRAPS):
                best = name, *found
                break
    if best is None:
        notes['rate'] = f'{GUESSED}: no column with time; say at which rate the rows were taken'
        notes['start'] = f'{GUESSED}: the file has no date'
        return Time('', '', times.date_ns(START), 1.0)
    name, form, why = best
    if why:
        notes['format'] = f'{GUESSED}: {why}'
    start = 0
    if form in times.WRAPS or (form in times.NUMBERS and _relative(table, name, form)):
        start = times.date_ns(START)
        notes['start'] = f'{GUESSED}: the file has no date' + (
            '; minutes count from a full hour' if form == 'minute_second' else ''
        )
    return Time(name, form, start)


def _timed(name: str, wanted: str) -> bool:
    """'time_s' and 'Time (ms)': a time with its unit."""
    bare = name.strip().lower()
    ends = [
        f'{wanted}{a}{u}{b}'
        for u in times.NUMBERS
        for a, b in (('_', ''), (' [', ']'), (' (', ')'))
    ]
    return len(wanted) > 1 and bare in ends


def _relative(table: Table, name: str, form: str) -> bool:
    read = times.reader(form)
    largest = 0
    for text in _values(table, name):
        try:
            largest = max(largest, abs(read(text)))
        except ValueError:
            continue
    return largest < times.ABSOLUTE


def _is_points(table: Table) -> bool:
    """One point of a profile per line: ScanID, X, Z."""
    lower = [h.lower() for h in table.head]
    return 'scanid' in lower and {'x', 'z'} <= set(lower) and 'y' not in lower


def _column(
    table: Table, name: str, had: dict[str, Column], listed: bool, points: bool
) -> tuple[Column, str]:
    kind = _kind(table, name)
    plain, unit = parts_of(name)
    if kind == 'empty':
        return Column('ignore'), 'has no value'
    if plain in ROS_HEADER:
        return Column('ignore'), 'of the header that ROS gives a message'
    if kind == 'text':
        return Column('ignore'), 'NOT UNDERSTOOD: no numbers'
    if kind == 'list' or points:
        return _of_profile(table, name, plain, unit, had, points and kind != 'list')
    role = next((r for r, k in ROLES.items() if plain in k.names), None)
    if role is None or listed:
        return Column('number'), 'NOT UNDERSTOOD: kept as a number, without a unit'
    if role != 'temperature' and any(c.role == role for c in had.values()):
        return Column('number'), f'a second {role}: kept as a number'
    return _with_unit(table, name, role, unit)


def _of_profile(
    table: Table, name: str, plain: str, unit: str, had: dict[str, Column], points: bool
) -> tuple[Column, str]:
    if points and plain == 'scanid':
        return Column('point_profile'), ''
    role = {'x': 'profile_x', 'z': 'profile_distance', 'intensity': 'profile_intensity'}.get(plain)
    if role is None or any(c.role == role for c in had.values()):
        if points:
            return Column('ignore'), 'NOT UNDERSTOOD: a number per point'
        return Column('ignore'), 'NOT UNDERSTOOD: a list in every row'
    if role == 'profile_intensity':
        return Column(role), ''
    sizes = [v for t in _values(table, name)[:200] for v in _floats(t, table) if v]
    middle = median(sizes) if sizes else 0.0
    note = (
        f'{GUESSED}: positive, so a distance from the scanner' if role == 'profile_distance' else ''
    )
    if role == 'profile_distance' and middle < 0:
        role, note = (
            'profile_height',
            f'{GUESSED}: negative, so a height in the frame of the scanner',
        )
    if not unit or unit not in UNITS['length']:
        unit = 'mm' if max((abs(v) for v in sizes), default=9.0) > 3.0 else 'm'
        note += f'{"; " * bool(note)}{GUESSED if not note else "guessed"}: {unit} from the range'
    return Column(role, unit), note


def _floats(text: str, table: Table) -> list[float]:
    found = (number(c, table.form.decimal) for c in text.split())
    return [v for v in found if not math.isnan(v)]


def _with_unit(table: Table, name: str, role: str, unit: str) -> tuple[Column, str]:
    quantity = ROLES[role].quantity
    if quantity == 'none':
        return Column(role), ''
    if unit in UNITS[quantity]:
        return Column(role, unit), ''
    values = [number(t, table.form.decimal) for t in _values(table, name)]
    sizes = [abs(v) for v in values if v and not math.isnan(v)]
    kind = {'travel_speed': 'travel', 'wire_feed_speed': 'wire', 'wire_feed_commanded': 'wire'}
    steps = STEPS[kind.get(role, quantity)]
    middle = max(sizes, default=0.0) if quantity == 'length' else median(sizes or [0.0])
    found = next(u for top, u in steps if middle <= top)
    span = f'{min(sizes, default=0.0):.4g} .. {max(sizes, default=0.0):.4g}'
    return Column(role, found), f'{GUESSED}: {found} from the name and the sizes {span}'


def _travel(one: FileMap, notes: dict[str, str]) -> FileMap:
    """Profiles need to know where the torch was."""
    if not any(one.column_of(r) for r in PROFILE) or any(one.column_of(r) for r in TELEMETRY[:3]):
        return one
    notes['travel'] = (
        f'{GUESSED}: the file does not say where the scanner was; take the line out when another file does'
    )
    return replace(one, travel=Travel('+x', 10e-3))


def together(
    files: dict[str, FileMap], dates: dict[str, int], clocks: dict[str, int]
) -> dict[str, FileMap]:
    """Files without a date take it from one that has one, and profiles the positions of a file that has them. dates:
    file -> its first stamp (ns), of those with a date; clocks: file -> its first time since its start, of others."""
    posed = any(one.column_of(r) for one in files.values() for r in TELEMETRY[:3])
    out = {}
    for name, one in files.items():
        if posed and one.travel is not None:
            notes = {k: v for k, v in one.notes.items() if k != 'travel'}
            one = replace(one, travel=None, notes=notes)
        if dates and one.time.start_ns and name not in dates:
            source, ns = min(dates.items(), key=lambda item: item[1])
            one = _dated(one, source, ns, clocks.get(name, 0))
        out[name] = one
    return out


def _dated(one: FileMap, source: str, ns: int, clock: int) -> FileMap:
    """The full hour (or day) that brings the first row nearest to the first stamp of the other file."""
    period = times.WRAPS.get(one.time.form)
    start = round((ns - clock) / period) * period if period else ns // times.S * times.S
    guesses = {'start': f'{GUESSED}: from {source}', 'offset': f'{GUESSED}: two clocks differ'}
    return replace(one, time=replace(one.time, start_ns=start), notes={**one.notes, **guesses})
