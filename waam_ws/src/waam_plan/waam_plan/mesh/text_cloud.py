"""Points in text: columns by the names of the header, separators and decimal commas where they are clear.

A file that can be read in two ways is refused, with what makes it clear.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from waam_plan.mesh.units import UNITS
from waam_plan.texts import numbered_lines, rows_of_numbers, shown

COMMENTS = ('#', '//', '%', '!')
BLOCK = 50_000  # lines that are read together
MAX_PASSED = 1_000_000  # empty lines and comments
MAX_LINE_LENGTH = 20_000  # characters of a line
LOOKED_AT = 1000  # lines by which separator and decimal sign are known
NO_VALUE = {
    '',
    'nan',
    '-nan',
    '+nan',
    'na',
    'n/a',
    'null',
    'none',
    '-',
    '--',
    'inf',
    '+inf',
    '-inf',
}
NO_VALUE |= {
    'infinity',
    '-infinity',
    '1.#qnan',
    '-1.#qnan',
    '1.#ind',
    '-1.#ind',
    '1.#inf',
    '-1.#inf',
}
INTENSITIES = ('intensity', 'amplitude', 'reflectance', 'reflectivity')
_NUMBER = re.compile(r'[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?', re.ASCII)
_GROUPED = re.compile(r"[-+]?\d{1,3}(?:([.,' \u00a0\u202f])\d{3})+(?:[.,]\d+)?", re.ASCII)
_CLEAR = re.compile(r'[-+]?(?:0?,\d+|\d+,(?:\d{1,2}|\d{4,})|\d{4,},\d+)(?:[eE].*)?', re.ASCII)
_UNIT = re.compile(r'\s*[\[(]\s*([^\])]*?)\s*[\])]')
_AXIS = re.compile(
    r'(?:(?:pos|position|coord|coordinate|point)s?[_ .:]*)?([xyz])'
    r'(?:[_ .:]*(?:pos|position|coord|coordinate)s?)?(?:[_ /](mm|cm|m|um|in|inch))?'
)
_SPELT = {'in': 'inch', 'inches': 'inch', '"': 'inch', 'µm': 'um', 'μm': 'um', 'micron': 'um'}
_SPELT |= {'metre': 'm', 'meter': 'm', 'millimeter': 'mm', 'millimetre': 'mm'}


@dataclass(frozen=True)
class Table:
    """points: (n, 3), in units of the file, NaN = no value. intensity: (n,) or None. unit: that the header says."""

    points: np.ndarray
    intensity: np.ndarray | None = None
    unit: str = ''
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Form:
    """delimiter: '' = blanks. comma: the decimal sign is a comma."""

    delimiter: str
    comma: bool

    def split(self, line: str) -> list[str]:
        """The fields of a line."""
        if '"' in line:
            line = '\t'.join(next(csv.reader([line], delimiter=self.delimiter or ' ')))
            return [f.strip() for f in line.split('\t')]
        if not self.delimiter:
            return line.split()
        return [f.strip() for f in line.split(self.delimiter)]


def read_table(text: str) -> Table:
    """ValueError names line and cause."""
    if '\0' in text[:4096]:
        raise ValueError('it is no text: binary data')
    rows = _Rows(text)
    names, form, columns, unit = rows.names, rows.form, [0, 1, 2], ''
    notes: list[str] = []
    intensity = None
    if names:
        columns, unit = axes_of(names, rows.header_line)
        lower = [n.lower() for n in names]
        intensity = next((lower.index(n) for n in INTENSITIES if n in lower), None)
    elif rows.width > 3:
        notes.append(f'no header: the first 3 of {rows.width} columns are taken as x y z')
    if form.comma:
        notes.append('decimal commas were read')
    wanted = columns if intensity is None else [*columns, intensity]
    blocks = list(rows.blocks(wanted))
    values = np.concatenate(blocks) if blocks else np.zeros((0, len(wanted)))
    rows.check_count(len(values))
    return Table(values[:, :3], values[:, 3] if intensity is not None else None, unit, notes)


def axes_of(names: list[str], line: int) -> tuple[list[int], str]:
    """Which columns are x, y and z, and in which unit ('' = not said). ValueError names what is missing."""
    found: dict[str, int] = {}
    units: set[str] = set()
    for i, name in enumerate(names):
        unit = _UNIT.search(name)
        plain = _UNIT.sub('', name).strip().lower()
        axis = _AXIS.fullmatch(plain)
        if not axis:
            continue
        if axis[1] in found:
            raise ValueError(f'line {line}: the header names {axis[1]} twice')
        found[axis[1]] = i
        said = (unit[1] if unit else axis[2] or '').lower()
        units.add(_SPELT.get(said, said))
    if set(found) != set('xyz'):
        said = ', '.join(shown(n) for n in names[:8])
        raise ValueError(
            f'line {line}: the header ({said}) does not name x, y and z; name these columns so'
        )
    if len(units) > 1 or units - {'', *UNITS}:
        said = ', '.join(sorted(units))
        raise ValueError(f'line {line}: units of x, y and z ({said}) are not one that is known')
    return [found[a] for a in 'xyz'], units.pop()


class _Rows:
    """Lines of numbers. The first ones tell header, separator, decimal sign and number of columns."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.names: list[str] = []
        self.header_line = self.announced = self.announced_line = 0
        head = list(islice(self._data(), LOOKED_AT))
        if not head:
            raise ValueError('there is no line with numbers')
        number, first = head[0]
        header = None if _numeric(first) else (number, first)
        body = head[1:] if header else head
        if len(body) > 1 and re.fullmatch(
            r'\d+', body[0][1]
        ):  # number of points, as some programs write it
            self.announced_line, self.announced = body[0][0], int(body[0][1])
            body = body[1:]
        if not body:
            raise ValueError(f'line {number}: a header, but no line with numbers')
        names = _header_words(header[1]) if header else self._commented(body[0][0])
        self.form = self._form_of([line for _, line in body], len(names), body[0][0])
        first_fields = self.form.split(body[0][1])
        self.trailing = len(first_fields) > 1 and not first_fields[-1]
        self.width = len(first_fields) - self.trailing
        self.first = body[0][0]
        if names and header is None and len(names) != self.width:
            names = []  # a comment that is no header
        if header:
            self.header_line = header[0]
            if len(names) != self.width:
                names = [w for w in self.form.split(header[1]) if w]
            if len(names) != self.width:
                raise ValueError(
                    f'line {self.first}: {self.width} columns, the header of line {header[0]} names {len(names)}'
                )
        self.names = names
        if self.width < 3:
            raise ValueError(f'line {self.first}: {self.width} columns, x y z are needed')

    def _data(self) -> Iterator[tuple[int, str]]:
        passed = 0
        for number, line in numbered_lines(self.text):
            line = line.strip(' \n\v\f')
            if len(line) > MAX_LINE_LENGTH:
                raise ValueError(f'line {number}: {len(line)} characters are no row of points')
            if line.strip() and not line.lstrip().startswith(COMMENTS):
                yield number, line
            else:
                passed += 1
                if passed > MAX_PASSED:
                    raise ValueError(
                        f'line {number}: more than {MAX_PASSED} empty lines and comments'
                    )

    def _commented(self, before: int) -> list[str]:
        """Names of a header that is written as a comment above the first row."""
        for number, line in numbered_lines(self.text):
            if number >= before:
                break
            words = _header_words(line.strip().lstrip('#/%!').strip())
            axes = {m[1] for w in words if (m := _AXIS.fullmatch(_UNIT.sub('', w).strip().lower()))}
            if axes == set('xyz'):
                self.header_line = number
                return words
        return []

    def _form_of(self, lines: list[str], names: int, first: int) -> _Form:
        """Separator and decimal sign. ValueError where two readings are possible."""
        sample = '\n'.join(lines)
        for delimiter in (';', '\t'):
            if delimiter in lines[0]:
                return _Form(delimiter, self._comma(_Form(delimiter, False), lines, first))
        if '"' in lines[0]:
            form = _Form(',' if '",' in lines[0] else '', False)
            return _Form(form.delimiter, self._comma(form, lines, first))
        if ',' not in sample:
            return _Form('', False)
        words = lines[0].split()
        if len(words) >= 3 and ',' not in ''.join(w[-1] for w in words):
            return _Form('', self._comma(_Form('', False), lines, first))
        fields = [f.strip() for f in lines[0].split(',')]
        width = len(fields)
        whole = all(re.fullmatch(r'[-+]?\d+', f) for f in fields)
        if whole and width >= 6 and width % 2 == 0 and names != width and not self._any_point():
            raise ValueError(
                f"line {first}: '{shown(lines[0])}' has decimal commas or columns of whole numbers, which cannot be "
                'told apart; export with decimal points, or with semicolons between the columns'
            )
        return _Form(',', False)

    def _any_point(self) -> bool:
        return any(re.search(r'\d\.|\.\d', line) for _, line in islice(self._data(), 1, None))

    def _comma(self, form: _Form, lines: list[str], first: int) -> bool:
        """Whether commas are decimal signs. ValueError where they may group thousands."""
        words = [w for line in lines for w in form.split(line) if ',' in w]
        if not words:
            return False
        if any(_CLEAR.fullmatch(w) for w in words):
            return True
        raise ValueError(
            f"line {first}: '{shown(words[0])}': a decimal comma or a separator of thousands; export with decimal "
            'points and without separators of thousands'
        )

    def blocks(self, wanted: list[int]) -> Iterator[np.ndarray]:
        """(k, len(wanted)) values."""
        data = (pair for pair in self._data() if pair[0] >= self.first)
        while block := list(islice(data, BLOCK)):
            yield self._block(block, wanted)

    def _block(self, block: list[tuple[int, str]], wanted: list[int]) -> np.ndarray:
        lines = [line for _, line in block]
        comma = self.form.comma
        if not (comma and any('.' in line for line in lines)):
            if comma:
                lines = [line.replace(',', '.') for line in lines]
            try:
                values = rows_of_numbers(lines, self.form.delimiter or None)
                if values.shape[1] == self.width:
                    return values[:, wanted]
            except ValueError:
                pass
        return np.array([self._row(n, line, wanted) for n, line in block])

    def _row(self, number: int, line: str, wanted: list[int]) -> list[float]:
        """One line, slowly, with its fault by name."""
        fields = self.form.split(line)
        if self.trailing and fields and not fields[-1]:
            fields = fields[:-1]
        if len(fields) != self.width:
            raise ValueError(
                f'line {number}: {len(fields)} columns, line {self.first} has {self.width}'
            )
        return [self._value(number, fields[i]) for i in wanted]

    def _value(self, number: int, word: str) -> float:
        if word.lower() in NO_VALUE:
            return np.nan
        sign, other = (',', '.') if self.form.comma else ('.', ',')
        if _NUMBER.fullmatch(word) and other not in word:
            return float(word.replace(sign, '.'))
        if _GROUPED.fullmatch(word):
            raise ValueError(
                f"line {number}: '{shown(word)}' has separators of thousands; export without them"
            )
        if _NUMBER.fullmatch(word):
            raise ValueError(
                f"line {number}: '{shown(word)}' has a decimal {'comma' if other == ',' else 'point'}, the lines above "
                f'have a decimal {"point" if other == "," else "comma"}; export with decimal points throughout'
            )
        raise ValueError(f"line {number}: '{shown(word)}' is no number")

    def check_count(self, count: int) -> None:
        """ValueError where the file says how many points it has, and has others."""
        if self.announced_line and self.announced != count:
            raise ValueError(
                f'line {self.announced_line}: {self.announced} points are announced, {count} are there'
            )


def _numeric(line: str) -> bool:
    """Whether a line is one of numbers and not of names."""
    words = [w for w in re.split(r'[\s;,"]+', line) if w]
    numbers = [w for w in words if re.match(r"[-+.]?\d", w) or w.lower() in NO_VALUE]
    return bool(numbers) and len(numbers) == len(words)


def _header_words(line: str) -> list[str]:
    """Names of a header, each with its unit in brackets."""
    line = re.sub(r'\s+(?=[\[(])', '', line.replace('"', '').strip())
    words = re.split(r'\s*[;\t,]\s*', line) if re.search(r'[;\t,]', line) else line.split()
    return [w.strip() for w in words if w.strip()]
