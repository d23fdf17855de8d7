"""What a program has said so far about places: units, plane, absolute or relative, zero of G92, where the torch is."""

from __future__ import annotations

import math

from waam_plan.import_gcode import arc as arcs
from waam_plan.import_gcode.line_words import LineWords
from waam_plan.import_gcode.words import refuse
from waam_process.segment import Point

INCH = 0.0254
FARTHEST = 10.0  # m, of a coordinate
AXES = 'XYZ'
UNSURE = {  # firmwares do not agree; they do on all else
    ('M83', 'G90'): 'G90 after M83: E stays relative (Klipper, RepRap, Prusa; Marlin differs)',
    ('M82', 'G91'): 'G91 after M82: E is relative, too (Klipper, Marlin; RepRap differs)',
}


class Modal:
    """Modal state of RS274/NGC. extruder: letter of the axis that feeds wire, '' without one."""

    def __init__(self, extruder: str = '') -> None:
        self.extruder = extruder
        self.unit, self.plane, self.motion = 1e-3, 17, ''  # motion: G0 .. G3, '' = none is in force
        self.relative = self.centre_absolute = False
        self.wire_told = ''  # M82 or M83, '' = E is as X, Y and Z are
        self.unsure = ''  # what firmwares read in different ways, since the last M82 or M83
        self.place = [math.nan] * 3  # m, NaN = not known
        self.offset = [0.0, 0.0, 0.0]  # of G92: work = program + offset
        self.fed = 0.0  # m, position of the extruder

    @property
    def here(self) -> Point:
        """m, work frame; NaN = not known."""
        return self.place[0], self.place[1], self.place[2]

    def set(self, names: list[str]) -> None:
        """Modes that the G and M codes of a line set."""
        for name in names:
            if name in ('G20', 'G21'):
                self.unit = INCH if name == 'G20' else 1e-3
            elif name in ('G17', 'G18', 'G19'):
                self.plane = int(name[1:])
            elif name in ('G90', 'G91'):
                self._absolute(name)
            elif name in ('G90.1', 'G91.1'):
                self.centre_absolute = name == 'G90.1'
            elif name in ('M82', 'M83') and self.extruder:
                self.wire_told, self.unsure = name, ''
            elif name == 'G92.1':
                self.offset = [0.0, 0.0, 0.0]

    @property
    def wire_relative(self) -> bool:
        """Whether E is: after M83 and while G91 is in force, as Klipper has it."""
        return self.relative or self.wire_told == 'M83'

    def _absolute(self, name: str) -> None:
        self.relative = name == 'G91'
        self.unsure = UNSURE.get((self.wire_told, name), '')

    def leave(self, words: LineWords) -> None:
        """After a move in the machine's own coordinates the named axes, or all of them, are somewhere unknown."""
        named = [i for i, a in enumerate(AXES) if words.take(a) is not None]
        for i in named or range(3):
            self.place[i] = math.nan

    def shift(self, words: LineWords) -> None:
        """G92: the place is called so from here on. ProgramError where it is not known."""
        number = next(w for w in words.codes if w.code == 'G92')
        if not words.has(AXES + self.extruder):
            raise refuse(words.number, number.text, 'says no axis')
        if self.extruder and (fed := words.take(self.extruder)) is not None:
            self.fed = fed * self.unit
        for i, axis in enumerate(AXES):
            value = words.take(axis)
            if value is None:
                continue
            if math.isnan(self.place[i]):
                raise refuse(words.number, words.text(axis), f'where {axis} is, is not known yet')
            self.offset[i] = self.place[i] - value * self.unit

    def target(self, words: LineWords) -> Point:
        """Where the words of a line send the torch, m."""
        out = list(self.place)
        for i, axis in enumerate(AXES):
            value = words.take(axis)
            if value is None:
                continue
            value *= self.unit
            out[i] = out[i] + value if self.relative else value + self.offset[i]
            if abs(out[i]) > FARTHEST:
                raise refuse(words.number, words.text(axis), f'{out[i]:.3g} m away')
        return out[0], out[1], out[2]

    def feed(self, words: LineWords) -> float:
        """m of wire that the extruder feeds in this move."""
        value = words.take(self.extruder) if self.extruder else None
        if value is None:
            return 0.0
        at = value * self.unit + (self.fed if self.wire_relative else 0.0)
        fed, self.fed = at - self.fed, at
        return fed

    def arc(self, words: LineWords, end: Point) -> arcs.Arc:
        """The arc (G2, G3) of a line from here to `end`. ProgramError when it is none."""
        code, start = self.motion, self.here
        if any(math.isnan(v) for v in start):
            raise refuse(words.number, code, 'an arc from a place that is not known yet')
        turns = words.turns()
        p, q, r = arcs.PLANES[self.plane]
        letters = arcs.CENTRE_LETTERS
        radius = words.take('R')
        given = [words.take(letters[i]) for i in (p, q)]
        try:
            if radius is not None:
                if any(g is not None for g in given):
                    raise arcs.ArcError('R and a centre at once')
                return arcs.by_radius(
                    self.plane, start, end, radius * self.unit, code == 'G3', turns
                )
            centre = self._centre(given, start, (p, q))
            return arcs.by_centre(self.plane, start, end, centre, code == 'G3', turns)
        except arcs.ArcError as e:
            raise refuse(words.number, code, str(e)) from None

    def _centre(
        self, given: list[float | None], start: Point, axes: tuple[int, int]
    ) -> tuple[float, float]:
        names = [arcs.CENTRE_LETTERS[i] for i in axes]
        if given == [None, None] or (self.centre_absolute and None in given):
            raise arcs.ArcError(f'an arc needs {" and ".join(names)}, or R')
        a, b = ((g or 0.0) * self.unit for g in given)
        if self.centre_absolute:
            return a + self.offset[axes[0]], b + self.offset[axes[1]]
        return start[axes[0]] + a, start[axes[1]] + b
