"""What the operator sets up before a job, checked field by field. mm on the page, m inside. No ROS."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from waam_plan.settings import FINISHES
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.operating import DEFAULT_MATERIAL

from . import numbers

MODES = ('restore', 'build')
MACHINED = FINISHES[1]
LOOP_MODE_LABELS = {
    LoopMode.CLOSED_LOOP: 'closed loop',
    LoopMode.MONITOR: 'monitor only',
    LoopMode.OPEN_LOOP: 'open loop',
}  # as shown
LAST_SCAN = '(last scan)'


class FormError(ValueError):
    """All fields that are wrong, each with its limits."""


@dataclass(frozen=True)
class JobSetup:
    """Names are those of files in the part folders. 0 and NaN: the default of the regime or of the correction; 0
    layers: all."""

    part: str = ''
    as_found: str = ''
    mode: str = 'restore'
    material: str = DEFAULT_MATERIAL
    loop_mode: str = LoopMode.CLOSED_LOOP.value
    layers: int = 0
    layer_height_mm: float = 0.0
    bead_width_mm: float = 0.0
    tolerance_mm: float = 0.2
    k_gain: float = math.nan
    passes: int = 1
    finish: str = 'as-laid'
    allowance_mm: float = 0.0
    wire_left_m: float = 0.0  # on the spool; 0 = nobody told
    operator_name: str = ''
    wire_lot: str = ''
    gas: str = ''
    name: str = ''

    @property
    def notes(self) -> list[str]:
        """Consumables for the record, as key=value; only a person knows them."""
        told = {'wire_lot': self.wire_lot, 'gas': self.gas}
        return ['started_from=panel', *(f'{k}={v}' for k, v in told.items() if v)]

    @property
    def words(self) -> str:
        """What was understood, for the person who arms."""
        height, width = (
            f'{v:g} mm' if v else 'as the material says'
            for v in (self.layer_height_mm, self.bead_width_mm)
        )
        said = [
            f'{self.mode} {self.part}' + (f' from {self.as_found}' if self.as_found else ''),
            f'{self.material}, {LOOP_MODE_LABELS[LoopMode(self.loop_mode)]}',
            f'tolerance {self.tolerance_mm:g} mm',
            _counted(self.layers, 'layer') if self.layers else 'all layers',
            f'layer height {height}',
            f'bead width {width}',
        ]
        if self.mode == 'restore':
            said += [
                _counted(self.passes, 'pass'),
                f'finish {self.finish}',
                f'allowance {self.allowance}',
            ]
        if self.wire_left_m:
            said.append(f'{self.wire_left_m:g} m of wire on the spool')
        if not math.isnan(self.k_gain):
            said.append(f'gain {self.k_gain:g}')
        return '; '.join(said)

    @property
    def allowance(self) -> str:
        """In words."""
        chosen = self.finish == MACHINED and not self.allowance_mm
        return 'chosen by the forecast' if chosen else f'{self.allowance_mm:g} mm'

    def as_dict(self) -> dict[str, Any]:
        """For JSON: k_gain None instead of NaN."""
        data = asdict(self)
        return data | {'k_gain': None if math.isnan(self.k_gain) else self.k_gain}


def _counted(number: int, what: str) -> str:
    return f'{number} {what}' + ('' if number == 1 else 'es' if what.endswith('s') else 's')


LIMITS = {  # 0 is allowed besides where 0 means 'default'
    'layers': (0, 1000),
    'layer_height_mm': (0.5, 4.0),
    'bead_width_mm': (2.0, 15.0),
    'tolerance_mm': (0.02, 5.0),
    'k_gain': (0.0, 0.5),
    'passes': (1, 9),
    'allowance_mm': (-1.0, 5.0),
    'wire_left_m': (0.0, 1e5),
}
DEFAULTED = ('layer_height_mm', 'bead_width_mm')
CHOICES = {'mode': MODES, 'finish': FINISHES, 'loop_mode': LOOP_MODES}
MAX_TEXT_LENGTH = 80


def parse(data: Mapping[str, Any], materials: tuple[str, ...]) -> JobSetup:
    """The setup from JSON. Raises FormError that names everything that is wrong."""
    known = {f.name: f for f in fields(JobSetup)}
    problems = [f'unknown field {n}' for n in data if n not in known]
    values: dict[str, Any] = {}
    for name, value in data.items():
        if name in known:
            try:
                values[name] = _field(name, value, known[name].default, materials)
            except FormError as e:
                problems.append(str(e))
    if not problems and not values.get('part'):
        problems.append('part: choose one')
    if values.get('mode') == 'build' and (
        values.get('passes', 1) > 1
        or values.get('allowance_mm')
        or values.get('finish') == MACHINED
    ):
        problems.append('passes, finish, allowance_mm: only to restore')
    if problems:
        raise FormError('; '.join(problems))
    return JobSetup(**values)


def _field(name: str, value: Any, default: Any, materials: tuple[str, ...]) -> Any:
    if isinstance(default, str):
        return _text(name, value, CHOICES.get(name) or (materials if name == 'material' else ()))
    if value is None:
        return default  # not given
    low, high = LIMITS[name]
    unit = next((u for u in ('mm', 'm') if name.endswith(f'_{u}')), '')
    whole = isinstance(default, int)
    try:
        if name in DEFAULTED and numbers.of(value, 0.0, high, unit) == 0:
            return default
        return type(default)(numbers.of(value, low, high, unit, whole))
    except numbers.NumberRefused as e:
        raise FormError(f'{name}: {e}') from None


def _text(name: str, value: Any, choices: tuple[str, ...]) -> str:
    if not isinstance(value, str) or len(value) > MAX_TEXT_LENGTH or not value.isprintable():
        raise FormError(f'{name}: must be a line of at most {MAX_TEXT_LENGTH} characters')
    if choices and value not in choices:
        raise FormError(f'{name}: {value!r} is not one of {", ".join(choices)}')
    return value.strip()
