"""A small job: a worn block of 40 x 30 mm, two layers at most."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest


def _stl():
    file = Path(__file__).parents[2] / 'waam_bringup' / 'waam_bringup' / 'parts.py'
    spec = importlib.util.spec_from_file_location('demo_parts', file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='session')
def parts(tmp_path_factory) -> tuple[Path, Path]:
    """Nominal block (40 x 30 x 10 mm) and the same with a worn trough of 3.5 mm."""
    stl, folder = _stl(), tmp_path_factory.mktemp('parts')
    x, y = np.linspace(0, 40, 21), np.linspace(0, 30, 16)
    gx, gy = np.meshgrid(x, y)
    dip = 3.5 * np.clip(1.4 - np.hypot((gx - 20) / 14, (gy - 15) / 10), 0, 0.9) / 0.9
    nominal, worn = folder / 'nominal.stl', folder / 'worn.stl'
    stl.write_stl(nominal, stl.block(np.full((2, 2), 10.0), x[[0, -1]], y[[0, -1]]), 'nominal')
    stl.write_stl(worn, stl.block(10 - dip, x, y), 'worn')
    return nominal, worn
