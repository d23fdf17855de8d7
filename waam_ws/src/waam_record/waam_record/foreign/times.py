"""Time stamps as others write them: numbers since 1970 or since a start, dates, and clocks that wrap."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation

S = 1_000_000_000
LAST = (1 << 31) * S  # ns; stamps of ROS end there, in 2038
MIN_SHARE_OF_FORMAT = 0.6  # of the texts must have a format
ABSOLUTE = 10**8 * S  # ns; a smaller largest number counts from a start
NUMBERS = {'s': S, 'ms': 10**6, 'us': 10**3, 'ns': 1}
WRAPS = {'minute_second': 3600 * S, 'clock': 86400 * S}
DATES = ('year_first', 'day_first', 'month_first')
FORMATS = (*NUMBERS, *WRAPS, *DATES)
_YEAR = re.compile(
    r'(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})[ T/_,;-]+'
    r'(?P<H>\d{1,2}):(?P<M>\d{1,2})(:(?P<S>\d{1,2}([.,]\d+)?))?\s*(?P<z>Z|[-+]\d{2}:?\d{2})?',
    re.ASCII,
)
_DAY = re.compile(
    r'(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<y>\d{4})[ T/_,;-]+'
    r'(?P<H>\d{1,2}):(?P<M>\d{1,2})(:(?P<S>\d{1,2}([.,]\d+)?))?\s*(?P<z>Z|[-+]\d{2}:?\d{2})?',
    re.ASCII,
)
_MINUTE = re.compile(r'(\d{1,2}):(\d{1,2}([.,]\d+)?)', re.ASCII)
_CLOCK = re.compile(r'(\d{1,3}):(\d{1,2}):(\d{1,2}([.,]\d+)?)', re.ASCII)


def _number(text: str, unit: int) -> int:
    """ns; ValueError for anything else."""
    try:
        if '_' in text or not text.isascii():
            raise ValueError('not a number')
        value = Decimal(text.strip().replace(',', '.')) * unit
        if not abs(value) <= LAST:  # NaN compares with an error, infinity is too large
            raise ValueError('outside 1970 to 2038')
        return round(value)
    except (ArithmeticError, OverflowError):
        raise ValueError('not a number') from None


def _fraction(text: str, limit: int = 60) -> int:
    ns = _number(text, S)
    if not 0 <= ns < limit * S:
        raise ValueError('seconds are 0 to 60')
    return ns


def _minute_second(text: str) -> int:
    m = _MINUTE.fullmatch(text.strip())
    if not m or int(m[1]) > 59:
        raise ValueError('not minute:second')
    return int(m[1]) * 60 * S + _fraction(m[2])


def _clock(text: str) -> int:
    m = _CLOCK.fullmatch(text.strip())
    if not m or int(m[2]) > 59:
        raise ValueError('not hour:minute:second')
    return (int(m[1]) * 3600 + int(m[2]) * 60) * S + _fraction(m[3])


def _date(text: str, form: str) -> int:
    m = (_YEAR if form == 'year_first' else _DAY).fullmatch(text.strip())
    if not m:
        raise ValueError('not a date and time')
    month, day = (m['m'], m['d']) if form == 'year_first' else (m['b'], m['a'])
    if form == 'month_first':
        month, day = day, month
    moment = datetime(int(m['y']), int(month), int(day), int(m['H']), int(m['M']), tzinfo=UTC)
    zone = m['z'] or 'Z'
    ahead = timedelta()
    if zone != 'Z':
        ahead = timedelta(hours=int(zone[1:3]), minutes=int(zone[-2:])) * (
            -1 if zone[0] == '-' else 1
        )
    whole = (moment - ahead - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
    return whole * S + (_fraction(m['S']) if m['S'] else 0)


def reader(form: str) -> Callable[[str], int]:
    """Text -> ns (since 1970, since the start, or since the hour or day); it raises ValueError with the reason."""
    if form in NUMBERS:
        return lambda text: _number(text, NUMBERS[form])
    if form == 'minute_second':
        return _minute_second
    if form == 'clock':
        return _clock
    return lambda text: _date(text, form)


def date_ns(text: str) -> int:
    """The start of a mapping, '2026-01-02T10:00:00Z' or a date alone, in ns; ValueError when it is none."""
    text = str(text).strip()
    return _date(text if ':' in text else f'{text} 00:00', 'year_first')


def words(ns: int) -> str:
    """A date as `date_ns` reads it."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=ns // S)
    return moment.strftime('%Y-%m-%dT%H:%M:%SZ')


def guess(texts: list[str], name: str) -> tuple[str, str] | None:
    """Format of most of these texts and what in it is guessed ('' = nothing); None when none fits. name: of the
    column, its unit included."""
    for form in ('minute_second', 'clock', 'year_first'):
        if _share(texts, form) > MIN_SHARE_OF_FORMAT:
            return form, ''
    day, month = (_share(texts, form) for form in ('day_first', 'month_first'))
    if max(day, month) > MIN_SHARE_OF_FORMAT:
        why = 'day before month: both fit' if day == month else ''
        return ('day_first' if day >= month else 'month_first'), why
    return _unit_of(texts, name) if _share(texts, 's') > MIN_SHARE_OF_FORMAT else None


def _share(texts: list[str], form: str) -> float:
    """Of the texts that have this format; all units of numbers are one."""
    read: Callable[[str], object] = _any_number if form in NUMBERS else reader(form)
    good = 0
    for text in texts:
        try:
            read(text)
            good += 1
        except (ValueError, OverflowError):
            pass
    return good / max(len(texts), 1)


def _any_number(text: str) -> Decimal:
    try:
        value = Decimal(text.strip().replace(',', '.'))
    except InvalidOperation:
        raise ValueError('not a number') from None
    if '_' in text or not value.is_finite() or value.adjusted() > 40:
        raise ValueError('not a number')
    return value


def _unit_of(texts: list[str], name: str) -> tuple[str, str]:
    lower = name.lower()
    values = []
    for text in texts:
        try:
            values.append(_any_number(text))
        except ValueError:
            continue
    top = max(abs(v) for v in values)
    for unit, digits in (('ns', 17), ('us', 14), ('ms', 11)):
        if top >= Decimal(10) ** digits:
            return (
                unit,
                '' if 10**17 <= top < 3 * 10**18 else f'{unit} from the size of the numbers',
            )
    named = re.search(r'[\[(_ ](ns|us|ms|s|sec|seconds?)[\])]?$', lower)
    if named:
        unit = named[1] if named[1] in NUMBERS else 's'
        return unit, ''
    if lower == 'secs' or 'rosbag' in lower:
        return 's', ''
    return 's', 'seconds: the name has no unit'


def unwrapped(stamps: list[int], period: int) -> list[int]:
    """Clock times (ns) without the jumps at the full hour or day."""
    out, turns = [], 0
    for k, ns in enumerate(stamps):
        if k and ns < stamps[k - 1] - period // 2:
            turns += 1
        out.append(ns + turns * period)
    return out


def spread(stamps: list[int]) -> tuple[list[int], int]:
    """Truncated stamps: of rows with the same one, the later ones go evenly up to the next. Also how many moved."""
    out, moved, k = list(stamps), 0, 0
    gaps = [b - a for a, b in zip(stamps, stamps[1:], strict=False) if b > a]
    usual = min(gaps, default=0)
    while k < len(stamps):
        end = k
        while end < len(stamps) and stamps[end] == stamps[k]:
            end += 1
        step = min(stamps[end] - stamps[k], usual) if end < len(stamps) else usual
        for i in range(k + 1, end):
            out[i] = stamps[k] + max(step, 0) * (i - k) // (end - k)
            moved += 1
        k = end
    return out, moved
