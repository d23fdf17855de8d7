"""The cell file of a cell on disk, checked against the limits of the nodes that get its values.

The limits stand in the parameters of the nodes; here they are said in the units of the file.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from waam_adapt.thermal.params import ThermalParams
from waam_bridge.gantry import CALIBRATED, MAX_STEP_RATE
from waam_bridge.params import BridgeParams
from waam_bridge.pyrometer import PyrometerParams, address
from waam_calibrate import results, store
from waam_job.ros.job_params import JobParams
from waam_node.params import ParameterError, from_dict
from waam_process import materials
from waam_process.cell_file import LIMIT, CellError, CellFile, parse
from waam_process.cell_keys import (
    AXES,
    BOARD,
    CHUCK,
    INSTRUMENT,
    KEYS,
    MATERIAL,
    PAIR,
    PLATE,
    PORT,
    PYROMETER,
    WORK_ZERO,
    Key,
)
from waam_process.names import TEMPERATURE_INPUTS
from waam_process.safe_files import FileError, Missing, read_text
from waam_process.unrolled import LONGEST_AXIS
from waam_scan.calibration.file import CalibrationFileError, load_calibration
from waam_scan.fusion_params import FusionParams

from . import paths

NODES: dict[str, Any] = {
    'bridge': BridgeParams, 'scan_fusion': FusionParams, 'job_sequencer': JobParams,
    'thermal_compensator': ThermalParams, 'pyrometer': PyrometerParams,
}  # fmt: skip
LEAST_TURN = 10_000  # steps: fewer are coarser than a bead is laid, and the virtual controller has no such machine
CALIBRATION = 'sensors.scanner.calibration'
MOUNTING = tuple(f'sensors.scanner.{name}' for name in ('mount_mm', 'mount_deg', 'delay_ms'))


def path_of(name: str) -> Path:
    """Of the file of the cell `name`."""
    return paths.cells_dir() / f'{name}.yaml'


def find(name: str) -> CellFile | None:
    """The checked file of a cell; None where it has none. CellError."""
    path = path_of(name)
    try:
        return load(path)
    except Missing:
        return None


def load(path: Path) -> CellFile:
    """Read and checked. CellError names everything that is wrong; Missing."""
    try:
        cell = parse(read_text(path, limit=LIMIT), shown(path))
    except Missing:
        raise
    except FileError as e:
        raise CellError(str(e)) from None
    if wrong := list(problems(cell)):
        raise CellError('\n'.join(wrong))
    return cell


def shown(path: Path) -> str:
    """As short as the user knows it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def problems(cell: CellFile) -> Iterator[str]:
    """Everything that is beyond a limit, or contradicts something else in the file."""
    beyond = {p: why for p, value in cell.values.items() if (why := _beyond(KEYS[p], value))}
    for path, why in beyond.items():
        yield f'{cell.where(path)} {why}'
    for look in (_speeds, _zero, _chuck, _material, _pyrometer, _scanner):
        yield from look(cell)
    yield from _together(cell, {node for path in beyond for node, _ in KEYS[path].parameters})


def field_of(node: str, name: str) -> dataclasses.Field[Any]:
    """The parameter's default, unit and limits."""
    return next(f for f in dataclasses.fields(NODES[node]) if f.name == name)


def _beyond(key: Key, value: Any) -> str:
    """Which limit of a node the value is beyond, '' = none."""
    if key.words:
        return ''
    values = value if isinstance(value, list) else [value]
    unit = f' {key.unit}' if key.unit else ''
    for node, name in key.parameters:
        if node not in NODES:
            continue
        meta = field_of(node, name).metadata
        low, high, choices = meta['minimum'], meta['maximum'], meta['choices']
        if choices and value not in choices:
            return f'is {value!r}, must be one of {", ".join(choices)}'
        for v in values:
            if low is not None and v * key.factor < low * (1 - 1e-9):
                return f'is {v:g}{unit}, below its limit {low / key.factor:g}{unit}'
            if high is not None and v * key.factor > high * (1 + 1e-9):
                return f'is {v:g}{unit}, above its limit {high / key.factor:g}{unit}'
    if key.kind == PAIR and values[0] > values[1]:
        return f'is {value}: the lowest comes first'
    return ''


def _speeds(cell: CellFile) -> Iterator[str]:
    for axis in 'xyz':
        path = f'{AXES}{axis}.speed_mm_s'
        speed, steps = (cell.values.get(p) for p in (path, f'{AXES}{axis}.steps_per_mm'))
        if speed and steps and speed * steps > MAX_STEP_RATE:
            yield (
                f'{cell.where(path)} is {speed:g} mm/s: with {steps:g} steps/mm {speed * steps:.0f} steps per second, '
                f'above the limit {MAX_STEP_RATE} of the controller'
            )


def _zero(cell: CellFile) -> Iterator[str]:
    """Work zero, with the plate's on it, is where the torch gets to."""
    zero = cell.values.get(WORK_ZERO)
    if zero is None:
        return
    plate = cell.values.get(PLATE, [0.0, 0.0, 0.0])
    for axis, at, more in zip('xyz', zero, plate, strict=True):
        size = cell.values.get(f'{AXES}{axis}.envelope_mm')
        for path, place in ((WORK_ZERO, at), (PLATE, at + more)):
            if size is not None and not 0 <= place < size and path in cell.values:
                yield f'{cell.where(path)} is at {axis} {place:g} mm, outside 0 .. {size:g} mm, the travel of the axis'
                break


def _chuck(cell: CellFile) -> Iterator[str]:
    """What a chuck in place of the X axis needs, and what follows from it. Only simulated ones are built."""
    steps = cell.values.get(CHUCK)
    if steps is None:
        return
    where = cell.where(CHUCK)
    if steps < LEAST_TURN:
        yield f'{where} is {steps:g}, must be at least {LEAST_TURN}'
    path, longest = f'{AXES}x.envelope_mm', LONGEST_AXIS * 1e3
    if cell.values.get(path) != longest:
        yield (
            f'{cell.where(path)} must be {longest:g} with a chuck ({where}): it has no end, the controller\'s x has'
        )
    for path, why in (
        (f'{AXES}x.steps_per_mm', 'they follow from the chuck and the diameter of each shaft'),
        (PORT, 'a chuck of a real machine is not built (docs/real_cell.md, the chuck)'),
    ):
        if path in cell.values:
            yield f'{cell.where(path)} does not go with a chuck ({where}): {why}'


def _material(cell: CellFile) -> Iterator[str]:
    known = materials.load()
    name = cell.values.get(MATERIAL)
    if name is not None and name not in known:
        yield f'{cell.where(MATERIAL)} is {name!r}, known are {", ".join(known)}'


def _pyrometer(cell: CellFile) -> Iterator[str]:
    source = cell.values.get(PYROMETER)
    wrong = INSTRUMENT if source is None or source in TEMPERATURE_INPUTS else BOARD
    if source is not None and source not in TEMPERATURE_INPUTS:
        try:
            address(source)
        except ValueError:
            yield (
                f'{cell.where(PYROMETER)} is {source!r}, wanted is {", ".join(TEMPERATURE_INPUTS)}, serial:PORT, '
                'modbus:PORT, modbus:HOST:PORT or topic:NAME'
            )
            return
    for path in cell.values:
        if not path.startswith('sensors.pyrometer.') or path == PYROMETER:
            continue
        node = KEYS[path].parameters[0][0]
        if source is None:
            yield f'{cell.where(path)} belongs to a pyrometer: {PYROMETER} is missing'
        elif node == wrong:
            place = 'at the controller' if node == BOARD else 'beside the controller'
            yield f'{cell.where(path)} belongs to an instrument {place}, the source is {source}'


def _scanner(cell: CellFile) -> Iterator[str]:
    file = cell.values.get(CALIBRATION)
    if file is None:
        return
    where = cell.where(CALIBRATION)
    for path in MOUNTING:
        if path in cell.values:
            yield f'{cell.where(path)} stands in the calibration ({where}), too: leave one of them out'
    if not Path(file).is_absolute():
        yield f'{where} is {file!r}: give the whole path, from / on'
        return
    try:
        load_calibration(Path(file))
    except CalibrationFileError as e:
        yield f'{where}: {e}'


def _together(cell: CellFile, wrong: set[str]) -> Iterator[str]:
    """What only all parameters of a node together show. wrong: nodes of which a value is beyond its own limit."""
    for node, values in cell.parameters().items():
        if node in wrong:
            continue
        told = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        try:
            from_dict(NODES[node], told)
        except ParameterError as e:
            names = re.findall(r"'(\w+)'", str(e))
            path = next((p for n in names if (p := cell.key_of(node, n))), '')
            yield f'{cell.where(path)}: {e}' if path else f'{cell.name}: {node}: {e}'


def effective(cell: CellFile, certificates: dict[str, results.Result]) -> list[tuple[str, str, str]]:  # fmt: skip
    """Key, value with its unit, where it comes from, for every key. certificates: newest calibrations by name."""
    return [(key.path, *_effective(key, cell, certificates)) for key in KEYS.values()]


def _effective(key: Key, cell: CellFile, certificates: dict[str, results.Result]) -> tuple[str, str]:  # fmt: skip
    unit = f' {key.unit}' if key.unit else ''
    value = cell.values.get(key.path)
    if key.path in MOUNTING and CALIBRATION in cell.values:
        return 'by the calibration', cell.where(CALIBRATION)
    if key.path == PORT and value is None:
        return 'none', 'without a port the cell is simulated'
    if (found := _calibrated(key, value, certificates)) is not None:
        return f'{found[0]:g}{unit}', found[1]
    if value is not None:
        line = cell.lines[key.path]
        return f'{_text(value)}{unit}', f'{cell.name}:{line}'
    default = _default(key)
    if default is None:
        return 'not known', 'as the controller has it'
    return (f'{_text(default)}{unit}' if default != '' else 'none'), _origin(key)


def _calibrated(
    key: Key, value: Any, certificates: dict[str, results.Result]
) -> tuple[float, str] | None:
    """Steps per mm that were found and that the bridge leaves alone: near enough to the nominal ones."""
    if key.name != 'steps_per_mm' or value is None:
        return None
    axis = key.section[-1]
    result = certificates.get(f'steps_{axis}')
    steps = dict(result.settings).get(f'{results.STEPS}{axis}') if result else None
    if result is None or steps is None or abs(steps / value - 1) > CALIBRATED:
        return None
    return steps, f'calibration steps_{axis} of {result.when:%Y-%m-%d %H:%M} (nominal {value:g})'


def _default(key: Key) -> Any:
    """In the unit of the file; None = the controller's own, '' = nothing."""
    if not key.parameters:
        return ''
    values = [field_of(node, name).default for node, name in key.parameters if node in NODES]
    if key.words:
        return next((word for word, number in key.words.items() if number == values[0]), None)
    if any(isinstance(v, float) and math.isnan(v) for v in values):
        return None
    found = values if len(values) > 1 else values[0]
    if isinstance(found, list | tuple):
        return [_number(v / key.factor) for v in found]
    if isinstance(found, float):
        return _number(found / key.factor)
    return found


def _number(value: float) -> float:
    return float(f'{value:.9g}')


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ', '.join(f'{v:g}' for v in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:g}' if isinstance(value, float) else str(value)


def _origin(key: Key) -> str:
    return f'default of {key.parameters[0][0]}' if key.parameters else ''


def certificates() -> tuple[dict[str, results.Result], list[str]]:
    """The newest result of every calibration of the cell that is meant, and what is wrong with files of results."""
    kept = store.load_all(paths.calibrations_dir())
    return results.newest(kept.results), kept.damaged


def stale(cell: CellFile, kept: dict[str, results.Result]) -> list[str]:
    """Calibrations that the file contradicts."""
    found = []
    for axis in 'xyz':
        path = f'{AXES}{axis}.steps_per_mm'
        nominal, result = cell.values.get(path), kept.get(f'steps_{axis}')
        steps = dict(result.settings).get(f'{results.STEPS}{axis}') if result else None
        if nominal and steps and abs(steps / nominal - 1) > CALIBRATED:
            found.append(
                f'{cell.where(path)} is {nominal:g}, the calibration found {steps:g}: more than '
                f'{100 * CALIBRATED:g} % apart, so the nominal value would be sent'
            )
    return found
