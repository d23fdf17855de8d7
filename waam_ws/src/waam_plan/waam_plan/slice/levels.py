"""Heights of the layers of a build: equal ones, or adapted to the slope of the surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_plan.settings import MAX_LAYER_RATIO, PlanSettings

ADAPTIVE_MIN = 0.6  # thinnest adaptive layer over layer_height

# faces whose normal is nearer to z bound a layer, they do not step
FLAT = math.cos(math.radians(5.0))
FINE = 0.05e-3  # m, heights at which the slope is looked at


@dataclass(frozen=True)
class Level:
    """One layer between z and z + thickness, m above the bottom of the part."""

    z: float
    thickness: float

    @property
    def top(self) -> float:
        """m above the bottom of the part."""
        return self.z + self.thickness


def equal_levels(height: float, settings: PlanSettings) -> list[Level]:
    """As many equal layers as come nearest to settings.layer_height."""
    n = max(1, round(height / settings.layer_height))
    return [Level(i * height / n, height / n) for i in range(n)]


def adaptive_levels(triangles: np.ndarray, settings: PlanSettings) -> list[Level]:
    """Layers whose steps on slanting faces stay below settings.cusp; triangles: (n, 3, 3) m, lowest z = 0.

    A step on a face with normal n stands thickness * |n_z| off the surface (Dolenc and Maekelae 1994).
    Between `adaptive_min` and `max_layer_ratio` of layer_height; horizontal faces end a layer.
    """
    steep, flats = _slopes(triangles)
    height = float(triangles[..., 2].max())
    low = ADAPTIVE_MIN * settings.layer_height
    high = MAX_LAYER_RATIO * settings.layer_height
    ends = np.unique(np.append(np.round(flats[(flats > low) & (flats < height - low)], 6), height))
    out: list[Level] = []
    z = 0.0
    for end in ends:
        if end - z < low:
            continue
        wanted = _march(z, float(end), steep, low, high, settings.cusp)
        scale = (end - z) / sum(wanted)
        for thickness in wanted:
            out.append(Level(z, thickness * scale))
            z += thickness * scale
    return out


def _slopes(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(height / FINE + 1,) largest |n_z| of the slanting faces per slice, and the z of horizontal faces."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    up = np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    z0, z1 = triangles[..., 2].min(axis=1), triangles[..., 2].max(axis=1)
    steep = np.zeros(int(math.ceil(z1.max() / FINE)) + 1)
    slanting = (up < FLAT) & (z1 > z0)
    first = (z0[slanting] / FINE).astype(int)
    last = (z1[slanting] / FINE).astype(int)
    for a, b, s in zip(first, last, up[slanting], strict=True):
        np.maximum(steep[a : b + 1], s, out=steep[a : b + 1])
    return steep, z1[up >= FLAT]


def _march(
    z: float, end: float, steep: np.ndarray, low: float, high: float, cusp: float
) -> list[float]:
    """Thicknesses from z upwards; together at least end - z."""
    out = []
    while end - z > 1e-9:
        thickness = high
        for _ in range(3):  # the slope within the layer depends on its thickness
            within = steep[int(z / FINE) : int((z + thickness) / FINE) + 1]
            thickness = min(thickness, max(low, cusp / max(float(within.max(initial=0)), 1e-9)))
        out.append(min(thickness, max(end - z, low)))
        z += out[-1]
    return out
