"""Recorded passes on disk: NPZ files with stamps, x, z, pose_stamps and poses."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from .scan_pass import Pass, ScanError

FIELDS = ('stamps', 'x', 'z', 'pose_stamps', 'poses')


def save_pass(path: Path, p: Pass) -> None:
    """Writes the file that `load_pass` reads."""
    np.savez_compressed(path, **{name: getattr(p, name) for name in FIELDS})


def load_pass(path: Path) -> Pass:
    """Reads an NPZ file with stamps, x, z, pose_stamps and poses. ScanError names file and field."""
    try:
        with np.load(path, allow_pickle=False) as data:
            missing = [name for name in FIELDS if name not in data]
            if missing:
                raise ScanError(f'no array {", ".join(missing)} in it')
            stamps, x, z, pose_stamps, poses = (data[name] for name in FIELDS)
        kinds = {'stamps': stamps, 'pose_stamps': pose_stamps}
        for name, values in kinds.items():
            if values.dtype.kind not in 'iu' or values.ndim != 1:
                raise ScanError(f'{name} must be a row of integers (ns)')
        return Pass(
            stamps.astype(np.int64),
            x.astype(float),
            z.astype(float),
            pose_stamps.astype(np.int64),
            poses.astype(float),
            Path(path).stem,
        )
    except FileNotFoundError:
        raise ScanError(f'{path}: no such file') from None
    except ScanError as e:
        raise ScanError(f'{path}: {e}') from None
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, AttributeError, TypeError) as e:
        raise ScanError(f'{path}: not a recorded pass: {e}') from None
