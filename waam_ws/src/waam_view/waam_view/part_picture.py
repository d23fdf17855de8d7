"""The part before and after, drawn as a lit surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LightSource

from .canvas import new_figure, png
from .job_data import Scan

CELLS = 110  # along the longer side: finer is not seen at this size
STEEL, LAID = (0.66, 0.69, 0.73), (0.90, 0.52, 0.20)
NEW_METAL = 0.3e-3  # m above the surface as found, from which on a cell counts as laid


def before_and_after(first: Scan, last: Scan) -> bytes:
    """PNG: both surfaces from the same side on the same scale; laid metal is orange. Unknown heights leave holes."""
    rows, cols = _window(last)
    step = max(1, int(np.ceil(max(rows.stop - rows.start, cols.stop - cols.start) / CELLS)))
    cut = (slice(rows.start, rows.stop, step), slice(cols.start, cols.stop, step))
    heights = [s.z[cut] * 1e3 for s in (first, last)]
    known = np.concatenate([h[np.isfinite(h)] for h in heights])
    if not known.size or min(heights[0].shape) < 2:
        raise ValueError('no height is known')
    low, high = float(known.min()), float(known.max())
    d = last.resolution * 1e3
    x = last.origin[0] * 1e3 + (np.arange(last.z.shape[1])[cut[1]] + 0.5) * d
    y = last.origin[1] * 1e3 + (np.arange(last.z.shape[0])[cut[0]] + 0.5) * d
    laid = np.nan_to_num(heights[1] - heights[0]) > NEW_METAL * 1e3
    figure = new_figure(9.4, 3.9)
    for place, z, title, metal in (
        (1, heights[0], 'before', np.zeros_like(laid)),
        (2, heights[1], 'after', laid),
    ):
        axes: Any = figure.add_subplot(1, 2, place, projection='3d')
        axes.plot_surface(
            *np.meshgrid(x, y), z, facecolors=_colours(z, metal, d * step), rstride=1, cstride=1, shade=False,
            linewidth=0, antialiased=False,
        )  # fmt: skip
        axes.set_zlim(low, max(high, low + 1.0))
        axes.set_box_aspect((float(np.ptp(x)), float(np.ptp(y)), max(high - low, 1.0)), zoom=1.35)
        axes.view_init(elev=38, azim=-62)
        axes.set_axis_off()
        axes.set_title(title, fontsize=11)
    return png(figure)


def _window(scan: Scan) -> tuple[slice, slice]:
    """Rows and columns of the region with 5 mm around it; the whole map without a region."""
    rows, cols = np.nonzero(scan.region)
    if not rows.size:
        return slice(0, scan.z.shape[0]), slice(0, scan.z.shape[1])
    more = int(5e-3 / scan.resolution)
    return (
        slice(max(0, rows.min() - more), min(scan.z.shape[0], rows.max() + 1 + more)),
        slice(max(0, cols.min() - more), min(scan.z.shape[1], cols.max() + 1 + more)),
    )


def _colours(z: np.ndarray, laid: np.ndarray, cell_mm: float) -> np.ndarray:
    """(rows, cols, 4): metal lit from the upper left; transparent where the height is unknown."""
    known = np.isfinite(z)
    filled = np.where(known, z, np.nanmin(z) if known.any() else 0.0)
    light = LightSource(azdeg=315, altdeg=45).hillshade(filled, dx=cell_mm, dy=cell_mm)
    base = np.where(laid[..., None], LAID, STEEL)
    rgb = np.clip(base * (0.35 + 0.75 * light[..., None]), 0, 1)
    return np.concatenate([rgb, known[..., None].astype(float)], -1)
