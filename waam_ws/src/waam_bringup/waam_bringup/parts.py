"""The parts of the demo: a crusher jaw segment and a die insert, nominal and worn. Writes binary STL (mm).

python3 -m waam_bringup.parts FOLDER
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from waam_node.stl import block, write_stl

LENGTH, WIDTH, HEIGHT = 90.0, 56.0, 24.0  # mm
DEPTH = 12.5  # mm, of the worn trough
DIE = 64.0, 40.0, 18.0  # mm
EDGE_WEAR, WORN_BAND = (
    2.6,
    15.0,
)  # mm: depth along the working edge, and over how much of the face it fades out


def worn_top(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (mm) of the worn top: a trough with soft flanks and the furrows that rock leaves; the rim is intact."""
    u = np.abs((x - LENGTH / 2) / (0.40 * LENGTH))
    v = np.abs((y - WIDTH / 2) / (0.38 * WIDTH))
    radius = (u**4 + v**4) ** 0.25
    trough = np.clip((1.0 - radius) / 0.35, 0.0, 1.0)
    trough = trough * trough * (3 - 2 * trough)
    furrows = 0.06 * np.sin(0.35 * x + 0.5 * np.sin(0.2 * y)) + 0.05 * np.sin(0.42 * y + 1.0)
    return HEIGHT - DEPTH * trough * (0.93 + furrows)


def worn_die_top(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (mm) of the worn top: its working edge along y = 0 is washed out, deepest at two thirds of the length, and
    a corner is chipped."""
    length, _, height = DIE
    band = np.clip(1.0 - y / WORN_BAND, 0.0, 1.0)
    ends = np.clip((x - 5.0) / 12.0, 0.0, 1.0)
    washed = EDGE_WEAR * (0.8 + 0.2 * np.sin(4.7 * x / length)) * band * ends
    chip = np.clip(1.0 - np.hypot(x - length, y) / 13.0, 0.0, 1.0)
    return height - washed * (2 - band) - 2.2 * chip * (2 - chip)


def write_parts(folder: Path) -> list[Path]:
    """jaw_nominal.stl, jaw_worn.stl, die_nominal.stl, die_worn.stl."""
    folder.mkdir(parents=True, exist_ok=True)
    jaw = _write(folder, 'jaw', (LENGTH, WIDTH, HEIGHT), worn_top)
    return [*jaw, *_write(folder, 'die', DIE, worn_die_top)]


def _write(
    folder: Path,
    name: str,
    size: tuple[float, float, float],
    worn_top: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[Path, Path]:
    """size: mm; worn_top: of x and y, mm."""
    length, width, height = size
    x, y = (np.linspace(0, end, round(end / 2) + 1) for end in (length, width))
    edges = np.array([0, length]), np.array([0, width])
    nominal, worn = folder / f'{name}_nominal.stl', folder / f'{name}_worn.stl'
    title = {'jaw': 'jaw segment', 'die': 'die insert'}[name]
    write_stl(nominal, block(np.full((2, 2), height), *edges), f'{title}, nominal, mm')
    write_stl(worn, block(worn_top(*np.meshgrid(x, y)), x, y), f'{title}, worn, mm')
    return nominal, worn


if __name__ == '__main__':
    print(*write_parts(Path(sys.argv[1] if len(sys.argv) > 1 else 'parts')))
