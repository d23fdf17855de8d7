"""A small job: a worn block of 40 x 30 mm, two layers at most."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waam_node.stl import write_worn_block


@pytest.fixture(scope='session')
def parts(tmp_path_factory) -> tuple[Path, Path]:
    """Nominal block (40 x 30 x 10 mm) and the same with a worn trough of 3.5 mm."""
    x, y = np.linspace(0, 40, 21), np.linspace(0, 30, 16)
    gx, gy = np.meshgrid(x, y)
    dip = 3.5 * np.clip(1.4 - np.hypot((gx - 20) / 14, (gy - 15) / 10), 0, 0.9) / 0.9
    return write_worn_block(tmp_path_factory.mktemp('parts'), x, y, 10.0, dip)
