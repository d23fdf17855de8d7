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
WELL_SEEN = 0.95  # of a column or row that was seen beside the arc, for a pass that leaves it out
LEAST_CUT = 6  # columns or rows at an end that are worth leaving out
SEEN_SIGMA = 0.05e-3  # m, of what was seen beside the arc, at least
MOVED = 0.1e-3  # m, median change of those cells; a part that was touched or sank differs by more


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


def narrowed(window: Window, seen: np.ndarray) -> Window:
    """The window without the columns and rows at its ends that were seen well enough beside the arc: seen (rows, cols)
    m, NaN where it was not. An end of less than LEAST_CUT is kept."""
    known = np.isfinite(seen[window.cells])
    spans = []
    for axis, (a, b) in ((1, window.rows), (0, window.cols)):
        poor = np.flatnonzero(known.mean(axis=axis) < WELL_SEEN)
        if not len(poor):  # all of it: half a pass is no pass, one end stays
            poor = np.array([0, b - a - 1])
        spans.append((a + int(poor[0]), a + int(poor[-1]) + 1))
    rows, cols = spans
    return Window(
        *((a if low - a < LEAST_CUT else low, b if b - high < LEAST_CUT else high)
          for (a, b), (low, high) in ((window.rows, rows), (window.cols, cols)))
    )  # fmt: skip


def with_seen(before: Scan, seen: np.ndarray, window: Window) -> Scan:
    """The map before the layer with what was seen beside the arc in the window: seen (rows, cols) m, NaN = nothing."""
    inside = np.zeros(before.map.spec.shape, bool)
    inside[window.cells] = True
    hit = inside & np.isfinite(seen)
    z = np.where(hit, seen, before.map.z)
    sigma = before.map.sigma
    if sigma is not None:
        sigma = np.where(hit, np.maximum(np.nan_to_num(sigma), SEEN_SIGMA), sigma)
    return replace(before, map=HeightGrid(before.map.spec, z, sigma))


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
    """Why the map of a window does not fit to the one before, in words; '' when it does. planned: (rows, cols) m."""
    if not seen.plausible:
        return '; '.join(seen.reasons) or 'its map is not plausible'
    change = seen.map.z - beside(before.map, window, planned)
    if reason := unwitnessed(change):
        return reason
    known = change[np.isfinite(change)]
    moved = float(np.median(known))
    if abs(moved) > MOVED:
        return f'the surface beside the layer has moved by {moved * 1e3:+.2f} mm'
    return ''


def joined(before: Scan, seen: Scan, window: Window) -> Scan:
    """The map before the layer with the window replaced by what was seen of it. Bead width and points are those of the
    window; it has no message of its own."""
    z, count = before.map.z.copy(), np.array(before.count, copy=True)
    z[window.cells], count[window.cells] = seen.map.z, seen.count
    sigma = None
    if before.map.sigma is not None and seen.map.sigma is not None:
        sigma = before.map.sigma.copy()
        sigma[window.cells] = seen.map.sigma
    whole = HeightGrid(before.map.spec, z, sigma)
    return replace(seen, map=whole, count=count, coverage=whole.coverage, handle=None)
