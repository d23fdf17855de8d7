"""Lines of G-code as words: comments, line numbers, block delete, `%` and check sums are dealt with here."""

from __future__ import annotations

import binascii
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

from waam_plan.texts import decimal_comma, numbered_lines, shown

MAX_VALUE = 1e7  # of a value in its own unit; more is damage
MAX_LINE_LENGTH = 1000  # characters of a line

_NUMBER = r'[-+]?(?:\d+\.?\d*|\.\d+)'
_WORD = re.compile(rf'\s*([A-Za-z])\s*({_NUMBER})', re.ASCII)
# X1e-05: an exponent to people, X1 E-05 to a printer
_EXPONENT = re.compile(r'e\s*[-+]?\.?\d', re.ASCII)
_TEXT_CODE = re.compile(r'\s*(?:N\s*\d+\s*)?M11[78](?!\d)', re.ASCII | re.IGNORECASE)
_FLAG = re.compile(r'\s*([A-Za-z])(?=\s|$)', re.ASCII)
_FIRST = re.compile(r'\s*(?:N\s*\d+\s*)?([GMT])\s*(\d+\.?\d*)', re.ASCII | re.IGNORECASE)
_MOVE = re.compile(r'(?<![A-Za-z])G0*[0-3](?![\d.])', re.ASCII | re.IGNORECASE)
_CHECK = re.compile(r'\*\s*(\d+)\s*$', re.ASCII)


class ProgramError(ValueError):
    """A program that cannot be used; the text names line and word."""


def refuse(line: int, word: str, why: str) -> ProgramError:
    """The error of one word: 'line 7: G5: why'."""
    return ProgramError(f'line {line}: {shown(word)}: {why}')


@dataclass(frozen=True)
class Word:
    """letter: a capital. value: NaN where a letter stands alone. text: as written."""

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


@dataclass(frozen=True)
class Passing:
    """What of a line is not looked at. delete: lines that begin with '/' (the switch of block delete is on). macros:
    lines that begin with such a name, in capitals. skip: what follows such a code. flags: codes after which letters
    may stand without a number."""

    delete: bool = False
    macros: frozenset[str] = frozenset()
    skip: frozenset[str] = frozenset()
    flags: frozenset[str] = frozenset()


def read_lines(text: str, passing: Passing | None = None) -> Iterator[Line]:
    """Every line of a program. '%' alone on a line is passed over. Raises ProgramError."""
    passing = passing or Passing()
    for number, raw in numbered_lines(_one_end(text)):
        if passing.macros and raw.partition(';')[0].partition(' ')[0].strip() in passing.macros:
            continue
        line = _line(number, raw, passing)
        if line.words or line.comments:
            yield line


def _one_end(text: str) -> str:
    return text.removeprefix('\ufeff').replace('\r\n', '\n').replace('\r', '\n')


def _line(number: int, raw: str, passing: Passing) -> Line:
    body, comments = _uncommented(number, raw)
    if len(body) > MAX_LINE_LENGTH:
        raise refuse(
            number, body, f'the line has {len(body)} characters, at most {MAX_LINE_LENGTH}'
        )
    body = _checked(number, body)
    if body.strip() == '%':
        body = ''
    if body.lstrip().startswith('/'):
        body = '' if passing.delete else body.replace('/', ' ', 1)
    first = _FIRST.match(body)
    code = f'{first[1].upper()}{float(first[2]):g}' if first and len(first[2]) < 9 else ''
    if first and code in passing.skip:
        rest = re.sub(r'"[^"]*"', '', body[first.end() :])
        if not _TEXT_CODE.match(body) and (move := _MOVE.search(rest)):
            raise refuse(number, move[0], f'stands in a line that is passed over for its {code}')
        body = first[0] + (' L' + found[1] if (found := re.search(r'L\s*(\d+)', rest)) else '')
    return Line(number, tuple(_words(number, body, code in passing.flags)), comments)


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


def _words(number: int, body: str, flags: bool) -> Iterator[Word]:
    if text := _TEXT_CODE.match(body):  # a message to the operator follows
        body = text[0]
    at, first = 0, True
    while body[at:].strip():
        found = _WORD.match(body, at)
        if not found and flags and (alone := _FLAG.match(body, at)):
            yield Word(alone[1].upper(), math.nan, alone[1])
            at = alone.end()
            continue
        if not found:
            raise refuse(number, body[at:], _why(body, at))
        word = _word(number, found[1], found[2])
        at = found.end()
        if word.letter != 'E' and found[1].isupper() and _EXPONENT.match(body, at):
            raise refuse(number, body[found.start() :], 'an exponent is not read, write it out')
        if not (first and word.letter == 'N'):
            yield word
        first = False


def _word(number: int, letter: str, digits: str) -> Word:
    value = float(digits)
    if not (math.isfinite(value) and abs(value) <= MAX_VALUE):
        raise refuse(number, letter + digits, f'beyond {MAX_VALUE:g}')
    return Word(letter.upper(), value, letter + digits)


def _why(body: str, at: int) -> str:
    """Why the line cannot be read from here on."""
    start = len(body[:at].rstrip('0123456789')) if body[at] == ',' else at
    word = re.match(r'[-+]?\d*,\d*', body[start:], re.ASCII)
    if word and decimal_comma(word[0]):
        return f"cannot be read: '{word[0]}' has a decimal comma; write decimal points"
    return 'cannot be read'
