"""Plane sections of a closed mesh: rings, polygons with holes, masks on a grid."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon, make_valid, unary_union
from shapely.geometry.base import BaseGeometry

from waam_process.grid import GridSpec


def section_rings(vertices: np.ndarray, faces: np.ndarray, z: float) -> list[np.ndarray]:
    """Closed rings (n, 2) of the section at height z; metal lies to the left of each ring.

    Vertices exactly at z count as above, so every crossed face gives exactly one piece whose ends lie on two of
    its edges; pieces are joined by edge, not by position, so no tolerance is involved.
    """
    above = vertices[:, 2] >= z
    corner = above[faces]
    crossed = corner.any(axis=1) & ~corner.all(axis=1)
    faces, corner = faces[crossed], corner[crossed]
    # edge i runs from corner i to corner i + 1; the section enters where it goes down and leaves where it goes up
    after = np.roll(corner, -1, axis=1)
    up, down = np.argmax(~corner & after, axis=1), np.argmax(corner & ~after, axis=1)
    row = np.arange(len(faces))
    tails = np.stack([faces[row, down], faces[row, (down + 1) % 3]], axis=1)
    heads = np.stack([faces[row, up], faces[row, (up + 1) % 3]], axis=1)
    edges, inverse = np.unique(
        np.sort(np.concatenate([tails, heads]), axis=1), axis=0, return_inverse=True
    )
    a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
    t = ((z - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None]
    points = (a + t * (b - a))[:, :2]
    inverse = inverse.ravel()
    follows = dict(zip(inverse[: len(faces)].tolist(), inverse[len(faces) :].tolist(), strict=True))
    return [points[ring] for ring in _rings(follows)]


def _rings(follows: dict[int, int]) -> list[list[int]]:
    """Cycles of a map from each point to the next; chains that do not close are dropped."""
    rings = []
    while follows:
        first, here = follows.popitem()
        ring = [first]
        while here != first and here in follows:
            ring.append(here)
            here = follows.pop(here)
        if here == first and len(ring) > 2:
            rings.append(ring)
    return rings


def section_polygons(vertices: np.ndarray, faces: np.ndarray, z: float) -> list[Polygon]:
    """Polygons with holes (m) of the section at z, largest first. Counter-clockwise rings add, clockwise remove."""
    polygons = []
    for ring in section_rings(vertices, faces, z):
        area = _signed_area(ring)
        if abs(area) > 1e-12:
            polygons.append((area, make_valid(Polygon(ring))))
    shape: BaseGeometry = Polygon()
    for area, polygon in sorted(polygons, key=lambda p: -abs(p[0])):
        shape = shape.union(polygon) if area > 0 else shape.difference(polygon)
    return sorted(pieces(shape), key=lambda p: -p.area)


def _signed_area(ring: np.ndarray) -> float:
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def pieces(shape: BaseGeometry) -> list[Polygon]:
    """The polygons of any geometry."""
    if isinstance(shape, Polygon):
        return [] if shape.is_empty else [shape]
    return [p for g in getattr(shape, 'geoms', []) for p in pieces(g)]


def merged(polygons: list[Polygon]) -> BaseGeometry:
    """One geometry of all polygons."""
    return unary_union(polygons) if polygons else Polygon()


def raster(polygons: list[Polygon], spec: GridSpec) -> np.ndarray:
    """Mask (rows, cols) of the cells whose centre lies in one of the polygons (even-odd rule per polygon)."""
    mask = np.zeros(spec.shape, bool)
    for polygon in polygons:
        flips = np.zeros((spec.rows, spec.cols + 1), np.int32)
        for ring in (polygon.exterior, *polygon.interiors):
            _flip(np.asarray(ring.coords)[:, :2], spec, flips)
        mask |= (np.cumsum(flips, axis=1)[:, :-1] % 2).astype(bool)
    return mask


def _flip(ring: np.ndarray, spec: GridSpec, flips: np.ndarray) -> None:
    """Adds one at the first cell right of every crossing of the ring with a row of cell centres."""
    v = (ring[:, 1] - spec.origin_y) / spec.resolution - 0.5
    u = (ring[:, 0] - spec.origin_x) / spec.resolution - 0.5
    low, high = np.minimum(v[:-1], v[1:]), np.maximum(v[:-1], v[1:])
    first = np.clip(np.ceil(low), 0, spec.rows).astype(np.int64)
    last = np.clip(np.ceil(high), 0, spec.rows).astype(np.int64)
    edge = np.repeat(np.arange(len(low)), last - first)
    start = np.cumsum(last - first) - (last - first)
    row = first[edge] + np.arange(len(edge)) - start[edge]
    at = u[edge] + (row - v[edge]) / (v[edge + 1] - v[edge]) * (u[edge + 1] - u[edge])
    col = np.clip(np.ceil(at), 0, spec.cols).astype(np.int64)
    np.add.at(flips, (row, col), 1)


def outline(mask: np.ndarray, spec: GridSpec) -> list[Polygon]:
    """Polygons (m) around the cells of a mask, their steps rounded by a cell; they stay within a cell of it."""
    edge = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(edge == 1)
    _, last = np.nonzero(edge == -1)
    x0, x1 = (spec.origin_x + spec.resolution * c for c in (first, last))
    y0 = spec.origin_y + spec.resolution * row
    runs = shapely.box(x0, y0, x1, y0 + spec.resolution)
    r = spec.resolution
    rough = shapely.union_all(runs)
    smooth = rough.buffer(r).buffer(-2 * r).buffer(r).simplify(0.75 * r)
    return sorted(pieces(smooth), key=lambda p: -p.area)
