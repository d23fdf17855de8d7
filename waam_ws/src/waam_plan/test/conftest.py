"""Shared pieces of the planning tests."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from waam_process.grid import GridSpec, HeightGrid

sys.path.insert(0, str(Path(__file__).parent))  # readers of robot programs
NOMINAL = 0.030  # m, top of the synthetic part


@pytest.fixture(scope='session')
def meshes() -> Path:
    """Folder of the recorded meshes, beside the checkout; the test is skipped where it is absent."""
    folder = Path(__file__).resolve().parents[5] / 'shared' / 'data' / 'meshes'
    if not folder.is_dir():
        pytest.skip(f'no {folder}')
    return folder


def _worn_block(depth, size=(0.060, 0.040), resolution=0.5e-3) -> tuple[HeightGrid, HeightGrid]:
    """As-found and nominal surface of a block at the work zero; depth: m or callable of X, Y (m)."""
    spec = GridSpec.covering(-0.005, -0.005, size[0] + 0.005, size[1] + 0.005, resolution)
    x, y = np.meshgrid(spec.x, spec.y)
    part = (x > 0) & (x < size[0]) & (y > 0) & (y < size[1])
    nominal = np.where(part, NOMINAL, np.nan)
    missing = depth(x, y) if callable(depth) else depth
    return HeightGrid(spec, nominal - missing), HeightGrid(spec, nominal)


@pytest.fixture(scope='session')
def worn_block():
    return _worn_block


@pytest.fixture
def box_file(tmp_path):
    """Writes a box (mm) as STL and returns its path."""

    def write(extents=(60, 40, 20), name='box.stl'):
        path = tmp_path / name
        trimesh.creation.box(extents=extents).export(path)
        return path

    return write


@pytest.fixture(scope='session')
def programs() -> Path:
    """Folder of programs that slicers have written."""
    return Path(__file__).parent / 'programs'
