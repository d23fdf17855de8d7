"""Calibrations on disk: readable YAML, with a hash so that accidental edits are noticed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import yaml

from waam_process.safe_files import FileError, Missing, read_yaml

from ..transform import Mounting
from .solve import PARAMETERS, Calibration

VERSION = 1
UNITS = {'x': 'm', 'y': 'm', 'z': 'm', 'rx': 'rad', 'ry': 'rad', 'rz': 'rad', 'delay': 's'}


class CalibrationFileError(ValueError):
    """A calibration file that cannot be trusted; the text names file and fault."""


@dataclass(frozen=True)
class StoredCalibration:
    """A calibration as it was written."""

    mounting: Mounting  # what scan_fusion uses
    mount_xyz: tuple[float, ...]
    mount_rpy: tuple[float, ...]
    profile_delay: float
    sigma: np.ndarray  # (7,) m, rad, s
    date: str
    artefact: str
    hash: str  # sha256 of everything else in the file


def rpy_of(rotation: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch, yaw (rad, fixed axes) of a (3, 3) rotation; the inverse of `transform.rotation_rpy`."""
    pitch = float(np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0)))
    if abs(rotation[2, 0]) > 1 - 1e-12:  # looking along x: only roll - yaw or roll + yaw is defined
        return 0.0, pitch, float(np.arctan2(-rotation[0, 1], rotation[1, 1]))
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return roll, pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def content(result: Calibration, artefact: str, scans: list[str], date: datetime) -> dict:
    """What the file says, without the hash."""
    m = result.mounting
    sigma = dict(zip(PARAMETERS, result.sigma, strict=True))
    return {
        'waam_calibration': VERSION,
        'date': date.astimezone(UTC).isoformat(timespec='seconds'),
        'artefact': artefact,
        'scans': scans,
        'mount_xyz': [float(v) for v in m.offset],
        'mount_rpy': [float(v) for v in rpy_of(m.rotation)],
        'profile_delay': float(m.delay),
        'standard_uncertainty': {f'{k}_{UNITS[k]}': float(v) for k, v in sigma.items()},
        'covariance': [[float(v) for v in row] for row in result.covariance],
        'unobserved': result.unobserved,
        'noise_m': result.noise,
        'points_used': result.used,
        'profiles_without_pose': result.rejected_profiles,
        'mean_residual_m': {
            'faces': {k: {'mean': v[0], 'points': v[1]} for k, v in result.faces.items()},
            'passes': {k: v for k, v in result.passes.items() if np.isfinite(v)},
        },
    }


def digest(data: dict) -> str:
    """sha256 of the content, independent of order and layout of the file."""
    text = json.dumps({k: v for k, v in data.items() if k != 'sha256'}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def save_calibration(
    path: Path, result: Calibration, artefact: str, scans: list[str], date: datetime | None = None
) -> dict:
    """Writes the file and returns its content."""
    data = content(result, artefact, scans, date or datetime.now(UTC))
    data['sha256'] = digest(data)
    text = '# Scanner on the torch: made by `waam scan calibrate`, read by scan_fusion (calibration_file).\n'
    Path(path).write_text(text + yaml.safe_dump(data, sort_keys=False, allow_unicode=True))
    return data


def load_calibration(path: Path) -> StoredCalibration:
    """Reads and checks a file. CalibrationFileError when it is none, was changed, or does not observe the pose."""
    try:
        data = read_yaml(Path(path))
    except Missing:
        raise CalibrationFileError(f'{path}: no such file') from None
    except FileError as e:
        raise CalibrationFileError(str(e)) from None
    if not isinstance(data, dict) or data.get('waam_calibration') != VERSION:
        raise CalibrationFileError(f'{path}: not a calibration file of version {VERSION}')
    if data.get('sha256') != digest(data):
        raise CalibrationFileError(
            f'{path}: was changed by hand (its hash does not fit); calibrate again'
        )
    try:
        xyz = tuple(float(v) for v in data['mount_xyz'])
        rpy = tuple(float(v) for v in data['mount_rpy'])
        delay = float(data['profile_delay'])
        sigma = np.array(
            [float(data['standard_uncertainty'][f'{k}_{UNITS[k]}']) for k in PARAMETERS]
        )
        return StoredCalibration(
            mounting=Mounting.from_rpy(xyz, rpy, delay),
            mount_xyz=xyz,
            mount_rpy=rpy,
            profile_delay=delay,
            sigma=sigma,
            date=str(data['date']),
            artefact=str(data['artefact']),
            hash=str(data['sha256']),
        )
    except (KeyError, TypeError, ValueError) as e:
        raise CalibrationFileError(f'{path}: field missing or wrong: {e}') from None
