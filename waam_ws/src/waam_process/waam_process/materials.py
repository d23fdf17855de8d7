"""The material table: wire, regime and limits of every material, read from `materials.yaml` and an
operator's own file.

Files carry units ('1.2 mm', '5 m/min'); a `Material` is SI throughout, temperatures in degrees
Celsius.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from . import bead, operating

DEFAULT = operating.DEFAULT_MATERIAL
# d ln(current) / d ln(wire feed) of a short arc at constant contact distance
CURRENT_EXPONENT = 0.65
# d ln(width) of a single bead by eq 2.13 of source 000: / d ln(current), / d ln(voltage), / d ln(travel speed)
WIDTH_EXPONENTS = (0.35, 0.4, -0.5)
TABLE = Path(__file__).with_name('materials.yaml')


class MaterialError(ValueError):
    """A material that is unknown or a table that is invalid; the text names file, material,
    field and limit.
    """


# dimension -> unit as written in a file -> factor to SI
UNITS: dict[str, dict[str, float]] = {
    'length': {'m': 1.0, 'mm': 1e-3, 'um': 1e-6, 'in': 0.0254},
    'speed': {
        'm/s': 1.0,
        'mm/s': 1e-3,
        'm/min': 1 / 60,
        'mm/min': 1e-3 / 60,
        'in/min': 0.0254 / 60,
    },
    'density': {'kg/m3': 1.0, 'g/cm3': 1e3},
    'voltage': {'V': 1.0},
    'current': {'A': 1.0},
    'temperature': {'degC': 1.0},
    'per kelvin': {'1/K': 1.0},
    'conductivity': {'W/(m K)': 1.0},
    'specific heat': {'J/(kg K)': 1.0},
    'ratio': {'': 1.0, '%': 1e-2},
}


def quantity(dimension: str, low: float, high: float) -> Any:
    """A field with a dimension and the closed range (SI) outside which a value is taken for a
    mistake.
    """
    return field(metadata={'dimension': dimension, 'low': low, 'high': high})


def optional(dimension: str, low: float, high: float) -> Any:
    """A field like `quantity` that a table may leave out; it is 0 then."""
    limits = {'dimension': dimension, 'low': low, 'high': high, 'optional': True}
    return field(default=0.0, metadata=limits)


@dataclass(frozen=True)
class Material:
    """One wire with its default regime and the limits that setpoints are clamped to."""

    name: str
    description: str
    wire_diameter: float = quantity('length', 0.4e-3, 4e-3)
    density: float = quantity('density', 1000, 20000)
    efficiency: float = quantity('ratio', 0.3, 1.0)
    arc_efficiency: float = quantity('ratio', 0.1, 1.0)
    conductivity: float = quantity('conductivity', 1, 500)
    specific_heat: float = quantity('specific heat', 100, 2000)
    layer_height: float = quantity('length', 0.3e-3, 6e-3)
    bead_width: float = quantity('length', 1e-3, 30e-3)
    overlap: float = quantity('ratio', 0.5, 1.0)
    speed: float = quantity('speed', 0.5e-3, 0.2)
    voltage: float = quantity('voltage', 5, 60)
    speed_min: float = quantity('speed', 0.1e-3, 0.2)
    speed_max: float = quantity('speed', 0.5e-3, 0.5)
    feed_min: float = quantity('speed', 1e-3, 1.0)
    feed_max: float = quantity('speed', 1e-2, 1.0)
    voltage_min: float = quantity('voltage', 5, 60)
    voltage_max: float = quantity('voltage', 5, 60)
    interpass_limit: float = quantity('temperature', 30, 900)
    kt: float = quantity('per kelvin', 0.0, 5e-3)
    kt_start: float = quantity('temperature', 0, 900)
    kt_end: float = quantity('temperature', 0, 1200)
    t_env: float = quantity('temperature', -40, 60)
    # The operator's set current of the regime at one wire feed, for the cost of eq 2.4. 0 = not known.
    arc_current: float = optional('current', 10, 1000)
    arc_current_feed: float = optional('speed', 1e-3, 1.0)

    @property
    def wire_area(self) -> float:
        """m2"""
        return math.pi * self.wire_diameter**2 / 4

    @property
    def diffusivity(self) -> float:
        """m2/s"""
        return self.conductivity / (self.density * self.specific_heat)

    @property
    def pitch(self) -> float:
        """Distance of neighbouring beads in the default regime, m."""
        return self.overlap * self.bead_width

    def set_current(self, feed: float) -> float:
        """The operator's set current in A at a wire feed (m/s): I ~ feed^CURRENT_EXPONENT; 0 = not known."""
        if not (self.arc_current and self.arc_current_feed):
            return 0.0
        return self.arc_current * (feed / self.arc_current_feed) ** CURRENT_EXPONENT

    def width(self, feed: float, speed: float, voltage: float) -> float:
        """Width of a single bead in m by eq 2.13, from that of the default regime: its misprinted constant does not
        matter. feed, speed m/s; voltage V."""
        by_current, by_voltage, by_speed = WIDTH_EXPONENTS
        return float(
            self.bead_width
            * (feed / self.wire_feed) ** (CURRENT_EXPONENT * by_current)
            * (voltage / self.voltage) ** by_voltage
            * (speed / self.speed) ** by_speed
        )

    def voltage_for(self, width: float, feed: float, speed: float) -> float:
        """Voltage in V at which `width` gives this width (m); its limits are not looked at."""
        return self.voltage * (width / self.width(feed, speed, self.voltage)) ** (
            1 / WIDTH_EXPONENTS[1]
        )

    @property
    def wire_feed(self) -> float:
        """Wire feed speed of the default regime by eq 2.17, m/s."""
        return float(bead.wire_feed(self.bead_width, self.layer_height, self.speed, self))


def load(path: str | Path | None = None) -> dict[str, Material]:
    """All materials by name; `path` names an operator's file whose entries add to the table or
    replace entries of it.
    """
    table = dict(_read(TABLE))
    if path is not None:
        table.update(_read(Path(path)))
    return table


def get(name: str, path: str | Path | None = None) -> Material:
    """The material of that name (case does not matter); MaterialError names the known ones."""
    table = load(path)
    key = name.strip().lower()
    if key not in table:
        near = difflib.get_close_matches(key, table, 1)
        hint = f"did you mean '{near[0]}'? " if near else ''
        raise MaterialError(
            f"unknown material '{name}'; {hint}known are {', '.join(sorted(table))}"
        )
    return table[key]


def parse_quantity(text: Any, dimension: str) -> float:
    """SI value of a text such as '1.2 mm'; MaterialError when the unit is missing, unknown or of
    another dimension.
    """
    units = UNITS[dimension]
    number, _, unit = str(text).strip().partition(' ')
    unit = unit.strip()
    if unit not in units:
        known = ', '.join(repr(u) if u else 'no unit' for u in units)
        raise MaterialError(f"'{text}' is not a {dimension}: its unit must be one of {known}")
    try:
        value = float(number)
    except ValueError:
        raise MaterialError(f"'{text}' does not start with a number") from None
    return value * units[unit]


@cache
def _read_packaged() -> dict[str, Material]:
    return _parse_file(TABLE)


def _read(path: Path) -> dict[str, Material]:
    return _read_packaged() if path == TABLE else _parse_file(path)


def _parse_file(path: Path) -> dict[str, Material]:
    try:
        data = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as e:
        raise MaterialError(f'{path}: cannot be read ({e})') from None
    except yaml.YAMLError as e:
        raise MaterialError(f'{path}: is not YAML ({e})') from None
    if not isinstance(data, Mapping) or not data:
        raise MaterialError(f'{path}: must map names of materials to their values')
    table = {}
    for name, entry in data.items():
        try:
            for key, values in _regimes(str(name).strip().lower(), entry).items():
                table[key] = _parse_material(key, values)
        except (MaterialError, bead.BeadError) as e:
            raise MaterialError(f"{path}: material '{name}': {e}") from None
    return table


def _regimes(name: str, entry: Any) -> dict[str, Any]:
    """The entry itself and one 'name:regime' for each of its `regimes`, which replace some of its fields."""
    if not isinstance(entry, Mapping):
        return {name: entry}
    plain = {k: v for k, v in entry.items() if k != 'regimes'}
    out: dict[str, Any] = {name: plain}
    regimes = entry.get('regimes') or {}
    if not isinstance(regimes, Mapping):
        raise MaterialError("field 'regimes' must map names to fields")
    for regime, changes in regimes.items():
        if not isinstance(changes, Mapping):
            raise MaterialError(f"regime '{regime}' must map fields to values")
        out[f'{name}:{str(regime).strip().lower()}'] = {**plain, **changes}
    return out


def _parse_material(name: str, entry: Any) -> Material:
    if not isinstance(entry, Mapping):
        raise MaterialError('must be a mapping of fields to values')
    known = {f.name: f for f in fields(Material) if f.name != 'name'}
    for key in entry:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, 1)
            raise MaterialError(
                f"unknown field '{key}'" + (f"; did you mean '{near[0]}'?" if near else '')
            )
    values: dict[str, Any] = {'description': str(entry.get('description', ''))}
    for key, f in known.items():
        if 'dimension' in f.metadata and (key in entry or 'optional' not in f.metadata):
            values[key] = _parse_field(key, entry, f.metadata)
    material = Material(name=name, **values)
    _check_order(material)
    return material


def _parse_field(key: str, entry: Mapping, meta: Mapping) -> float:
    if key not in entry:
        raise MaterialError(f"field '{key}' is missing")
    try:
        value = parse_quantity(entry[key], meta['dimension'])
    except MaterialError as e:
        raise MaterialError(f"field '{key}': {e}") from None
    if not meta['low'] <= value <= meta['high']:
        limits = f'{meta["low"]:g} .. {meta["high"]:g}'
        raise MaterialError(f"field '{key}' is {entry[key]} = {value:g} (SI), outside {limits}")
    return value


def _check_order(m: Material) -> None:
    """Limits must be in order and the default regime must lie inside them."""
    rising = (
        ('speed_min', 'speed', 'speed_max'),
        ('voltage_min', 'voltage', 'voltage_max'),
        ('feed_min', 'wire_feed', 'feed_max'),
        ('kt_start', 'kt_end'),
    )
    for names in rising:
        values = [getattr(m, n) for n in names]
        if values != sorted(values):
            text = ' <= '.join(f'{n} ({v:g})' for n, v in zip(names, values, strict=True))
            raise MaterialError(f'these must be in order (SI): {text}')
