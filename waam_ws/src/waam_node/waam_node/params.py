"""Parameters of a node, declared once as a frozen dataclass: default, unit, limits and description in one place.

    @dataclass(frozen=True)
    class FusionParams:
        cell: float = param(0.5e-3, 'edge of a map cell', 'm', minimum=5e-5, maximum=5e-3)

`load(node, FusionParams)` declares them with ROS descriptors, refuses what is unknown or out of range by name, and
returns the filled dataclass. `markdown(FusionParams)` writes the table of the README. No rclpy here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

ALWAYS_ALLOWED = ('use_sim_time', 'start_type_description_service')
# how parameters of older versions begin -> why they are gone
GONE = {
    name: 'layers are not corrected any more while they are laid'
    for name in ('in_layer', 'in_process_', 'arclight_')
} | {
    name: 'nobody had reason to change it, so its value stands in the code'
    for name in (
        'heartbeat_period', 'tick_period', 'resend_timeout', 'resend_warning', 'wire_jog_speed', 'csv_rate',
        'sample_period', 'history', 'clock_period', 'metal_cell', 'arc_contact_min', 'scanner_range_near',
        'scanner_range_far', 'part_moved_tilt', 'part_moved_step_x', 'gantry_y_', 'max_waiting',
        'spike_factor', 'max_coverage_loss', 'quiet_time', 'finish_timeout', 'metal_no_gas_loss',
        'metal_overhang_share', 'metal_film_remelt', 'arc_strike_m', 'scanner_offset_', 'scanner_fan',
        'scanner_points', 'scanner_rate', 'horizon', 'period', 'point_step', 'identity', 'require_controller',
        'identify_timeout', 'silence_timeout', 'reconnect_period', 'queue_size', 'dwell_max', 'process_timeout',
        'poll_period', 'discovery_period', 'metadata_period', 'split_time', 'close_timeout', 'memory_mb',
        'variation_efficiency_per_layer', 'delivered_current_offset',
    )
} | {'window': 'it follows from `baud`'}  # fmt: skip


class ParameterError(ValueError):
    """A parameter that is unknown, of the wrong type or out of range; the text names node, parameter and limit."""


def param(
    default: Any,
    description: str,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple | None = None,
    changeable: bool = False,
    gone: dict[str, str] | None = None,
) -> Any:
    """A dataclass field with what a parameter needs. Lists are given as tuples or lists. changeable: while the node
    runs, if the node takes the new value (`WaamNode.on_change`); the others are read-only. gone: choices of former
    versions, each with what to write in its place."""
    meta = {
        'description': description,
        'unit': unit,
        'minimum': minimum,
        'maximum': maximum,
        'choices': choices,
        'changeable': changeable,
        'gone': gone or {},
    }
    if isinstance(default, list | tuple):
        frozen = tuple(default)
        return dataclasses.field(default=frozen, metadata=meta)
    return dataclasses.field(default=default, metadata=meta)


def check_value(name: str, value: Any, field: dataclasses.Field) -> Any:
    """The value in the type of the field's default, or ParameterError."""
    default, meta = field.default, field.metadata
    if isinstance(default, tuple):
        return tuple(value)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(default):
        raise ParameterError(
            f"parameter '{name}' must be of type {type(default).__name__}, "
            f'not {type(value).__name__} ({value!r})'
        )
    if isinstance(value, float) and math.isnan(value) and not math.isnan(default):  # type: ignore[arg-type]
        raise ParameterError(f"parameter '{name}' is not a number")
    low, high = meta.get('minimum'), meta.get('maximum')
    unit = f' {meta["unit"]}' if meta.get('unit') else ''
    if low is not None and value < low:
        raise ParameterError(f"parameter '{name}' is {value}{unit}, below its limit {low}{unit}")
    if high is not None and value > high:
        raise ParameterError(f"parameter '{name}' is {value}{unit}, above its limit {high}{unit}")
    choices = meta.get('choices')
    if value in (gone := meta.get('gone', {})):
        raise ParameterError(f"parameter '{name}': {value!r} is gone, write {gone[value]!r}")
    if choices and value not in choices:
        raise ParameterError(
            f"parameter '{name}' is {value!r}, must be one of {', '.join(choices)}"
        )
    return value


def from_dict(cls: type, values: dict[str, Any], node_name: str = '') -> Any:
    """The dataclass filled from a dictionary; refuses unknown keys by name, with the nearest known one."""
    known = {f.name: f for f in dataclasses.fields(cls)}
    where = f'{node_name}: ' if node_name else ''
    for name in values:
        if (
            name not in known
            and name not in ALWAYS_ALLOWED
            and not name.startswith('qos_overrides.')
        ):
            raise ParameterError(f"{where}unknown parameter '{name}'{hint(name, known)}")
    try:
        filled = {n: check_value(n, values[n], f) for n, f in known.items() if n in values}
    except ParameterError as e:
        raise ParameterError(f'{where}{e}') from None
    return cls(**filled)


def hint(name: str, known: Iterable[str]) -> str:
    """What to write in the place of a name that is not known: none where it is gone, or the nearest known one."""
    for begin, why in GONE.items():
        if name.startswith(begin):
            return f'; it is gone, {why}: leave it out (docs/upgrading.md)'
    import difflib

    names = list(known)
    near = difflib.get_close_matches(name, names, 1)
    return f"; did you mean '{near[0]}'?" if near else f'; known are {", ".join(names)}'


def markdown(cls: type) -> str:
    """The parameter table of a README."""
    rows = ['| parameter | default | unit | limits | meaning |', '|---|---|---|---|---|']
    for f in dataclasses.fields(cls):
        m = f.metadata
        low, high = m.get('minimum'), m.get('maximum')
        limits = ', '.join(m['choices']) if m.get('choices') else ''
        if low is not None or high is not None:
            limits = f'{"" if low is None else low} … {"" if high is None else high}'
        default = list(f.default) if isinstance(f.default, tuple) else f.default
        rows.append(
            f'| `{f.name}` | `{default}` | {m.get("unit", "")} | {limits} | {m["description"]} |'
        )
    return '\n'.join(rows)
