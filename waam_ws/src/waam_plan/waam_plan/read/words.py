"""Lines of G-code as words: comments, line numbers, block delete, `%` and check sums are dealt with here."""

from __future__ import annotations

import binascii
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

LARGEST = 1e7  # of a value in its own unit; more is damage
LONGEST = 1000  # characters of a line
SHOWN = 24  # characters of a word in a message

_NUMBER = r'[-+]?(?:\d+\.?\d*|\.\d+)'
_WORD = re.compile(rf'\s*([A-Za-z])\s*({_NUMBER})', re.ASCII)
# X1e-05: an exponent to people, X1 E-05 to a printer
_EXPONENT = re.compile(r'e\s*[-+]?\.?\d', re.ASCII)
_TEXT_CODE = re.compile(r'\s*(?:N\s*\d+\s*)?M11[78](?!\d)', re.ASCII | re.IGNORECASE)
_CHECK = re.compile(r'\*\s*(\d+)\s*$', re.ASCII)


class ProgramError(ValueError):
    """A program that cannot be used; the text names line and word."""


def refuse(line: int, word: str, why: str) -> ProgramError:
    """The error of one word: 'line 7: G5: why'."""
    return ProgramError(f'line {line}: {shown(word)}: {why}')


def shown(text: str) -> str:
    """A piece of the program, short and printable."""
    plain = text.strip().encode('ascii', 'replace').decode()
    plain = ''.join(c if c.isprintable() else '?' for c in plain)
    return plain if len(plain) <= SHOWN else f'{plain[:SHOWN]}...'


@dataclass(frozen=True)
class Word:
    """letter: a capital. text: as written."""

    letter: str
    value: float
    text: str

    @property
    def code(self) -> str:
        """'G1', 'G90.1', 'M3': the word as a code, whatever zeros it is written with."""
        return f'{self.letter}{self.value:g}'


@dataclass(frozen=True)
class Line:
    """number: from 1. words: without line number and check sum. comments: those of the line, in order."""

    number: int
    words: tuple[Word, ...]
    comments: tuple[str, ...] = ()


def read_lines(
    text: str, delete: bool = False, macros: frozenset[str] = frozenset()
) -> Iterator[Line]:
    """Every line of a program. delete: lines that begin with '/' are left out (the switch of block delete is on).
    macros: lines that begin with such a name, in capitals, are passed over.

    '%' alone on a line is passed over. Raises ProgramError.
    """
    for number, raw in enumerate(text.splitlines(), 1):
        if macros and raw.partition(';')[0].partition(' ')[0].strip() in macros:
            continue
        line = _line(number, raw, delete)
        if line.words or line.comments:
            yield line


def _line(number: int, raw: str, delete: bool) -> Line:
    body, comments = _uncommented(number, raw)
    if len(body) > LONGEST:
        raise refuse(number, body, f'the line has {len(body)} characters, at most {LONGEST}')
    body = _checked(number, body)
    if body.strip() == '%':
        body = ''
    if body.lstrip().startswith('/'):
        body = '' if delete else body.replace('/', ' ', 1)
    return Line(number, tuple(_words(number, body)), comments)


def _uncommented(number: int, raw: str) -> tuple[str, tuple[str, ...]]:
    """The line without its comments, which are '(...)' and all after ';'."""
    comments: list[str] = []
    body, rest = '', raw
    while found := re.search(r'[(;]', rest):
        body += rest[: found.start()] + ' '
        if found[0] == ';':
            return body, (*comments, rest[found.end() :].strip())
        inside, closed, rest = rest[found.end() :].partition(')')
        if not closed:
            raise refuse(number, f'({inside}', 'the comment is not closed')
        comments.append(inside.strip())
    return body + rest, tuple(comments)


def _checked(number: int, body: str) -> str:
    """Without the check sum: '*' and 1 to 3 digits are the XOR of the bytes before it, 5 digits their CRC-16."""
    found = _CHECK.search(body)
    if not found:
        return body
    before, told = body[: found.start()], int(found[1])
    data = before.encode('utf-8', 'replace')
    exact = binascii.crc_hqx(data, 0xFFFF) if len(found[1]) == 5 else reduce(_xor, data, 0)
    if told != exact:
        raise refuse(number, found[0], f'the check sum of this line is {exact}')
    return before


def _xor(a: int, b: int) -> int:
    return a ^ b


def _words(number: int, body: str) -> Iterator[Word]:
    if text := _TEXT_CODE.match(body):  # a message to the operator follows
        body = text[0]
    at, first = 0, True
    while body[at:].strip():
        found = _WORD.match(body, at)
        if not found:
            raise refuse(number, body[at:], 'cannot be read')
        word = _word(number, found[1], found[2])
        at = found.end()
        if word.letter != 'E' and found[1].isupper() and _EXPONENT.match(body, at):
            raise refuse(number, body[found.start() :], 'an exponent is not read, write it out')
        if not (first and word.letter == 'N'):
            yield word
        first = False


def _word(number: int, letter: str, digits: str) -> Word:
    value = float(digits)
    if not (math.isfinite(value) and abs(value) <= LARGEST):
        raise refuse(number, letter + digits, f'beyond {LARGEST:g}')
    return Word(letter.upper(), value, letter + digits)
