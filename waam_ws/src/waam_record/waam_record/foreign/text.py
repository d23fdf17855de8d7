"""Any text with columns as a table: encodings, line ends, separators and decimal commas are found, not assumed."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass

from ..bag_writer import BagError

DELIMITERS = {'tab': '\t', ';': ';', ',': ',', 'blank': ' '}  # as a mapping names them
SAMPLE = 400  # lines that the form of a file is found from
SHARE = 0.6  # of these lines must have the same number of cells
MAX_CELLS = 4096  # columns of a table
POINT = re.compile(r'[-+]?\d+\.\d*(e[-+]?\d+)?', re.IGNORECASE | re.ASCII)
COMMA = re.compile(r'[-+]?\d+,\d+(e[-+]?\d+)?', re.IGNORECASE | re.ASCII)
MISSING = ('', 'nan', 'none', 'null', 'n/a', '-')


@dataclass(frozen=True)
class Form:
    """How a file is written. delimiter: a key of DELIMITERS; decimal: '.' or ','; header_line: 0 = none."""

    delimiter: str
    decimal: str
    header_line: int


@dataclass(frozen=True)
class Table:
    """head: names of the columns, each once. rows: line number and cells, as many as names. skipped: lines that are no
    row, with the reason."""

    form: Form
    head: list[str]
    rows: list[tuple[int, list[str]]]
    skipped: list[tuple[int, str]]


def decoded(data: bytes, name: str) -> str:
    """Text of UTF-8, UTF-16 (with its mark) or Latin-1. BagError when it is no text."""
    if data[:2] in (b'\xff\xfe', b'\xfe\xff'):
        try:
            return data.decode('utf-16')
        except UnicodeDecodeError as e:
            raise BagError(f'{name}: begins like UTF-16 and is none: {e}') from None
    if b'\0' in data:
        line = data[: data.index(b'\0')].count(b'\n') + 1
        raise BagError(f'{name}, line {line}: holds zero bytes, so it is not text')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('latin-1')


def lines_of(text: str) -> list[str]:
    """Lines of any ends: CR LF, LF, and a bare CR."""
    return re.split(r'\r\n|\r|\n', text)


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line, quotes taken off; csv.Error when it cannot be told where they end."""
    if delimiter == 'blank':
        return line.split()
    sign = DELIMITERS[delimiter]
    if '"' not in line:
        return [c.strip() for c in line.split(sign)]
    cells = next(csv.reader([line], delimiter=sign, skipinitialspace=True), [])
    return [c.strip() for c in cells]


def number(text: str, decimal: str) -> float:
    """NaN for what is not one finite number with this decimal sign; 1_000 and 1.234,5 are none."""
    text = text.strip()
    if decimal == ',':
        if '.' in text:
            return math.nan
        text = text.replace(',', '.')
    if '_' in text or not text.isascii():
        return math.nan
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def missing(text: str) -> bool:
    """Whether a cell says that there is no value."""
    return text.strip().lower() in MISSING


def find_form(lines: list[str], name: str) -> Form:
    """From the lines themselves. BagError when no separator gives most lines the same number of cells."""
    full = [(n, line) for n, line in enumerate(lines, 1) if line.strip()]
    if len(full) < 2:
        raise BagError(f'{name}: {len(full)} lines with text; a header and one row are needed')
    tail = full[-SAMPLE:] if len(full) < 2 * SAMPLE else full[SAMPLE // 2 :][:SAMPLE]
    if not any(_usual(tail, d) > 1 for d in ('tab', ';')) and _spaced_commas(
        [line for _, line in tail]
    ):
        delimiter = 'blank'
    else:
        delimiter = next((d for d in DELIMITERS if _usual(tail, d) > 1), '')
    if not delimiter:
        raise BagError(f'{name}: no table; neither tab, ; , nor blanks give its lines equal cells')
    decimal = _decimal(tail, delimiter)
    return Form(delimiter, decimal, _header(full, delimiter, decimal))


def _spaced_commas(lines: list[str]) -> bool:
    """Columns between blanks with decimal commas, which look like columns between commas."""
    lines = [line for line in lines if any(c.isdigit() for c in line)]
    cells = [c for line in lines for c in line.split()]
    pairs = sum(bool(COMMA.fullmatch(c)) for c in cells)
    return len(cells) >= 2 * len(lines) and pairs > 0.8 * len(cells)


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return split(line, delimiter)
    except csv.Error:
        return []


def _usual(full: list[tuple[int, str]], delimiter: str) -> int:
    """Number of cells that most lines have; 0 when they do not agree."""
    counts = [len(_cells(line, delimiter)) for _, line in full]
    usual = max(set(counts), key=counts.count)
    return usual if counts.count(usual) >= SHARE * len(counts) and usual <= MAX_CELLS else 0


def _decimal(full: list[tuple[int, str]], delimiter: str) -> str:
    if delimiter == ',':
        return '.'
    cells = [c for _, line in full for part in _cells(line, delimiter) for c in part.split()]
    commas = sum(bool(COMMA.fullmatch(c)) for c in cells)
    return ',' if commas > sum(bool(POINT.fullmatch(c)) for c in cells) else '.'


def _header(full: list[tuple[int, str]], delimiter: str, decimal: str) -> int:
    """Line of the names: the one before the first row with a number; 0 when the first line is such a row."""
    usual = _usual(full[-SAMPLE:], delimiter) or _usual(full, delimiter)
    before = 0
    for n, line in full:
        cells = _cells(line, delimiter)
        numbers = any(
            not math.isnan(number(c, decimal)) for cell in cells for c in cell.split()[:3]
        )
        if numbers and abs(len(cells) - usual) <= 1:
            return before
        before = n if len(cells) > 1 else 0
    return full[0][0]


def read_table(data: bytes, name: str, form: Form | None = None) -> Table:
    """The table of a file; form: None = found. BagError names file and line of what makes it none."""
    lines = lines_of(decoded(data, name))
    form = form or find_form(lines, name)
    if form.header_line > len(lines):
        raise BagError(f'{name}: has {len(lines)} lines, header_line is {form.header_line}')
    try:
        head = split(lines[form.header_line - 1], form.delimiter) if form.header_line else []
    except csv.Error as e:
        raise BagError(f'{name}, line {form.header_line}: {e}') from None
    rows: list[tuple[int, list[str]]] = []
    skipped: list[tuple[int, str]] = []
    for n, line in enumerate(lines[form.header_line :], form.header_line + 1):
        if not line.strip():
            continue
        try:
            cells = split(line, form.delimiter)
        except csv.Error as e:
            skipped.append((n, str(e)))
            continue
        if not head:
            head = [f'column_{k + 1}' for k in range(len(cells))]
        if len(cells) == len(head) + 1 and not cells[-1]:
            cells.pop()
        if len(cells) == len(head):
            rows.append((n, cells))
        else:
            skipped.append((n, f'{len(cells)} cells, the header has {len(head)}'))
    _check(name, form, head, rows, skipped)
    return Table(form, _unique(head), rows, skipped)


def _check(name: str, form: Form, head: list[str], rows: list, skipped: list) -> None:
    if len(head) > MAX_CELLS:
        raise BagError(f'{name}: {len(head)} columns, at most {MAX_CELLS} are read')
    if rows:
        return
    if not skipped:
        raise BagError(f'{name}: a header and at least one row are needed')
    n, why = skipped[0]
    hint = ' (decimal commas between commas?)' if form.delimiter == ',' else ''
    raise BagError(f'{name}, line {n}: {why}{hint}; no other line is a row either')


def _unique(head: list[str]) -> list[str]:
    """Names, each once: a second `x` becomes `x (2)`, a column without name `column_7`."""
    found: list[str] = []
    for k, name in enumerate(head):
        name = ' '.join(name.split()) or f'column_{k + 1}'
        again, number = name, 1
        while again in found:
            number += 1
            again = f'{name} ({number})'
        found.append(again)
    return found
