"""How far metal stands over the sides of a part, where a machine has to take it off (machining allowance)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

# m, over what lay there before, from which on a grid cell beside the part holds metal
RISE = 0.5e-3


@dataclass(frozen=True)
class Overrun:
    """Horizontal, m. Over the grid cells along those sides of the part that metal was laid along; NaN: there are none,
    or nothing beside them was seen."""

    mean: float = math.nan
    max: float = math.nan


def overrun(
    before: np.ndarray, after: np.ndarray, part: np.ndarray, region: np.ndarray, resolution: float
) -> Overrun:
    """before, after: scans (rows, cols) m, NaN = not seen; part, region: bool, cells of the part, and those that metal
    was to be laid on; resolution: m.

    Grid cells beside the part belong to the nearest one of it; those of the region count, each with its farthest metal.
    """
    if part.all() or not part.any():
        return Overrun()
    away, (row, col) = ndimage.distance_transform_edt(~part, return_indices=True)
    beside = ~part & region[row, col]
    seen = beside & np.isfinite(after)
    if not seen.any():
        return Overrun()
    rise = after - _known(before, beside)
    owner = (row * part.shape[1] + col)[beside]
    # half a cell lies between the side and the middle of the first cell beside it
    reach = np.where(np.isfinite(rise) & (rise > RISE), away * resolution, 0.0)[beside]
    farthest = np.zeros(part.size)
    np.maximum.at(farthest, owner, reach)
    along = farthest[np.unique(owner)]
    return Overrun(float(along.mean()), float(along.max()))


def _known(z: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Heights, with unseen cells of `where` as high as the nearest seen one of it; the lowest where none was seen."""
    known = where & np.isfinite(z)
    if not known.any():
        floor = float(np.nanmin(z)) if np.isfinite(z).any() else 0.0
        return np.where(np.isfinite(z), z, floor)
    row, col = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.where(np.isfinite(z), z, z[row, col])
