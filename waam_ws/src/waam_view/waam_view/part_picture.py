"""The part before and after, drawn as a lit surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LightSource

from waam_process.grid import GridSpec
from waam_process.unrolled import Unrolled

from .canvas import new_figure, png
from .job_data import Scan

CELLS = 110  # along the longer side: finer is not seen at this size
LIGHT = -40.0  # deg around a shaft from its top, where it is lightest
STEEL, LAID = (0.66, 0.69, 0.73), (0.90, 0.52, 0.20)
NEW_METAL = 0.3e-3  # m above the surface as found, from which on a cell counts as laid


def before_and_after(first: Scan, last: Scan, shaft: Unrolled | None = None) -> bytes:
    """PNG: both surfaces from the same side on the same scale; laid metal is orange. Unknown heights leave holes. A
    shaft is drawn round."""
    rows, cols = _window(last) if shaft is None else _turn(last, shaft)
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
        colours = _colours(z, metal, d * step)
        places: tuple[np.ndarray, ...] = (*np.meshgrid(x, y), z)
        if shaft is not None:
            places, colours = _rolled(x, y, z, colours, shaft)
        axes.plot_surface(
            *places,
            facecolors=colours,
            rstride=1,
            cstride=1,
            shade=False,
            linewidth=0,
            antialiased=False,
        )
        if shaft is None:
            axes.set_zlim(low, max(high, low + 1.0))
            size = float(np.ptp(x)), float(np.ptp(y)), max(high - low, 1.0)
        else:
            size = float(np.ptp(y)), 2e3 * shaft.radius, 2e3 * shaft.radius
        axes.set_box_aspect(size, zoom=1.35)
        axes.view_init(elev=38, azim=-62)
        axes.set_axis_off()
        axes.set_title(title, fontsize=11)
    return png(figure)


def _turn(scan: Scan, shaft: Unrolled) -> tuple[slice, slice]:
    """Rows and columns of one turn of the shaft."""
    spec = GridSpec(*scan.origin, scan.resolution, *scan.z.shape)
    on = np.flatnonzero(shaft.first_turn(spec))
    rows = np.flatnonzero(np.isfinite(scan.maps.get('nominal', scan.z)).any(axis=1))
    if not on.size or not rows.size:
        raise ValueError('the map does not show the shaft')
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(on[0]), int(on[-1]) + 1)


def _rolled(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, colours: np.ndarray, shaft: Unrolled
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Places in mm along the axis, aside and up, and the colours, lit from above; the first column once more at the
    end. x (cols,), y (rows,), z (rows, cols): mm, unrolled."""
    z = np.column_stack([z, z[:, :1]])
    angle = np.append(shaft.angle(x * 1e-3), shaft.angle(x[0] * 1e-3) + 2 * np.pi)
    t, along = np.meshgrid(angle, y)
    r = shaft.radius_at(z * 1e-3) * 1e3
    colours = np.concatenate([colours, colours[:, :1]], axis=1)
    lit = 0.62 + 0.38 * np.cos(t - np.radians(LIGHT))
    colours[..., :3] *= lit[..., None]
    return (along, r * np.sin(t), r * np.cos(t)), colours


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
