"""Numbers as people type them, read wholly or refused: 0.2, 0,2 and 0,2 mm are the same. `static/numbers.js` has the
same rules. No ROS.

A mark stands before the decimals. With exactly three digits behind it (1,250) it may be meant for thousands: that is
refused where 1250 lies within the limits of the field, too.
"""

from __future__ import annotations

import math
import re
from typing import Any

BLANKS = ' \t\u00a0\u202f'
MAX_NUMBER_LENGTH = 40
_NUMBER = re.compile(r'([+\-\u2212]?)([0-9]*)(?:([.,])([0-9]+))?')
_THOUSANDS = re.compile(r'[+\-\u2212]?[1-9][0-9]{0,2}[.,][0-9]{3}')
_UNIT = re.compile(r'[^0-9.,+\-\u2212 \t\u00a0\u202f][^0-9]*$')


class NumberRefused(ValueError):
    """Not one number, or out of its limits; the text says what was understood, without the name of the field."""


def read(text: str, low: float, high: float, unit: str = '', whole: bool = False) -> float:
    """The number in `text`, within low ... high; `unit` may follow it. Raises NumberRefused."""
    value = _within(_plain(text, unit), low, high, unit)
    if whole and value != int(value):
        raise NumberRefused(f'{value:g} is not a whole number')
    return value


def _plain(text: str, unit: str) -> tuple[float, float | None]:
    """The number, and the one that it would be with its mark standing for thousands."""
    said, inner = shown(text), text.strip(BLANKS)
    if not inner:
        raise NumberRefused('empty: a number is wanted')
    if len(inner) > MAX_NUMBER_LENGTH:
        raise NumberRefused(f'{said} is too long for a number')
    if found := _UNIT.search(inner):
        if not unit or found[0] != unit:
            wanted = f'a number in {unit}' if unit else 'a plain number'
            raise NumberRefused(f'{said} is not understood: {wanted} is wanted')
        inner = inner[: found.start()].rstrip(BLANKS)
    if any(b in inner for b in BLANKS):
        raise NumberRefused(f'{said} has a gap: write the digits of one number without blanks')
    if '.' in inner and ',' in inner or max(inner.count('.'), inner.count(',')) > 1:
        raise NumberRefused(f'{said} has several marks: write one, before the decimals')
    found = _NUMBER.fullmatch(inner)
    if not found or not (found[2] or found[4]):
        raise NumberRefused(f'{said} is not understood: digits with one point or comma are wanted')
    sign = -1.0 if found[1] in ('-', '\u2212') else 1.0
    value = sign * float(f'{found[2] or 0}.{found[4] or 0}')
    grouped = sign * float(found[2] + found[4]) if _THOUSANDS.fullmatch(inner) else None
    return value, grouped


def _within(read_as: tuple[float, float | None], low: float, high: float, unit: str) -> float:
    value, grouped = read_as
    if grouped is not None and low <= grouped <= high:
        said = f'can be read as {value:g} or as {grouped:g}'
        raise NumberRefused(f'{said}: write {value:g} or {grouped:g}')
    if not low <= value <= high:
        raise NumberRefused(f'{value:g}, must be {limits(low, high, unit)}')
    return value


def limits(low: float, high: float, unit: str = '') -> str:
    """In words."""
    return f'{low:g} to {high:g} {unit}'.rstrip()


def of(value: Any, low: float, high: float, unit: str = '', whole: bool = False) -> float:
    """A number of a request: one of JSON, or text as `read` takes it. Raises NumberRefused."""
    if isinstance(value, str):
        return read(value, low, high, unit, whole)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise NumberRefused(f'{shown(value)} is not a number')
    if isinstance(value, float) and not math.isfinite(value):
        raise NumberRefused(f'{value!r} is not a number')
    if not low <= value <= high:
        raise NumberRefused(f'{shown(value)}, must be {limits(low, high, unit)}')
    if whole and value != int(value):
        raise NumberRefused(f'{value:g} is not a whole number')
    return float(value)


def shown(value: Any) -> str:
    """What was given, for a message: at most some characters of it."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**15:
        return 'a number of more than 15 digits'
    text = repr(value)
    return text if len(text) <= MAX_NUMBER_LENGTH else f'{text[:MAX_NUMBER_LENGTH]} ...'
