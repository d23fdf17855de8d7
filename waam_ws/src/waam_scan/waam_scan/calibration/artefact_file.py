"""Description of an artefact in YAML, see `waam scan calibrate --help`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from .artefact import Artefact, ArtefactError, Balls, Block


def load_artefact(path: Path) -> Artefact:
    """Reads the YAML file that `waam scan calibrate --help` describes. ArtefactError names file and field."""
    try:
        data = yaml.safe_load(Path(path).read_text())
    except FileNotFoundError:
        raise ArtefactError(f'{path}: no such file') from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as e:
        raise ArtefactError(f'{path}: cannot be read: {e}') from None
    try:
        return artefact_of(data, Path(path).stem)
    except ArtefactError as e:
        raise ArtefactError(f'{path}: {e}') from None


COMMON = {
    'kind', 'name', 'position_mm', 'position_sigma_mm', 'yaw_deg', 'yaw_sigma_deg', 'tilt_sigma_deg', 'table',
}  # fmt: skip
KINDS = {'block': {'top_mm', 'height_mm', 'slope_deg'}, 'spheres': {'spheres'}}


def artefact_of(data: object, name: str = 'artefact') -> Artefact:
    """From the contents of the file."""
    if not isinstance(data, dict) or data.get('kind') not in KINDS:
        raise ArtefactError(f'kind must be one of {", ".join(KINDS)}')
    unknown = set(map(str, data)) - COMMON - KINDS[data['kind']]
    if unknown:
        raise ArtefactError(f'unknown field {", ".join(sorted(unknown))}')
    table = data.get('table', 'ignored')
    if table not in ('ignored', 'used'):
        raise ArtefactError(f"table must be 'ignored' or 'used', not {table!r}")
    return Artefact(
        body=_block(data) if data['kind'] == 'block' else _balls(data),
        position=_numbers(data, 'position_mm', 3) * 1e-3,
        position_sigma=_numbers(data, 'position_sigma_mm', 3, 0.01, low=0.0) * 1e-3,
        yaw=float(np.radians(_numbers(data, 'yaw_deg', 1, 0.0)[0])),
        yaw_sigma=float(np.radians(_numbers(data, 'yaw_sigma_deg', 1, 0.01, low=0.0)[0])),
        tilt_sigma=float(np.radians(_numbers(data, 'tilt_sigma_deg', 1, 0.01, low=0.0)[0])),
        use_table=table == 'used',
        name=str(data.get('name', name)),
    )


def _block(data: dict) -> Block:
    top = _numbers(data, 'top_mm', 2, low=1.0, high=500.0) * 1e-3
    height = _numbers(data, 'height_mm', 1, low=2.0, high=200.0)[0] * 1e-3
    slopes = np.radians(_numbers(data, 'slope_deg', 2, 45.0, low=5.0, high=85.0))
    return Block.of(tuple(top), float(height), tuple(slopes))


def _balls(data: dict) -> Balls:
    balls = data.get('spheres')
    if not isinstance(balls, list) or not balls or not all(isinstance(b, dict) for b in balls):
        raise ArtefactError('spheres must be a list of {center_mm: [x, y, z], radius_mm: r}')
    centers = np.array([_numbers(b, 'center_mm', 3) for b in balls]) * 1e-3
    radii = np.array([_numbers(b, 'radius_mm', 1, low=1.0, high=100.0)[0] for b in balls]) * 1e-3
    return Balls(centers, radii)


def _numbers(
    data: dict,
    name: str,
    count: int,
    default: float | None = None,
    low: float = -np.inf,
    high: float = np.inf,
) -> np.ndarray:
    """(count,) numbers of a field; one number stands for all of them."""
    value = data.get(name, default)
    if value is None:
        raise ArtefactError(f'{name} is missing')
    try:
        numbers = np.array(value, float).ravel()
    except (TypeError, ValueError):
        raise ArtefactError(f'{name} must be {count} numbers, not {value!r}') from None
    if numbers.size == 1 and name != 'position_mm':
        numbers = np.repeat(numbers, count)
    if numbers.size != count or np.isnan(numbers).any():
        raise ArtefactError(f'{name} must be {count} numbers, not {value!r}')
    if 'sigma' not in name and not np.isfinite(numbers).all():
        raise ArtefactError(f'{name} must be finite, not {value!r}')
    if (numbers < low).any() or (numbers > high).any():
        raise ArtefactError(f'{name} is {value!r}, must be within {low:g} .. {high:g}')
    return numbers
