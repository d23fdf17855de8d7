"""Tables of heights by layer and segment as maps: one segment per row, or one layer per row with a column a segment."""

from __future__ import annotations

import numpy as np

from . import messages as own
from .tally import Tally

MAX_SEGMENTS = 5000  # segments of a layer
LAYERS = 100_000


def long_table(layer: np.ndarray, segment: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows (n,) as they are, with which of them are good (n,)."""
    whole = (layer == np.round(layer)) & (segment == np.round(segment))
    good = whole & (layer >= 0) & (layer < LAYERS) & (segment >= 0) & (segment < MAX_SEGMENTS)
    return layer, segment, z, good


def wide_table(layer: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of rows (n,) with heights (n, m): each height as a row of its own, (n m,)."""
    n, m = z.shape
    flat = np.repeat(layer, m)
    good = (flat == np.round(flat)) & (flat >= 0) & (flat < LAYERS)
    return flat, np.tile(np.arange(m, dtype=float), n), z.reshape(-1), good


def maps(
    rows: tuple[np.ndarray, ...], stamps: list[int], lines: list[int], tally: Tally, length: float
) -> list[tuple[int, bytes]]:
    """A message per layer. rows: layer, segment, height m, good, each (n,); stamps ns, lines: of the rows of the table,
    which hold n / len(stamps) segments each; length: m of a segment."""
    layer, segment, z, good = rows
    each = max(layer.size // max(len(stamps), 1), 1)
    for k in sorted({int(i) // each for i in np.flatnonzero(~good)}):
        tally.add('rows left out: layer or segment is no whole number from 0', lines[k])
    found: list[tuple[int, bytes]] = []
    if not good.any():
        return found
    first, width = int(segment[good].min()), int(np.ptp(segment[good])) + 1
    for number, k in enumerate(np.unique(layer[good])):
        at = np.flatnonzero(good & (layer == k))
        row = np.full(width, np.nan)
        row[segment[at].astype(int) - first] = z[at]
        stamp = max(stamps[i // each] for i in at)
        found.append((stamp, own.heights(stamp, int(k), number, row, length)))
    return found
