"""The page "G-code": what is asked of a program, field by field, and the look at it in a child process. No ROS."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from waam_plan.import_gcode.files import DEFAULT, shipped
from waam_plan.import_gcode.files import SUFFIXES as SUFFIXES
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.operating import DEFAULT_MATERIAL

from . import numbers
from .parts import PartFolders
from .worker import work

DIALECTS = (DEFAULT, *(n for n in shipped() if n != DEFAULT))
SHIFT_MM = 1000.0
MAX_NAME_LENGTH = 80


class ProgramRefused(ValueError):
    """A field, or the program itself; the text says what and where."""


@dataclass(frozen=True)
class ProgramChoice:
    """A program as `waam job run` takes it. Names are those of files in the part folders. shift: mm."""

    program: str
    dialect: str = 'waam'
    nominal: str = ''
    material: str = DEFAULT_MATERIAL
    loop_mode: str = LoopMode.MONITOR.value
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    operator_name: str = ''

    @property
    def words(self) -> str:
        """What was understood, for the person who arms."""
        shift = ', '.join(f'{v:g}' for v in self.shift_mm)
        nominal = f'against {self.nominal}' if self.nominal else 'no nominal part'
        loop = LoopMode(self.loop_mode).value.replace('_', ' ')
        return f'{self.program}, dialect {self.dialect}; {self.material}, {loop}; {nominal}; shift {shift} mm'

    @property
    def what(self) -> tuple[object, ...]:
        """What a look depends on."""
        return self.program, self.dialect, self.nominal, self.material, self.shift_mm


def parse_choice(data: Mapping[str, Any], materials: tuple[str, ...]) -> ProgramChoice:
    """From JSON. Raises ProgramRefused that names every field that is wrong."""
    choices = {'dialect': DIALECTS, 'material': materials, 'loop_mode': LOOP_MODES}
    problems = [f'unknown field {n!r}' for n in data if n not in ProgramChoice.__dataclass_fields__]
    values: dict[str, Any] = {}
    for name in ('program', 'dialect', 'nominal', 'material', 'loop_mode', 'operator_name'):
        value = data.get(name, '')
        if not isinstance(value, str) or len(value) > MAX_NAME_LENGTH or not value.isprintable():
            problems.append(f'{name}: must be a line of at most {MAX_NAME_LENGTH} characters')
        elif value and name in choices and value not in choices[name]:
            problems.append(f'{name}: {value!r} is not one of {", ".join(choices[name])}')
        elif value:
            values[name] = value
    try:
        values['shift_mm'] = _shift(data.get('shift_mm', (0.0, 0.0, 0.0)))
    except ProgramRefused as e:
        problems.append(str(e))
    if not problems and 'program' not in values:
        problems.append('program: choose one')
    if values.get('loop_mode') == LoopMode.CLOSED_LOOP and not values.get('nominal'):
        problems.append('loop_mode: closed_loop needs a nominal part')
    if problems:
        raise ProgramRefused('; '.join(problems))
    return ProgramChoice(**values)


def _shift(value: Any) -> tuple[float, float, float]:
    """X, Y, Z; null = 0."""
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ProgramRefused('shift_mm: three numbers, X, Y, Z')
    try:
        x, y, z = (0.0 if v is None else numbers.of(v, -SHIFT_MM, SHIFT_MM, 'mm') for v in value)
    except numbers.NumberRefused as e:
        raise ProgramRefused(f'shift_mm: {e}') from None
    return x, y, z


class Programs:
    """Programs on disk, the last look, and the one that is loaded. One look at a time."""

    def __init__(self, parts: PartFolders) -> None:
        self.parts = parts
        self.files = replace(parts, suffixes=SUFFIXES, kind='program')
        self.loaded: ProgramChoice | None = None
        self._looked: tuple[tuple[object, ...], dict[str, Any]] | None = None
        self._lock = asyncio.Lock()

    def paths(self, choice: ProgramChoice) -> tuple[Path, Path | None]:
        """Program and nominal part. Raises PartsError."""
        nominal = self.parts.find(choice.nominal) if choice.nominal else None
        return self.files.find(choice.program), nominal

    async def look(
        self, choice: ProgramChoice, machine: Mapping[str, Any] | None
    ) -> dict[str, Any]:
        """What program_look found, `beads` by layer among it. machine: the panel's section of that name, mm.

        The last one is kept, until the choice, the files or the reach change. Raises PartsError, WorkError.
        """
        program, nominal = self.paths(choice)
        limits = _limits(machine)
        files = tuple((f, f.stat().st_mtime_ns) for f in (program, nominal) if f)
        key = (choice.what, files, tuple(limits))
        async with self._lock:
            if self._looked and self._looked[0] == key:
                return self._looked[1]
            asked = {'program': str(program), 'nominal': str(nominal or ''), 'limits': limits,
                     'dialect': choice.dialect, 'material': choice.material,
                     'shift': [v * 1e-3 for v in choice.shift_mm]}  # fmt: skip
            found = json.loads(await work(['program', json.dumps(asked)]))
            self._looked = key, found
            return found

    async def load(self, choice: ProgramChoice, machine: Mapping[str, Any] | None) -> None:
        """The program that a start means from now on. Raises ProgramRefused with what stands against it."""
        self.loaded = None
        found = await self.look(choice, machine)
        wrong = [c for c in found['checks'] if c['level'] == 'bad']
        if wrong:
            raise ProgramRefused(f'{choice.program}: ' + '; '.join(c['text'] for c in wrong))
        self.loaded = choice


def _limits(machine: Mapping[str, Any] | None) -> list[float]:
    """Of the machine in the work frame, m: lowest x, y, z, highest x, y, z; [] while not known."""
    if not machine or not machine.get('limit_max'):
        return []
    low, high, zero = (machine[n] for n in ('limit_min', 'limit_max', 'work_offset'))
    values = [*low, *high]
    if any(v is None for v in (*values, *zero)) or not all(
        a < b for a, b in zip(low, high, strict=True)
    ):
        return []
    return [(v - z) * 1e-3 for v, z in zip(values, [*zero, *zero], strict=True)]
