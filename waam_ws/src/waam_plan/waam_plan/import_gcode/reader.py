"""The reader of G-code: words to motions, modal state as RS274/NGC has it, wire and arc as a dialect says.

The order within a line is that of RS274/NGC: modes, feed, wire and arc, dwell, motion, end. So M3 and M5 act before
the move of their line. With the wire as an axis (E) the rules are those of printers: G0 moves like G1, G90 and G91
count for E too until M82 or M83 says otherwise, M83 stays in force over a G90, the P of G4 is in ms, M220 and M221
are shares of speed and wire.
"""

from __future__ import annotations

import math

from waam_plan.import_gcode import arc as arcs
from waam_plan.import_gcode.codes import GROUPS, HOMING, MOVES, OTHER_AXES, QUIET, WHY_NOT
from waam_plan.import_gcode.dialect import Dialect, Setting
from waam_plan.import_gcode.extrusion import Extrusion
from waam_plan.import_gcode.line_words import LineWords
from waam_plan.import_gcode.modal import AXES, Modal
from waam_plan.import_gcode.motion import Motion, Program
from waam_plan.import_gcode.words import Line, Passing, ProgramError, Word, read_lines, refuse
from waam_process.segment import Point

OF_SLICERS = ('M82', 'M83', 'M104', 'M106', 'M107', 'M109', 'M140', 'M190')
LONGEST_DWELL = 3600.0  # s
MAX_MOTIONS = 5_000_000


def read_program(text: str, dialect: Dialect, name: str = 'program') -> Program:
    """Raises ProgramError, which names line and word, for everything that has no meaning here."""
    reader = _Reader(dialect)
    homing = frozenset(['G28'] if dialect.extruder else [])
    for line in read_lines(
        text, Passing(dialect.block_delete, dialect.macros, dialect.skip, homing)
    ):
        if reader.ended:
            reader.behind(line)
            continue
        reader.line(line)
    reader.finish()
    if not any(m.arc for m in reader.motions):
        raise ProgramError(
            f'{name}: the arc is never lit by the codes of dialect {dialect.name}; choose another one'
        )
    diameter = dialect.extruder.diameter if dialect.extruder else 0.0
    return Program(
        name,
        reader.motions,
        diameter,
        dialect.idle,
        dialect.height,
        list(reader.remarks.values()),
        reader.warnings,
    )


class _Reader:
    """Speed, wire and arc, and the motions so far."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.motions: list[Motion] = []
        self.remarks: dict[str, str] = {}
        self.warnings: list[str] = []
        self.extrusion = Extrusion()
        self.modal = Modal(dialect.extruder.letter if dialect.extruder else '')
        self.speed = math.nan
        self.burning, self.lit_in, self.mark, self.ended = False, 0, 0, False
        wire, volts = dialect.wire, dialect.voltage
        self.wire = wire.start if isinstance(wire, Setting) else math.nan
        self.voltage = volts.start if volts else math.nan

    def line(self, line: Line) -> None:
        """One line, in the order of RS274/NGC."""
        for comment in line.comments:
            self.mark += any(p.search(comment) for p in self.dialect.layer)
        words = LineWords(line)
        if not line.words:
            return
        if words.codes and words.codes[0].code in self.dialect.skip:
            if words.codes[0].code == 'G10' and words.has('L'):
                raise refuse(line.number, 'G10 L', WHY_NOT['G10'])
            return
        words.check_groups()
        names = [w.code for w in words.codes]
        self.modal.set(names)
        self._feed(words)
        self._setpoints(words)
        home = self._codes(words, line)
        self._dwell(words, names)
        if home or 'G53' in names:
            self._leave(words)
        elif 'G92' in names:
            self.modal.shift(words)
        else:
            self._move(words, names)
        words.check_all_taken()
        if self.ended and self.burning:
            raise refuse(line.number, line.words[0].text, f'the arc of line {self.lit_in} burns')

    def behind(self, line: Line) -> None:
        """A line after the end of the program: a controller does not read it either."""
        if line.words:
            self.remarks.setdefault(
                'end',
                f'what follows the end of the program is not read (from line {line.number} on)',
            )

    def finish(self) -> None:
        """ProgramError when the arc is never put out, or most moves that name E lay nothing."""
        if said := self.extrusion.doubt():
            self.warnings.append(said)
        if self.burning:
            raise ProgramError(
                f'line {self.lit_in}: the arc that is lit here is never put out '
                f'({", ".join(c.name for c in self.dialect.arc_off)})'
            )

    # ---- modes and setpoints -------------------------------------------------------------------

    def _feed(self, words: LineWords) -> None:
        value = words.take('F')
        if value is None:
            return
        if not value > 0:
            raise refuse(words.number, words.text('F'), 'a feed must be above 0')
        self.speed = value * self.modal.unit / 60  # as written: M220 comes on top

    def _setpoints(self, words: LineWords) -> None:
        d = self.dialect
        if isinstance(d.wire, Setting):
            self.wire = words.setting(d.wire, self.wire)
        if d.voltage:
            self.voltage = words.setting(d.voltage, self.voltage)

    def _codes(self, words: LineWords, line: Line) -> bool:
        """Arc, gas, end; every code must mean something. True for a move to the machine's own zero."""
        home = False
        for word in words.codes:
            name = word.code
            known = self._arc_code(word, words, line) or name in self.dialect.ignore
            known |= any(c.name == name for c in self.dialect.gas)
            known |= name in QUIET or any(name in group for group in GROUPS[:5])
            known |= name in ('G4', 'G92', 'G92.1', 'G53') or self._sets(name)
            known |= bool(self.dialect.extruder) and name in ('M82', 'M83')
            known |= bool(self.dialect.extruder) and self.extrusion.share(name, words, self.remarks)
            if name == 'G64':
                words.take('P'), words.take('Q')
            if name in ('G28', 'G30'):
                home = known = True
            if name in ('M2', 'M30'):
                self.ended = known = True
            if not known:
                why = WHY_NOT.get(name, f'means nothing in dialect {self.dialect.name}')
                if name in OF_SLICERS and not self.dialect.extruder:
                    why += '; a program of a slicer? Then --dialect slicer'
                raise refuse(words.number, word.text, why)
        return home

    def _sets(self, name: str) -> bool:
        settings = (self.dialect.wire, self.dialect.voltage)
        return any(isinstance(s, Setting) and s.code and s.code.name == name for s in settings)

    def _arc_code(self, word: Word, words: LineWords, line: Line) -> bool:
        for codes, on in ((self.dialect.arc_on, True), (self.dialect.arc_off, False)):
            for code in codes:
                if code.name == word.code and code.of(line.words):
                    for letter, _ in code.beside:
                        words.take(letter)
                    if on and not self.burning:
                        self.lit_in = words.number
                    self.burning = on
                    return True
        return False

    # ---- where the torch is --------------------------------------------------------------------

    def _leave(self, words: LineWords) -> None:
        """To a place in the machine's own coordinates: the job does that by itself, the place is unknown then."""
        word = next(w for w in words.codes if w.code in ('G28', 'G30', 'G53'))
        if self.burning:
            raise refuse(words.number, word.text, 'moves in machine coordinates with the arc on')
        self.modal.leave(words)
        if word.code != 'G53':
            more = OTHER_AXES + (HOMING if self.dialect.extruder else '')
            for axis in more:  # of machines that have more: homing them moves nothing here
                words.take(axis)
        self.remarks.setdefault(
            word.code, f'{word.code} is left to the job (first in line {words.number})'
        )

    # ---- motion --------------------------------------------------------------------------------

    def _dwell(self, words: LineWords, names: list[str]) -> None:
        if 'G4' not in names:
            return
        scale = 1e-3 if self.dialect.extruder else 1.0
        value = words.take('P')
        seconds = value * scale if value is not None else None
        if self.dialect.extruder and words.has('S'):
            seconds = words.take('S')
        if seconds is None:
            raise refuse(words.number, 'G4', 'says no time (P)')
        if not 0 <= seconds <= LONGEST_DWELL:
            raise refuse(words.number, 'G4', f'{seconds:g} s, must be 0 to {LONGEST_DWELL:g} s')
        if seconds:
            here = self.modal.here
            lit = self.burning and not self.dialect.extruder
            wait = self._motion(words.number, here, here, lit, dwell=seconds)
            self._check_lit(wait, words, 'G4')
            self._add(wait)

    def _move(self, words: LineWords, names: list[str]) -> None:
        modal = self.modal
        for name in names:
            if name in (*MOVES, 'G80'):
                modal.motion = name if name in MOVES else ''
        centre = 'IJKR' if modal.motion in ('G2', 'G3') else ''
        if not words.has(AXES + modal.extruder + centre):
            return
        if not modal.motion:
            word = next(w for w in words.values.values() if w.letter in AXES + modal.extruder)
            raise refuse(words.number, word.text, 'no G0, G1, G2 or G3 says how to go there')
        start, end = modal.here, modal.target(words)
        round_ = modal.arc(words, end) if centre else None
        fed = modal.feed(words) * self.extrusion.wire
        modal.place = list(end)
        if modal.extruder and modal.extruder in words.values and start != end:
            self.extrusion.count(words.number, math.dist(start, end), fed)
            if modal.unsure and fed > 0:
                self.remarks.setdefault('E', f'line {words.number}: {modal.unsure}')
        if start != end or round_:
            self._go(words, start, end, round_, fed)

    def _go(
        self, words: LineWords, start: Point, end: Point, round_: arcs.Arc | None, fed: float
    ) -> None:
        lit = fed > 0 if self.dialect.extruder else self.burning
        # a printer that was told no feed goes idle at its own
        own = self.dialect.extruder and math.isnan(self.speed) and not lit
        rapid = own or (self.modal.motion == 'G0' and not self.dialect.extruder)
        word = next(w.text for w in words.values.values() if w.letter in (*AXES, *'IJKR'))
        if math.isnan(self.speed) and not rapid:
            raise refuse(words.number, word, 'no feed (F) has been given')
        if lit and rapid:
            raise refuse(
                words.number, word, f'a rapid (G0) with the arc on, lit in line {self.lit_in}'
            )
        move = self._motion(words.number, start, end, lit, rapid=rapid, round_=round_, fed=fed)
        self._check_lit(move, words, word)
        self._add(move)

    def _check_lit(self, motion: Motion, words: LineWords, word: str) -> None:
        """ProgramError for an arc at an unknown place or without wire."""
        if not motion.arc:
            return
        for axis, *values in zip(AXES, motion.start, motion.end, strict=True):
            if any(map(math.isnan, values)):
                why = f'the arc is on, but where {axis} is, is not known yet'
                raise refuse(words.number, word, why)
        if self.dialect.wire is not None and not motion.wire > 0:
            raise refuse(words.number, word, 'the arc is on, but no wire is fed')

    def _motion(
        self,
        number: int,
        start: Point,
        end: Point,
        lit: bool,
        *,
        rapid: bool = False,
        round_: arcs.Arc | None = None,
        fed: float = 0.0,
        dwell: float = 0.0,
    ) -> Motion:
        speed = math.nan if rapid else self.speed * self.extrusion.pace
        length = round_.length if round_ else math.dist(start, end)
        wire = self.wire
        if self.dialect.extruder:
            wire = fed * speed / length if lit else 0.0
        elif isinstance(self.dialect.wire, Setting) and self.dialect.wire.per_path:
            wire = self.wire * speed
        volts = 0.0 if math.isnan(self.voltage) else self.voltage
        return Motion(
            line=number,
            start=start,
            end=end,
            speed=speed,
            rapid=rapid,
            arc=lit,
            wire=wire,
            voltage=volts,
            dwell=dwell,
            round=round_,
            mark=self.mark,
        )

    def _add(self, motion: Motion) -> None:
        if len(self.motions) >= MAX_MOTIONS:
            raise ProgramError(f'line {motion.line}: more than {MAX_MOTIONS} moves')
        self.motions.append(motion)
