"""Maps and paths as small messages for the page: whole micrometres, thinned to what a screen can show. No ROS."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from waam_process.grid import GridSpec

MAX_PICTURE_CELLS = 220  # cells along one side
UNKNOWN = -32768
STRIP_POINTS = 20_000


def encode_map(
    spec: GridSpec, z: np.ndarray, low: float, high: float, scale: float = 1e6
) -> dict[str, Any]:
    """A map (rows, cols) as base64 of int16 little-endian in 1/scale of its unit; UNKNOWN where NaN.

    low, high: ends of the colour scale, same unit as z. Large maps are thinned (every n-th cell).
    """
    step = max(1, int(np.ceil(max(z.shape) / MAX_PICTURE_CELLS)))
    thin = z[::step, ::step]
    known = np.isfinite(thin)
    values = np.where(known, np.clip(np.nan_to_num(thin) * scale, -32767, 32767), UNKNOWN)
    data = np.rint(values).astype('<i2').tobytes()
    return {
        'rows': thin.shape[0],
        'cols': thin.shape[1],
        'cell': spec.resolution * step,
        'x': spec.origin_x,
        'y': spec.origin_y,
        'scale': scale,
        'low': low,
        'high': high,
        'data': base64.b64encode(data).decode(),
    }


def height_map(spec: GridSpec, z: np.ndarray) -> dict[str, Any]:
    """Heights z (rows, cols) m, NaN = unknown; the colours go from the 1st to the 99th percentile."""
    known = z[np.isfinite(z)]
    low, high = (float(v) for v in np.percentile(known, [1, 99])) if known.size else (0.0, 1e-3)
    return encode_map(spec, z, low, max(high, low + 1e-4))


def paths(kinds: np.ndarray, start: np.ndarray, end: np.ndarray) -> dict[str, Any]:
    """Segments (n,) bool arc, (n, 3), (n, 3) m as strips: consecutive segments with and without arc; mm, 2 digits."""
    strips: list[dict[str, Any]] = []
    count = min(len(kinds), STRIP_POINTS)
    for arc, a, b in zip(kinds[:count], start[:count], end[:count], strict=True):
        joined = (
            strips
            and strips[-1]['arc'] == bool(arc)
            and np.allclose(strips[-1]['last'], a, atol=1e-6)
        )
        if not joined:
            strips.append({'arc': bool(arc), 'points': _mm(a), 'last': a})
        strips[-1]['points'] += _mm(b)
        strips[-1]['last'] = b
    return {'strips': [{'arc': s['arc'], 'points': s['points']} for s in strips]}


def _mm(point: np.ndarray) -> list[float]:
    return [round(float(v) * 1e3, 2) for v in point]
