"""Compiled loops over the pieces of a layer's beads and the cells that their metal touches.

Lengths in cells of the grid a quarter of a bead wide, unless said otherwise. A piece lies at (row, col), measured from
the corner of cell (0, 0); the middle of cell (i, j) is at (i + 0.5, j + 0.5).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def shares(place, tangent, step, rows, cols, reach, along, across, tiny):
    """What every piece gives to the cells around it: an anisotropic Gaussian, normed over the piece's surroundings.

    place (n, 2): row and column; tangent (n, 2): unit vectors of travel, x and y; step (n,): metal of a piece; along,
    across: sigma; tiny: share of a piece's metal that is left out. Returns metal and cell number of every entry, piece
    after piece, and the number (n + 1,) of the first entry of every piece.
    """
    n, side = len(step), 2 * reach + 1
    metal = np.empty(n * side * side)
    cell = np.empty(n * side * side, np.int64)
    first = np.zeros(n + 1, np.int64)
    weight = np.empty((side, side))
    long, wide = -0.5 / along**2, -0.5 / across**2
    used = 0
    for p in range(n):
        top, left = int(math.floor(place[p, 0])) - reach, int(math.floor(place[p, 1])) - reach
        total = 0.0
        for i in range(side):
            for j in range(side):
                weight[i, j] = 0.0
                if (i - reach) ** 2 + (j - reach) ** 2 > (reach + 0.5) ** 2:
                    continue
                y, x = top + i + 0.5 - place[p, 0], left + j + 0.5 - place[p, 1]
                u = x * tangent[p, 0] + y * tangent[p, 1]
                v = x * tangent[p, 1] - y * tangent[p, 0]
                weight[i, j] = math.exp(u * u * long + v * v * wide)
                total += weight[i, j]
        for i in range(side):
            for j in range(side):
                row, col = top + i, left + j
                if weight[i, j] > tiny * total and 0 <= row < rows and 0 <= col < cols:
                    metal[used] = weight[i, j] * (step[p] / total)
                    cell[used] = row * cols + col
                    used += 1
        first[p + 1] = used
    return metal[:used], cell[:used], first


@njit(cache=True)
def neighbours(place, step, run, nearest, reach, narrow, wide, apart, fade):
    """(4, rows, cols) metal around every cell: all, by a Gaussian of sigma `narrow`; by one of sigma `wide` that of
    passes beside which were laid before; after; and of all passes beside, fading with the travel between.

    place (n, 2): row and column; step (n,): metal of a piece; run (n,): travel at a piece, in the unit of `apart`, the
    travel from which on metal belongs to another pass, and of `fade`; nearest (rows, cols): piece of every cell; reach:
    distance beyond which metal counts no more.
    """
    rows, cols = nearest.shape
    out = np.zeros((4, rows, cols))
    near, far, most = -0.5 / narrow**2, -0.5 / wide**2, int(math.ceil(reach)) + 1
    side = 2 * most + 1
    along = np.empty(
        (2, 2, side)
    )  # (narrow or wide, row or column, offset): the Gaussians' factors
    for p in range(len(step)):
        top, left = int(math.floor(place[p, 0])) - most, int(math.floor(place[p, 1])) - most
        for k in range(side):
            y, x = top + k + 0.5 - place[p, 0], left + k + 0.5 - place[p, 1]
            along[0, 0, k], along[0, 1, k] = math.exp(y * y * near), math.exp(x * x * near)
            along[1, 0, k], along[1, 1, k] = math.exp(y * y * far), math.exp(x * x * far)
        for row in range(max(top, 0), min(top + side, rows)):
            y = row + 0.5 - place[p, 0]
            for col in range(max(left, 0), min(left + side, cols)):
                x = col + 0.5 - place[p, 1]
                if x * x + y * y >= reach * reach:
                    continue
                i, j = row - top, col - left
                out[0, row, col] += step[p] * along[0, 0, i] * along[0, 1, j]
                later = run[p] - run[nearest[row, col]]
                if abs(later) <= apart:
                    continue
                beside = step[p] * along[1, 0, i] * along[1, 1, j]
                out[1 if later < 0 else 2, row, col] += beside
                out[3, row, col] += beside * math.exp(-abs(later) / fade)
    return out


@njit(cache=True)
def curvature(metal, segment, first, weight, segments):
    """Of A'WA, A (cells, segments) in rows: diagonal and sums of the rows, (segments,) each.

    metal, segment: values and columns of the entries of A; first (cells + 1,): number of the first entry of every cell;
    weight (cells,): diagonal of W.
    """
    diagonal, total = np.zeros(segments), np.zeros(segments)
    for i in range(len(weight)):
        row = 0.0
        for k in range(first[i], first[i + 1]):
            row += metal[k]
        for k in range(first[i], first[i + 1]):
            pull = weight[i] * metal[k]
            diagonal[segment[k]] += pull * metal[k]
            total[segment[k]] += pull * row
    return diagonal, total


@njit(cache=True, fastmath={'contract', 'reassoc'})
def gradient(metal, segment, first, weight, need, x):
    """A'W(A*x - need) (segments,), in one pass over A; metal, segment, first, weight: as of `curvature`; need (cells,),
    x (segments,). segment and first without a sign: then no index has to be tested for counting from the end."""
    out = np.zeros(len(x))
    for i in range(len(weight)):
        if weight[i] == 0.0:
            continue
        surplus = -need[i]
        for k in range(first[i], first[i + 1]):
            surplus += metal[k] * x[segment[k]]
        surplus *= weight[i]
        for k in range(first[i], first[i + 1]):
            out[segment[k]] += metal[k] * surplus
    return out


def warm_up() -> None:
    """Compiles all of them for the arrays that the package passes."""
    place, step = np.ones((2, 2)), np.ones(2)
    cells = np.zeros(2, np.uint32), np.arange(3, dtype=np.uint32)
    curvature(step, *cells, step, 1)
    gradient(step, *cells, step, step, step[:1])
    shares(
        place=place, tangent=place, step=step, rows=3, cols=3, reach=1, along=1.0, across=1.0, tiny=0.0,
    )  # fmt: skip
    neighbours(
        place=place, step=step, run=step, nearest=np.zeros((3, 3), np.int64), reach=1.0, narrow=1.0, wide=1.0,
        apart=1.0, fade=1.0,
    )  # fmt: skip
