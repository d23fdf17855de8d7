"""G-code whose points are mapped (`skew`): every word of a place is replaced, everything else stays as it is."""

from __future__ import annotations

import re

import numpy as np

from waam_plan.gcode.skew import SkewError
from waam_plan.import_gcode import arc as arcs
from waam_process.segment import Point

CHORD = 2e-6  # m, of an arc from the lines that take its place
INCH = 0.0254
_WORD = re.compile(r'([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))')
# X1e-05, which the controller refuses, too; a small e behind a small letter is a word
_EXPONENT = re.compile(r'([A-Z])\s*[-+]?(?:\d+\.?\d*|\.\d+)e\s*[-+]?\.?\d')
_COMMENT = re.compile(r'\([^)]*\)|;.*')
# a text for the operator follows
_MESSAGE = re.compile(r'\s*(?:N\s*\d+\s*)?M11[78](?!\d)', re.IGNORECASE)
_COMPUTED = re.compile(r'[XYZIJKR]\s*[#\[][^\s;(]*', re.IGNORECASE)  # X#1, X[#2+1]
_AROUND = re.compile(r'^\s*/|^\s*%\s*$')  # block delete, begin or end of a program
MOVES = frozenset({0.0, 1.0, 2.0, 3.0})
ELSEWHERE = frozenset({4.0, 10.0, 28.0, 30.0, 53.0})  # their words are no place in the work frame
BESIDE = frozenset(  # modes that may stand beside a move
    {17, 18, 19, 20, 21, 40, 43, 49, 50, 54, 55, 56, 57, 58, 59, 59.1, 59.2, 59.3, 61, 61.1, 64, 80, 90, 90.1, 91,
     91.1, 92, 93, 94, 95, 96, 97, 98, 99}
)  # fmt: skip
SETTINGS_FROM = 92.0  # M92 X80, M201 X1000: settings of a printer, no place
_TOKEN = re.compile(f'{_COMMENT.pattern}|{_WORD.pattern}')  # group 1: the letter of a word


def correct_gcode(text: str, matrix: np.ndarray) -> str:
    """The program with every commanded point replaced by matrix @ point. Other words, comments and lines stay.

    Moves are absolute (G90) or relative (G91). The image of an arc (G2, G3) is no circle: lines within CHORD of it take
    its place. A rapid (G0) moves only axes that the program has named so far: `G0 Z50` at the beginning lifts, and
    leaves X and Y, which lean with Z, to the first line that names them.
    SkewError naming line and word for arcs that are none, G92 of X, Y or Z, codes with words of a place that are no
    move (cycles, splines, other zeros), what cannot be read, and words whose partner is not known yet (a first X
    without Y on an axis pair that is not square).
    """
    program = _Program(matrix)
    return '\n'.join(program.line(raw, n) for n, raw in enumerate(text.split('\n'), 1))


class _Place:
    """Modal state: where the program wants the torch (3,), NaN = it has not said, and how it says so."""

    def __init__(self) -> None:
        self.wanted = np.full(3, np.nan)
        self.relative = self.wire_relative = self.centre_absolute = False
        self.motion, self.plane, self.unit = -1.0, 17, 1e-3
        self.wire = 0.0  # position of E

    @property
    def rapid(self) -> bool:
        """The moves are rapids."""
        return self.motion == 0.0

    def read(self, raw: str) -> tuple[set[float], dict[str, float]]:
        """G codes of a line and its words for axes and arcs, none where they are no place in the work frame."""
        words = [(letter.upper(), float(v)) for letter, v in _WORD.findall(_COMMENT.sub('', raw))]
        codes = {v for letter, v in words if letter == 'G'}
        if any(letter == 'M' and v >= SETTINGS_FROM for letter, v in words):
            return codes, {}
        if codes & {90.0, 91.0}:
            self.relative = self.wire_relative = 91.0 in codes
        if extruder := {v for letter, v in words if letter == 'M'} & {82.0, 83.0}:
            self.wire_relative = 83.0 in extruder
        if codes & {90.1, 91.1}:
            self.centre_absolute = 90.1 in codes
        if codes & {20.0, 21.0}:
            self.unit = INCH if 20.0 in codes else 1e-3
        for v in codes & {17.0, 18.0, 19.0}:
            self.plane = int(v)
        for v in codes & MOVES:
            self.motion = v
        if codes & {28.0, 30.0, 53.0}:  # machine moves: the place is unknown afterwards
            self.wanted[:] = np.nan
        elsewhere = codes & ELSEWHERE
        given = {letter: v for letter, v in words if letter in 'XYZIJKREP'}
        return codes, {} if elsewhere else given

    def go(self, given: dict[str, float]) -> np.ndarray:
        """The words (3,), NaN where there is none; `wanted` follows them."""
        values = np.array([given.get(a, np.nan) for a in 'XYZ'])
        if self.relative:
            self.wanted = self.wanted + np.nan_to_num(values)
        else:
            self.wanted = np.where(np.isfinite(values), values, self.wanted)
        return values

    def arc(self, given: dict[str, float], number: int) -> np.ndarray | None:
        """(n + 1, 3) corners of the arc of this line in the program's unit, `wanted` is its end; None for other lines.

        SkewError when it is none, or begins where nobody knows.
        """
        if self.motion not in (2.0, 3.0) or not set(given) & set('XYZIJKR'):
            return None
        start = self.wanted.copy()
        self.go(given)
        if not np.isfinite(start).all():
            raise SkewError(f'line {number}: the arc begins at a place that is not known yet')
        try:
            return self._arc(given, start).chords(CHORD) / self.unit
        except arcs.ArcError as e:
            raise SkewError(f'line {number}: {e}') from None

    def _arc(self, given: dict[str, float], start: np.ndarray) -> arcs.Arc:
        a, b = _metres(start, self.unit), _metres(self.wanted, self.unit)
        left, turns = self.motion == 3.0, max(1, round(given.get('P', 1)))
        if 'R' in given:
            return arcs.by_radius(self.plane, a, b, given['R'] * self.unit, left, turns)
        axes = arcs.PLANES[self.plane][:2]
        if not any(arcs.CENTRE_LETTERS[i] in given for i in axes):
            raise arcs.ArcError('an arc needs a centre or R')
        x, y = (
            given.get(arcs.CENTRE_LETTERS[i], 0.0) * self.unit
            + (0.0 if self.centre_absolute else a[i])
            for i in axes
        )
        return arcs.by_centre(self.plane, a, b, (x, y), left, turns)


def _metres(point: np.ndarray, unit: float) -> Point:
    x, y, z = (point * unit).tolist()
    return x, y, z


class _Program(_Place):
    """Corrects a program line by line."""

    def __init__(self, matrix: np.ndarray) -> None:
        super().__init__()
        self.matrix = matrix
        self.needed = np.abs(matrix) > 1e-15

    def line(self, raw: str, number: int) -> str:
        if found := _EXPONENT.search(_COMMENT.sub('', raw)):
            raise SkewError(
                f'line {number}: {found[1]}: an exponent is not read, write the number out'
            )
        if _MESSAGE.match(raw):
            return raw
        codes, given = self.read(raw)
        _check(raw, codes, given, number)
        if 92 in codes:
            if set(given) & set('XYZ') or not given:
                raise SkewError(f'line {number}: G92 moves the zero that the correction is about')
            self.wire = given.get('E', self.wire)
            return raw
        start, fed = self.wanted.copy(), self._fed(given)
        corners = self.arc(given, number)
        if corners is not None:
            return self._lines(raw, start, corners, fed)
        axes = {a: v for a, v in given.items() if a in 'XYZ'}
        return self._replaced(raw, self._commanded(axes, number)) if axes else raw

    def _fed(self, given: dict[str, float]) -> tuple[float, float]:
        """E before and after the line."""
        before = self.wire
        if 'E' in given:
            self.wire = given['E'] + (before if self.wire_relative else 0.0)
        return before, self.wire

    def _lines(
        self, raw: str, start: np.ndarray, corners: np.ndarray, fed: tuple[float, float]
    ) -> str:
        """Lines instead of an arc; what else stands in its line is in the first of them."""
        points = corners @ self.matrix.T
        wire = np.linspace(*fed, len(points))
        steps = np.diff(points, axis=0) if self.relative else points[1:]
        feeds = np.diff(wire) if self.wire_relative else wire[1:]
        out = []
        for (x, y, z), e in zip(steps.tolist(), feeds.tolist(), strict=True):
            extra = f' E{e:.5f}' if fed[0] != fed[1] else ''
            out.append(f'G1 X{x:.4f} Y{y:.4f} Z{z:.4f}{extra}')
        rest = _TOKEN.sub(self._no_arc, raw)
        end = _COMMENT.search(rest)
        at = end.start() if end else len(rest)
        kept, comment = rest[:at].rstrip(), rest[at:]
        out[0] = f'{kept}{" " if kept else ""}{out[0]}{" " if comment else ""}{comment}'
        return '\n'.join(out)

    @staticmethod
    def _no_arc(match: re.Match) -> str:
        letter = (match[1] or '').upper()
        arc = letter == 'G' and float(match[2]) in (2.0, 3.0)
        return '' if arc or letter in tuple('XYZIJKREP') else match[0]

    def _commanded(self, given: dict[str, float], number: int) -> dict[str, float]:
        """Words of the corrected line: of every axis that a given one has a part in."""
        values = self.go(given)
        point = np.nan_to_num(values) if self.relative else self.wanted
        out: dict[str, float] = {}
        for i, axis in enumerate('XYZ'):
            needed = self.needed[i]
            asked = any(needed[j] and b in given for j, b in enumerate('XYZ'))
            if asked and not self._waits(i, given):
                self._check_known(axis, needed & np.isnan(point), number)
                out[axis] = float(self.matrix[i, needed] @ point[needed])
        return out

    def _waits(self, i: int, given: dict[str, float]) -> bool:
        """An axis that no line has named yet stays where it is during a rapid of the others."""
        return (
            self.rapid and not self.relative and 'XYZ'[i] not in given and np.isnan(self.wanted[i])
        )

    @staticmethod
    def _check_known(axis: str, missing: np.ndarray, number: int) -> None:
        if missing.any():
            names = ', '.join(a for a, m in zip('XYZ', missing, strict=True) if m)
            raise SkewError(
                f'line {number}: {axis} depends on {names}, which the program has not said yet; '
                'begin with G0 Z, then G0 X Y'
            )

    @staticmethod
    def _replaced(raw: str, point: dict[str, float]) -> str:
        """The line with its words replaced in place; words that were not there follow the last of X, Y, Z."""
        left = dict(point)

        def swap(match: re.Match) -> str:
            axis = (match[1] or '').upper()
            return f'{axis}{left.pop(axis):.4f}' if axis in left else match[0]

        out = _TOKEN.sub(swap, raw)
        if left:
            last = max(m.end() for m in _TOKEN.finditer(out) if (m[1] or '-').upper() in 'XYZ')
            extra = ''.join(f' {axis}{value:.4f}' for axis, value in left.items())
            out = out[:last] + extra + out[last:]
        return out


def _check(raw: str, codes: set[float], given: dict[str, float], number: int) -> None:
    """SkewError for a line that would be corrected although nobody knows what it does."""
    body = _COMMENT.sub(' ', raw)
    if found := _COMPUTED.search(body):
        raise SkewError(
            f'line {number}: {found[0]}: is computed by the machine, write the number out'
        )
    if not codes and not given:
        return
    if set(given) & set('XYZIJKR') and (unknown := sorted(codes - MOVES - BESIDE)):
        raise SkewError(f'line {number}: G{unknown[0]:g}: is no move that can be corrected')
    if rest := ' '.join(_AROUND.sub('', _WORD.sub(' ', body)).split()):
        raise SkewError(f'line {number}: {rest[:24]}: cannot be read')
