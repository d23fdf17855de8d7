"""One function for users without ROS: an error map and paths in, speed factors along the paths out.
Millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from .laws.checks import safe_correct
from .laws.registry import make_law
from .types import CorrectionError, CorrectionInput


def correct(
    error_map_mm: np.ndarray,
    resolution_mm: float,
    paths: Sequence[np.ndarray],
    layer_height_mm: float | np.ndarray,
    *,
    bead_width_mm: float = 6.0,
    k_gain: float = 0.3,
    origin_mm: tuple[float, float] = (0.0, 0.0),
    direction: tuple[float, float] = (0.0, 0.0),
    height_exponent: float = -1.0,
    sigma_mm: np.ndarray | None = None,
    law: str = 'damped_inverse',
    gain: float = 0.9,
    regularisation: float = 0.1,
    model: str = '',
    temperature: float = math.nan,
) -> list[np.ndarray]:
    """Travel-speed factors V/V_prog along the paths of the next layer.

    error_map_mm: (rows, cols), measured surface minus wanted surface, mm: positive on a hump, NaN =
        unknown. Rows along +y, columns along +x; cell (0, 0) has its corner at `origin_mm` (x, y).
    resolution_mm: edge of a cell. paths: arrays (n, 2) or (n, 3) of points in mm, in the frame of
    the map. layer_height_mm: metal that the plan adds, one number or a map like the error map (0 =
    nothing). bead_width_mm, direction: width of one bead and (x, y) along the beads, (0, 0) =
    unknown. height_exponent: d ln(height)/d ln(speed) of the process, -1 over overlapped beads (all
    metal counts), about -0.3 .. -0.6 for a single-bead wall, which answers more weakly. sigma_mm:
    standard uncertainty, map. k_gain: largest change of speed, 0.3 = 70 .. 130 %. law, gain,
    regularisation, model: as of correction_server; laws 'bead_solver' and 'unet' also use the
    paths (every array one bead, from arc on to arc off), 'unet' the temperature, degC of the layer below.

    Returns one array (n,) per path: below 1 over a hollow (slower, more metal), above 1 over a
    hump, 1 where nothing is known or outside the map. CorrectionError (a ValueError) names the
    argument that cannot be used.
    """
    error = np.asarray(error_map_mm, float)
    if error.ndim != 2 or not error.size:
        raise CorrectionError(f'error_map_mm must have shape (rows, cols), not {error.shape}')
    if not -1.3 <= height_exponent <= -0.1:
        raise CorrectionError(f'height_exponent is {height_exponent}, must be -1.3 .. -0.1')
    points = [_points(p, i) for i, p in enumerate(paths)]
    request = CorrectionInput(
        z=error * 1e-3 / -height_exponent,
        target=np.zeros_like(error),
        planned=_planned(layer_height_mm, error.shape),
        resolution=resolution_mm * 1e-3,
        bead_width=bead_width_mm * 1e-3,
        k_gain=k_gain,
        sigma=None if sigma_mm is None else np.asarray(sigma_mm, float) * 1e-3,
        direction=direction,
        paths=tuple(p - np.array(origin_mm) * 1e-3 for p in points if len(p) > 1),
        temperature=temperature,
    )
    result = safe_correct(make_law(law, gain, regularisation, model), request, ())
    spec = GridSpec(origin_mm[0] * 1e-3, origin_mm[1] * 1e-3, request.resolution, *error.shape)
    psi = HeightGrid(spec, result.psi)
    return [1 + k_gain * np.nan_to_num(psi.sample(p[:, 0], p[:, 1])) for p in points]


def _points(path: np.ndarray, index: int) -> np.ndarray:
    """(n, 2) in m."""
    p = np.asarray(path, float)
    if p.ndim != 2 or p.shape[1] not in (2, 3) or not np.isfinite(p).all():
        raise CorrectionError(
            f'paths[{index}] must be finite points of shape (n, 2) or (n, 3), not {p.shape}'
        )
    return p[:, :2] * 1e-3


def _planned(layer_height_mm: float | np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    h = np.asarray(layer_height_mm, float) * 1e-3
    if h.ndim and h.shape != shape:
        raise CorrectionError(f'layer_height_mm has shape {h.shape}, the map {shape}')
    if not h.ndim and not 5e-5 < h < 0.02:
        raise CorrectionError(f'layer_height_mm is {layer_height_mm}, must be 0.05 .. 20 mm')
    return np.broadcast_to(h, shape).copy()
