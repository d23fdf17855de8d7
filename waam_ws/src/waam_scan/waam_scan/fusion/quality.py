"""Quality of a map as a picture of the part: holes, unseen areas, walls that a height map cannot show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from .cell_kernels import MIN_SAMPLES_OF_SCATTER
from .height_map import FusedMap

# a cell on a steeper surface spans more than 2.7 times its edge in height
STEEP = math.radians(70.0)
EDGE = 6.0  # times the typical scatter: points of two levels in one cell
MINORITY = 0.15  # of the points on another level: no spikes any more, but a wall in the cell


@dataclass(frozen=True)
class MapQuality:
    """How well a map shows the part."""

    holes: int  # unseen areas with seen cells all around
    hole_area: float  # m²
    largest_hole: float  # m²
    unseen: float  # share of the grid that is no hole: beside the field of view
    # share of the known cells beside a slope above 70 degrees, which would hide an overhang
    steep: float
    edges: float  # share of the known cells with points of more than one level
    sigma: float  # m, median standard uncertainty
    points: float  # median number per known cell

    def lines(self) -> list[str]:
        """For people; areas in mm², lengths in mm."""
        return [
            f'{self.holes} holes, {self.hole_area * 1e6:.2f} mm² in all, largest {self.largest_hole * 1e6:.2f} mm²; '
            f'{self.unseen:.1%} of the grid lies outside what was seen',
            f'{self.steep:.2%} of the cells at slopes above {math.degrees(STEEP):.0f} degrees (overhangs hide '
            f'there), {self.edges:.2%} with points of two levels',
            f'median uncertainty {self.sigma * 1e3:.4f} mm from {self.points:.0f} points per cell',
        ]


def enclosed(known: np.ndarray) -> tuple[np.ndarray, int]:
    """Labels (rows, cols) of the unknown areas that do not touch the border of the grid, numbered from 1, and how many.

    Cells that touch by a corner belong to one area.
    """
    label, _ = ndimage.label(~known, np.ones((3, 3)))
    border = np.unique(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]))
    keep = np.setdiff1d(np.unique(label), np.append(border, 0))
    number = np.zeros(label.max() + 1, np.int64)
    number[keep] = np.arange(1, len(keep) + 1)
    return number[label], len(keep)


def steep_cells(z: np.ndarray, resolution: float, limit: float = STEEP) -> np.ndarray:
    """Cells (rows, cols) with a neighbour that is further up or down than a slope of `limit` (rad) allows."""
    most = math.tan(limit) * resolution
    out = np.zeros(z.shape, bool)
    for axis in (0, 1):
        far = np.abs(np.diff(z, axis=axis)) > most
        first, second = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        out[first] |= far
        out[second] |= far
    return out


def assess(fused: FusedMap) -> MapQuality:
    """Quality of a fused map."""
    known, cell = np.isfinite(fused.z), fused.spec.resolution**2
    label, holes = enclosed(known)
    areas = np.bincount(label.ravel(), minlength=holes + 1)[1:] * cell
    count = max(1, int(known.sum()))
    with np.errstate(invalid='ignore'):
        edges = fused.scatter[known] > EDGE * fused.residual
    edges |= (fused.share[known] < 1 - MINORITY) & (fused.count[known] >= MIN_SAMPLES_OF_SCATTER)
    return MapQuality(
        holes=holes,
        hole_area=float(areas.sum()),
        largest_hole=float(areas.max()) if holes else 0.0,
        unseen=float((~known).mean() - areas.sum() / (cell * known.size)),
        steep=float(steep_cells(fused.z, fused.spec.resolution)[known].sum() / count),
        edges=float(edges.sum() / count),
        sigma=float(np.median(fused.sigma[known])) if known.any() else float('nan'),
        points=float(np.median(fused.count[known])) if known.any() else 0.0,
    )
