"""What a program's codes mean: which one lights the arc, what sets wire, voltage and gas. A mapping (YAML), checked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from waam_plan.import_gcode.words import ProgramError, Word, read_lines
from waam_process.materials import UNITS

PER_PATH = 'mm/mm'  # of wire per length of path: the wire follows F
IDLE = ('keep', 'lift')
HEIGHTS = ('surface', 'top')


class DialectError(ValueError):
    """A dialect that cannot be used; the text names file and key."""


@dataclass(frozen=True)
class Code:
    """A code with what must stand beside it: 'M3', 'M67 E0'."""

    name: str
    beside: tuple[tuple[str, float], ...] = ()

    def of(self, words: Iterable[Word]) -> bool:
        """Whether these words of a line hold it."""
        found = [w for w in words if w.code == self.name]
        held = {(w.letter, w.value) for w in words}
        return bool(found) and all(b in held for b in self.beside)


@dataclass(frozen=True)
class Setting:
    """Where a setpoint comes from: a word, alone (modal) or beside a code, or one value for the whole program."""

    factor: float  # to SI; wire of PER_PATH: 1
    letter: str = ''
    code: Code | None = None
    value: float = math.nan  # in its own unit
    per_path: bool = False

    @property
    def start(self) -> float:
        """SI; NaN where the program says it."""
        return self.value * self.factor


@dataclass(frozen=True)
class Extruder:
    """Wire as an axis: the letter of its position, in mm. diameter: m, 0 = that of the material."""

    letter: str
    diameter: float = 0.0


@dataclass(frozen=True)
class Dialect:
    """wire: None where the program does not say it: then every bead gets the metal of its layer."""

    name: str
    arc_on: tuple[Code, ...] = ()  # none with an extruder: the arc burns where it feeds
    arc_off: tuple[Code, ...] = ()
    wire: Setting | Extruder | None = None
    voltage: Setting | None = None
    gas: tuple[Code, ...] = ()  # accepted; the controller has its own pre-flow and post-flow
    ignore: frozenset[str] = frozenset()  # codes without effect, on motion, arc or wire
    skip: frozenset[str] = frozenset()  # lines that begin with such a code are passed over
    macros: frozenset[str] = frozenset()  # and those that begin with such a name of Klipper's
    layer: tuple[re.Pattern[str], ...] = ()  # comments with which a layer begins
    idle: str = 'keep'  # moves without arc: as in the program, or lifted over the metal
    height: str = 'surface'  # z of a bead is that of the surface under it, or of its top
    block_delete: bool = False

    @property
    def extruder(self) -> Extruder | None:
        """The wire as an axis, if it is one."""
        return self.wire if isinstance(self.wire, Extruder) else None


_KEYS = {
    'name', 'about', 'arc_on', 'arc_off', 'wire', 'voltage', 'gas', 'ignore', 'skip', 'macros',
    'layer', 'idle', 'height', 'block_delete',
}  # fmt: skip
_SETTING = {'word', 'code', 'unit', 'value', 'factor'}


def dialect_of(data: Any, where: str) -> Dialect:
    """From what a YAML file holds. where: for messages. Raises DialectError with everything that is wrong."""
    maker = _Maker(where)
    found = maker.dialect(data)
    if maker.wrong or found is None:
        raise DialectError('; '.join(f'{where}: {text}' for text in maker.wrong))
    return found


@dataclass
class _Maker:
    """Collects what is wrong."""

    where: str
    wrong: list[str] = field(default_factory=list)

    def dialect(self, data: Any) -> Dialect | None:
        if not isinstance(data, Mapping):
            self.wrong.append('is no mapping of keys')
            return None
        self._known(data, _KEYS, '')
        wire = self._wire(data.get('wire'))
        made = Dialect(
            name=str(data.get('name') or self.where),
            arc_on=self._codes(data, 'arc_on'),
            arc_off=self._codes(data, 'arc_off'),
            wire=wire,
            voltage=self._setting(data.get('voltage'), 'voltage', UNITS['voltage']),
            gas=self._codes(data, 'gas'),
            ignore=frozenset(c.name for c in self._codes(data, 'ignore')),
            skip=frozenset(c.name for c in self._codes(data, 'skip')),
            macros=self._macros(data.get('macros', [])),
            layer=self._patterns(data.get('layer', [])),
            idle=self._choice(data, 'idle', IDLE),
            height=self._choice(data, 'height', HEIGHTS),
            block_delete=data.get('block_delete', False) is True,
        )
        self._arc(made)
        return made

    def _arc(self, d: Dialect) -> None:
        if d.extruder and (d.arc_on or d.arc_off):
            self.wrong.append(
                'arc_on, arc_off: with the wire as an axis the arc burns where it feeds'
            )
        if not d.extruder and not (d.arc_on and d.arc_off):
            self.wrong.append('arc_on and arc_off: both are needed, such as M3 and M5')

    def _known(self, data: Mapping, keys: set[str], before: str) -> None:
        for key in data:
            if key not in keys:
                self.wrong.append(f'{before}{key}: unknown; known are {", ".join(sorted(keys))}')

    def _choice(self, data: Mapping, key: str, allowed: tuple[str, ...]) -> str:
        value = data.get(key, allowed[0])
        if value not in allowed:
            self.wrong.append(f'{key}: {value!r}, must be one of {", ".join(allowed)}')
        return str(value)

    def _codes(self, data: Mapping, key: str) -> tuple[Code, ...]:
        value = data.get(key, [])
        texts = value if isinstance(value, list) else [value]
        return tuple(c for t in texts if (c := self._code(t, key)))

    def _code(self, text: Any, key: str) -> Code | None:
        try:
            words = next(read_lines(str(text))).words
        except (ProgramError, StopIteration):
            words = ()
        if not words or words[0].letter not in 'GMT':
            self.wrong.append(f'{key}: {text!r} is no code such as M3')
            return None
        return Code(words[0].code, tuple((w.letter, w.value) for w in words[1:]))

    def _macros(self, value: Any) -> frozenset[str]:
        names = [str(n) for n in (value if isinstance(value, list) else [value])]
        for name in names:
            if not re.fullmatch('[A-Z][A-Z0-9]*_[A-Z0-9_]+', name):  # with '_' it is no code
                self.wrong.append(f'macros: {name!r} is no name such as EXCLUDE_OBJECT_START')
        return frozenset(names)

    def _patterns(self, value: Any) -> tuple[re.Pattern[str], ...]:
        out = []
        for text in value if isinstance(value, list) else [value]:
            try:
                out.append(re.compile(str(text)))
            except re.error as e:
                self.wrong.append(f'layer: {text!r} is no regular expression ({e})')
        return tuple(out)

    def _wire(self, value: Any) -> Setting | Extruder | None:
        if isinstance(value, Mapping) and 'axis' in value:
            self._known(value, {'axis', 'diameter'}, 'wire.')
            letter = str(value['axis']).upper()
            if letter not in set('ABCEUVW'):
                self.wrong.append(f'wire.axis: {letter!r} is no letter of an axis')
            return Extruder(letter, self._number(value, 'wire', 'diameter', 0.0) * 1e-3)
        return self._setting(value, 'wire', {**UNITS['speed'], PER_PATH: 1.0})

    def _setting(self, value: Any, key: str, units: Mapping[str, float]) -> Setting | None:
        if value is None:
            return None
        if not isinstance(value, Mapping):
            self.wrong.append(f'{key}: {value!r} is no mapping (word, unit ...)')
            return None
        self._known(value, _SETTING, f'{key}.')
        unit = value.get('unit', next(iter(units)) if len(units) == 1 else None)
        if unit not in units:
            self.wrong.append(f'{key}.unit: {unit!r}, must be one of {", ".join(units)}')
        letter = str(value.get('word', '')).upper()
        if bool(letter) == ('value' in value) or (letter and not re.fullmatch('[A-Z]', letter)):
            self.wrong.append(f'{key}: give a letter as word, or a value')
        factor = units.get(unit, math.nan) * self._number(value, key, 'factor', 1.0)
        code = self._code(value['code'], f'{key}.code') if 'code' in value else None
        number = self._number(value, key, 'value', math.nan)
        return Setting(factor, letter, code, number, unit == PER_PATH)

    def _number(self, data: Mapping, key: str, name: str, default: float) -> float:
        value = data.get(name, default)
        usable = isinstance(value, int | float) and not isinstance(value, bool)
        if name in data and not (usable and 0 < value < 1e6):
            self.wrong.append(f'{key}.{name}: {value!r}, must be a number above 0')
            return default
        return float(value)
