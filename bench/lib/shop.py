"""Six kinds of restorations that a repair shop gets, as nominal and worn meshes (mm): heights over a grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

STEP = 0.5  # mm, of the grid
HEIGHT = 16.0  # mm


def _soft(d: np.ndarray, width: float) -> np.ndarray:
    """0 at and below 0, 1 from `width` on."""
    t = np.clip(d / width, 0, 1)
    return t * t * (3 - 2 * t)


def _waves(x: np.ndarray, y: np.ndarray, size: float, turn: float) -> np.ndarray:
    """Uneven wear, mm."""
    return size * (np.sin(x / 4.3 + turn) * np.cos(y / 5.1) + 0.5 * np.sin((x + 2 * y) / 7 + turn))


def pocket(x, y):
    """Worn pocket with feathered walls within a face."""
    r = np.hypot((x - 28) / 1.3, y - 20)
    return HEIGHT + 0 * x, (2.6 + _waves(x, y, 0.2, 0.3)) * _soft(13.5 - r, 4.0)


def chipped_corner(x, y):
    """A corner broken off along a slanting face."""
    d = (30 - x - 0.8 * y) / np.hypot(1, 0.8)
    return HEIGHT + 0 * x, np.clip(0.35 * d, 0, 6) + 0.8 * _soft(d, 2.5) + _waves(
        x, y, 0.15, 1
    ) * _soft(d, 3)


def worn_edge(x, y):
    """A long edge worn round, fading into the face."""
    return HEIGHT + 0 * x, (3.0 + 0.6 * np.sin(x / 12)) * _soft(14 - y, 13) + _waves(
        x, y, 0.2, 2
    ) * _soft(14 - y, 4)


def keyway(x, y):
    """A keyway to be filled, its edges broken."""
    d = 5.0 - np.abs(y - 20)
    d = np.minimum(d, np.minimum(x - 9, 47 - x))
    return HEIGHT + 0 * x, 4.0 * np.clip((d + 0.5) / 1.0, 0, 1) + 0.8 * _soft(d + 2.2, 2.2)


def pad_on_slope(x, y):
    """A raised pad on a face that slopes by ten degrees; its top is worn."""
    base = 8 + np.tan(np.radians(10)) * x
    pad = (np.abs(x - 28) <= 15) & (np.abs(y - 20) <= 11)
    return base + 6.0 * pad, np.where(pad, 2.4 + 0.03 * (x - 28) + _waves(x, y, 0.25, 3), 0)


def tooth_flank(x, y):
    """The flank of a coarse tooth, lying up: curved across, worn most at the tip, with a root."""
    nominal = HEIGHT - (y - 30) ** 2 / 95 * (y < 30) + 4.0 * _soft(y - 34, 4)
    wear = (1.6 + 0.06 * (24 - y)) * _soft(27 - y, 6) + _waves(x, y, 0.15, 4) * _soft(26 - y, 4)
    return nominal, wear


KINDS = {
    f.__name__: f for f in (pocket, chipped_corner, worn_edge, keyway, pad_on_slope, tooth_flank)
}


def write(folder: Path, kind: str) -> tuple[Path, Path]:
    """Nominal and worn part as STL."""
    from waam_lab.parts import body

    x, y = (np.arange(0, end + STEP / 2, STEP) for end in (56, 40))
    plan = np.stack(np.meshgrid(x, y, indexing='ij'), axis=2)
    nominal, wear = KINDS[kind](plan[..., 0], plan[..., 1])
    kept = np.ones((len(x) - 1, len(y) - 1), bool)
    paths = tuple(folder / f'{kind}_{name}.stl' for name in ('nominal', 'worn'))
    for path, top in zip(paths, (nominal, nominal - np.maximum(wear, 0)), strict=True):
        body(plan, kept, top).export(path)
    return paths
