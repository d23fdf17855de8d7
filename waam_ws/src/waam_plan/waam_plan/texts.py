"""Text of files of others: encodings, line ends, and the cause in words where a number cannot be read."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence

import numpy as np

_BOMS = (
    (codecs.BOM_UTF8, 'utf-8'),
    (codecs.BOM_UTF32_LE, 'utf-32-le'),
    (codecs.BOM_UTF32_BE, 'utf-32-be'),
    (codecs.BOM_UTF16_LE, 'utf-16-le'),
    (codecs.BOM_UTF16_BE, 'utf-16-be'),
)
_COMMA = re.compile(r'[-+]?\d+,\d+(?:[eE][-+]?\d+)?', re.ASCII)
SHOWN = 24  # characters of a word in a message


def text_of(data: bytes) -> str:
    """UTF-8, UTF-16 or UTF-32 by their mark, UTF-16 without one by its zeros; every line ends with one line feed.

    What is no UTF-8 becomes U+FFFD, which only comments and names may hold.
    """
    for mark, name in _BOMS:
        if data.startswith(mark):
            return _lines(data[len(mark) :].decode(name, 'replace'))
    return _lines(data.decode(_without_mark(data[:64]), 'replace'))


def _without_mark(head: bytes) -> str:
    even, odd = head[0::2], head[1::2]
    if len(head) >= 4 and not any(odd) and all(even[: len(odd)]):
        return 'utf-16-le'
    if len(head) >= 4 and not any(even) and all(odd):
        return 'utf-16-be'
    return 'utf-8'


def _lines(text: str) -> str:
    if '\r' not in text:
        return text
    return text.replace('\r\n', '\n').replace('\r', '\n')


def numbered_lines(text: str) -> Iterator[tuple[int, str]]:
    """(number from 1, line without its end), one after the other, for texts of hundreds of megabytes."""
    at, number = 0, 1
    while at <= len(text):
        end = text.find('\n', at)
        end = len(text) if end < 0 else end
        yield number, text[at:end]
        at, number = end + 1, number + 1


def decimal_comma(word: str) -> bool:
    """Whether a word is a number with a decimal comma, '12,5'."""
    return bool(_COMMA.fullmatch(word.strip()))


def shown(text: str) -> str:
    """A piece of a file, short and printable."""
    plain = text.strip()[: SHOWN + 1].encode('ascii', 'replace').decode()
    plain = ''.join(c if c.isprintable() else '?' for c in plain)
    return plain if len(plain) <= SHOWN else f'{plain[:SHOWN]}...'


def why_no_number(word: str) -> str:
    """The cause for a person: "'12,5' is no number: a decimal comma; export with decimal points"."""
    text = f"'{shown(word)}' is no number"
    if decimal_comma(word):
        return f'{text}: it has a decimal comma; export with decimal points'
    return text


def rows_of_numbers(lines: Sequence[str], delimiter: str | None = None) -> np.ndarray:
    """(rows, columns) of lines of equal length; delimiter: None = blanks. ValueError names the cause."""
    try:
        return np.loadtxt(lines, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError as error:
        words = (w for line in lines[:100] for w in line.split())
        word = next((w for w in words if decimal_comma(w)), None)
        raise ValueError(why_no_number(word) if word else str(error)) from None
