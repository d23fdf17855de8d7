"""Keeps the table of the simulated cell beyond its process: metal that was laid stays, as on a real one.

The surface is a memory-mapped file. The operating system keeps what was written even when the process is killed.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from waam_process.grid import GridSpec, HeightGrid


def keep(surface: HeightGrid, path: Path, shaft: tuple[float, ...] = ()) -> np.ndarray:
    """A (rows, cols) array with the heights (m) of `surface` that lives in `path`; the geometry goes beside it, with
    the nominal diameter of a shaft in a chuck and z of its surface (m)."""
    _geometry(path).unlink(missing_ok=True)  # the pair is valid only while the geometry is there
    kept = np.lib.format.open_memmap(path, mode='w+', dtype=np.float64, shape=surface.z.shape)
    kept[:] = surface.z
    kept.flush()
    s = surface.spec
    data = [s.origin_x, s.origin_y, s.resolution, s.rows, s.cols, *shaft]
    _geometry(path).write_text(json.dumps(data))
    return np.asarray(kept)


def restore(path: Path) -> HeightGrid | None:
    """The surface when the cell ended; None when nothing usable was kept."""
    try:
        x, y, resolution, rows, cols = json.loads(_geometry(path).read_text())[:5]
        z = np.load(path)
        spec = GridSpec(x, y, resolution, rows, cols)
    except (OSError, ValueError, TypeError, EOFError):
        return None
    if z.shape != spec.shape or not np.isfinite(z).all():
        return None
    return HeightGrid(spec, z)


def kept_shaft(path: Path) -> tuple[float, float] | None:
    """m, nominal diameter and z of the surface of the shaft that `restore` finds; None for what lies on a table."""
    try:
        diameter, level = json.loads(_geometry(path).read_text())[5:]
        return float(diameter), float(level)
    except (OSError, ValueError, TypeError):
        return None


def _geometry(path: Path) -> Path:
    return path.with_name(path.name + '.json')
