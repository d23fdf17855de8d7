"""Map files (NPZ, docs/job_folder.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from waam_process.grid import GridError, GridSpec, HeightGrid


class FileError(ValueError):
    """A file that is missing, unreadable or not what it should be; the text names it."""


def save_map(
    path: Path,
    spec: GridSpec,
    z: np.ndarray,
    sigma: np.ndarray | None,
    count: np.ndarray,
    **more: Any,
) -> None:
    """NPZ as docs/job_folder.md has it: z, sigma (float32, m), count, origin (2,), resolution, and `more`."""
    with open(path, 'wb') as f:
        np.savez_compressed(
            f,
            z=np.asarray(z, np.float32),
            sigma=np.asarray(sigma, np.float32),
            count=count,
            origin=np.array([spec.origin_x, spec.origin_y]),
            resolution=np.array(spec.resolution),
            **more,
        )


def load_map(path: Path) -> HeightGrid:
    """A map written by `save_map` or by a job; FileError when it is none."""
    try:
        return HeightGrid.load_npz(path)
    except FileNotFoundError:
        raise FileError(f'{path}: no such file') from None
    except KeyError as e:
        raise FileError(f'{path}: not a height map: {e.args[0]}') from None
    except (GridError, ValueError, OSError, EOFError, TypeError, IndexError) as e:
        raise FileError(f'{path}: not a height map: {e}') from None
