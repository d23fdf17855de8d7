"""The part of a map that a layer has changed: where the pass after it must look, and how its map joins the one before.

Pure. Where no metal was laid, a surface that was measured before is still there; a ring around the metal that both
maps show tells whether that is true.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation

from waam_process.grid import GridSpec, HeightGrid

from .snapshots import Scan

BEYOND = 3e-3  # m around the metal of a layer that is scanned with it
SPREAD = 1.5e-3  # m beyond its planned footprint that metal may flow: no witness of what was there
WITNESSES = 50  # cells that must tell whether the surface beside the layer is still where it was
MAX_CHANGE_BESIDE = (
    0.1e-3  # m, median change of those cells; a part that was touched or sank differs by more
)


@dataclass(frozen=True)
class Window:
    """A rectangle of cells of a grid: rows and columns from the first to before the last."""

    rows: tuple[int, int]
    cols: tuple[int, int]

    @property
    def cells(self) -> tuple[slice, slice]:
        """Index of the window in arrays of the whole grid."""
        return slice(*self.rows), slice(*self.cols)

    @property
    def size(self) -> int:
        """Number of cells."""
        return (self.rows[1] - self.rows[0]) * (self.cols[1] - self.cols[0])

    def spec(self, whole: GridSpec) -> GridSpec:
        """The cells of the window as a grid of their own, with the same edges."""
        r, edge = self.rows, whole.resolution
        x, y = whole.origin_x + self.cols[0] * edge, whole.origin_y + r[0] * edge
        return GridSpec(x, y, edge, r[1] - r[0], self.cols[1] - self.cols[0])


def window_of(spec: GridSpec, planned: np.ndarray) -> Window | None:
    """The window around the metal of a layer, planned (rows, cols) m, and BEYOND; None when nothing is planned."""
    laid = np.nan_to_num(planned) > 0
    if not laid.any():
        return None
    more = int(np.ceil(BEYOND / spec.resolution - 1e-9))
    spans = []
    for axis, size in ((1, spec.rows), (0, spec.cols)):
        hit = np.flatnonzero(laid.any(axis=axis))
        spans.append((max(0, int(hit[0]) - more), min(size, int(hit[-1]) + 1 + more)))
    return Window(*spans)


def beside(before: HeightGrid, window: Window, planned: np.ndarray) -> np.ndarray:
    """Heights (m, shape of the window) before a layer where it laid nothing near, NaN elsewhere: the witnesses.
    planned: (rows, cols) m."""
    flow = int(np.ceil(SPREAD / before.spec.resolution - 1e-9))
    laid = binary_dilation(np.nan_to_num(planned) > 0, iterations=flow)
    return np.where(laid, np.nan, before.z)[window.cells]


def unwitnessed(heights: np.ndarray) -> str:
    """Why heights (m, NaN = unknown) beside a layer cannot tell whether it moved, in words; '' when they can."""
    known = int(np.isfinite(heights).sum())
    return '' if known >= WITNESSES else f'only {known} cells beside the layer are known'


def against(before: Scan, seen: Scan, window: Window, planned: np.ndarray) -> str:
    """Why the map of a window does not fit to the one before, in words; '' when it does. planned: (rows, cols) m, metal
    of the layer."""
    if not seen.plausible:
        return '; '.join(seen.reasons) or 'its map is not plausible'
    found = np.full(before.map.spec.shape, np.nan)
    found[window.cells] = seen.map.z
    if reason := unwitnessed(_change(before.map, found, planned)):
        return reason
    moved = moved_beside(before.map, found, planned)
    if abs(moved) > MAX_CHANGE_BESIDE:
        return f'the surface beside the layer has moved by {moved * 1e3:+.2f} mm'
    return ''


def moved_beside(before: HeightGrid, found: np.ndarray, planned: np.ndarray) -> float:
    """By how much (m, median, up positive) the surface beside a layer has moved from the map before it to the one after
    it, found (rows, cols) m; NaN where too few cells tell. planned: (rows, cols) m, metal of the layer."""
    change = _change(before, found, planned)
    known = change[np.isfinite(change)]
    return float(np.median(known)) if known.size >= WITNESSES else float('nan')


def _change(before: HeightGrid, found: np.ndarray, planned: np.ndarray) -> np.ndarray:
    everything = Window((0, found.shape[0]), (0, found.shape[1]))
    return found - beside(before, everything, planned)


def joined(before: Scan, seen: Scan, window: Window) -> Scan:
    """The map before the layer with a window replaced by what was seen of it. It has no message of its own."""
    z, count = before.map.z.copy(), np.array(before.count, copy=True)
    z[window.cells], count[window.cells] = seen.map.z, seen.count
    sigma = None
    if before.map.sigma is not None and seen.map.sigma is not None:
        sigma = before.map.sigma.copy()
        sigma[window.cells] = seen.map.sigma
    whole = HeightGrid(before.map.spec, z, sigma)
    return replace(seen, map=whole, count=count, coverage=whole.coverage, handle=None)
