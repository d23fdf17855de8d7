"""The words of one line of a program, and which of them have been understood."""

from __future__ import annotations

from waam_plan.import_gcode.codes import GROUPS
from waam_plan.import_gcode.dialect import Setting
from waam_plan.import_gcode.words import Line, Word, refuse

MAX_TURNS = 1000


class LineWords:
    """The words of a line; whoever understands one takes it."""

    def __init__(self, line: Line) -> None:
        self.number = line.number
        self.all = line.words
        self.codes = [w for w in line.words if w.letter in 'GMT']
        self.values: dict[str, Word] = {}
        for w in line.words:
            if w.letter in 'GMT':
                continue
            if w.letter in self.values:
                raise refuse(line.number, w.text, f'{w.letter} stands twice in the line')
            self.values[w.letter] = w
        self.taken: set[str] = set()

    def has(self, letters: str) -> bool:
        """Whether one of these letters is there."""
        return any(letter in self.values for letter in letters)

    def take(self, letter: str) -> float | None:
        """The value, which is understood now; None where there is none."""
        if letter not in self.values:
            return None
        self.taken.add(letter)
        return self.values[letter].value

    def text(self, letter: str) -> str:
        """As written."""
        return self.values[letter].text

    def check_all_taken(self) -> None:
        """ProgramError for a word that nobody understood."""
        for letter, word in self.values.items():
            if letter not in self.taken:
                raise refuse(self.number, word.text, 'has no meaning in this line')

    def check_groups(self) -> None:
        """ProgramError for two codes of one modal group."""
        for group in GROUPS:
            held = [w for w in self.codes if w.code in group]
            if len(held) > 1:
                raise refuse(self.number, held[1].text, f'contradicts {held[0].text} beside it')

    def setting(self, setting: Setting, now: float) -> float:
        """What the line sets it to, in SI units; `now` where it says nothing. ProgramError below 0."""
        if not setting.letter or (setting.code and not setting.code.of(self.all)):
            return now
        if setting.code:
            for letter, _ in setting.code.beside:
                self.take(letter)
        value = self.take(setting.letter)
        if value is None:
            return now
        if value < 0:
            raise refuse(self.number, self.text(setting.letter), 'must not be negative')
        return value * setting.factor

    def turns(self) -> int:
        """Turns of an arc (P), 1 where none are given. ProgramError for other than 1 to MAX_TURNS whole ones."""
        value = self.take('P')
        if value is None:
            return 1
        if not (value == int(value) and 1 <= value <= MAX_TURNS):
            raise refuse(self.number, self.text('P'), f'whole turns, 1 to {MAX_TURNS}')
        return int(value)
