"""Wire as an axis: how many of the moves that name it lay something, and the shares that a printer applies to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from waam_plan.import_gcode.line_words import LineWords
from waam_plan.import_gcode.words import ProgramError, refuse

MAX_IDLE_SHARE = 0.5  # share of the way of moves that name E; where more lays nothing, E is misread
MAX_WIPE_SHARE = 0.1  # share that wipes may have
SHARES = {'M220': 'speed', 'M221': 'wire'}  # of printers, in per cent
LOWEST, HIGHEST = 0.1, 10.0


@dataclass
class Extrusion:
    """pace, wire: factors of M220 and M221. Lengths in m, of the moves that name the wire's axis."""

    pace: float = 1.0
    wire: float = 1.0
    laid: int = 0
    laid_way: float = 0.0
    still: int = 0  # E stands still
    back: int = 0  # E goes back: wipes
    empty_way: float = 0.0
    first: int = 0  # line of the first that lays nothing

    def count(self, line: int, way: float, fed: float) -> None:
        """One move; fed: m of wire."""
        way = 0.0 if math.isnan(way) else way
        if fed > 0:
            self.laid, self.laid_way = self.laid + 1, self.laid_way + way
            return
        self.first = self.first or line
        self.empty_way += way
        if fed == 0:
            self.still += 1
        else:
            self.back += 1

    def doubt(self) -> str:
        """What is told about moves that lay nothing, '' for the wipes of a slicer. ProgramError where most do so."""
        empty, way = self.still + self.back, self.empty_way + self.laid_way
        if not empty or not way:
            return ''
        share = self.empty_way / way
        said = (
            f'line {self.first}: {empty} of {empty + self.laid} moves that name E lay nothing, '
            'because E does not advance there'
        )
        if share > MAX_IDLE_SHARE:
            raise ProgramError(f'{said}; say M83 where E is relative, M82 where it is absolute')
        return said if self.still or share > MAX_WIPE_SHARE else ''

    def share(self, name: str, words: LineWords, remarks: dict[str, str]) -> bool:
        """M220 and M221: whether the code was one of them. ProgramError for other words than S."""
        if name not in SHARES:
            return False
        value = words.take('S')
        if value is None or not LOWEST <= value / 100 <= HIGHEST:
            raise refuse(
                words.number, name, f'needs S, {LOWEST:.0%} to {HIGHEST:.0%} of the {SHARES[name]}'
            )
        if name == 'M220':
            self.pace = value / 100
        else:
            self.wire = value / 100
        if value != 100:
            what = SHARES[name]
            remarks.setdefault(
                f'{name} {value}',
                f'line {words.number}: {name}: the {what} is {value:g} % from here on',
            )
        return True
