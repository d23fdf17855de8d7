"""The parts of the demo: a crusher jaw segment, nominal and worn. Writes binary STL (mm).

python3 -m waam_bringup.parts FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from waam_node.stl import block, write_stl

LENGTH, WIDTH, HEIGHT = 90.0, 56.0, 24.0  # mm
DEPTH = 12.5  # mm, of the worn trough


def worn_top(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (mm) of the worn top: a trough with soft flanks and the furrows that rock leaves; the rim is intact."""
    u = np.abs((x - LENGTH / 2) / (0.40 * LENGTH))
    v = np.abs((y - WIDTH / 2) / (0.38 * WIDTH))
    radius = (u**4 + v**4) ** 0.25
    trough = np.clip((1.0 - radius) / 0.35, 0.0, 1.0)
    trough = trough * trough * (3 - 2 * trough)
    furrows = 0.06 * np.sin(0.35 * x + 0.5 * np.sin(0.2 * y)) + 0.05 * np.sin(0.42 * y + 1.0)
    return HEIGHT - DEPTH * trough * (0.93 + furrows)


def write_parts(folder: Path) -> tuple[Path, Path]:
    """jaw_nominal.stl and jaw_worn.stl."""
    folder.mkdir(parents=True, exist_ok=True)
    x, y = np.linspace(0, LENGTH, 46), np.linspace(0, WIDTH, 29)
    nominal, worn = folder / 'jaw_nominal.stl', folder / 'jaw_worn.stl'
    edges = np.array([0, LENGTH]), np.array([0, WIDTH])
    write_stl(nominal, block(np.full((2, 2), HEIGHT), *edges), 'jaw segment, nominal, mm')
    write_stl(worn, block(worn_top(*np.meshgrid(x, y)), x, y), 'jaw segment, worn, mm')
    return nominal, worn


if __name__ == '__main__':
    print(*write_parts(Path(sys.argv[1] if len(sys.argv) > 1 else 'parts')))
