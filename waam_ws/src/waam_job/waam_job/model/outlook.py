"""Whether the loop still brings the part to its target. Pure; lengths in m, maps (rows, cols)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from waam_plan import masks

GROWTH = 1.05  # by which the error must grow from one layer to the next
LAYERS = 2  # in a row
TOLERANCES = 3.0  # tolerances below which an error that grows is left to the verdict
THICKNESSES = 0.25  # of a layer, the same
REGION = 0.05  # of the area of a layer: the worst region of it
# what its error may be over what the RMS may: bead ends and walls of pockets reach 1.3, a sagging cone 2
REGION_OVER_RMS = 1.7
WITHIN_REACH = 0.4  # of a layer's thickness: more than that no single layer corrects
STARVED = 0.5  # of the metal that was asked for: a region that grows less sags, or gets no metal
THIN = 0.5  # of a layer's thickness: where less is planned, how much comes says little
# area out of reach over that which a good verdict allows: near it, scans decide by chance
LOST_OVER_ALLOWED = 2.0


def diverges(errors: Sequence[float], tolerance: float, thickness: float) -> bool:
    """Whether the errors after the layers so far, the last one last, have grown LAYERS times in a row, to more than a
    loop that converges shows. thickness: of a layer."""
    last = list(errors[-LAYERS - 1 :])
    if len(last) <= LAYERS or last[-1] <= max(TOLERANCES * tolerance, THICKNESSES * thickness):
        return False
    return all(after > GROWTH * before for before, after in zip(last, last[1:], strict=False))


def worst_region(error: np.ndarray, on: np.ndarray, bead: float) -> float:
    """m: size of the error that REGION of the cells lie beyond, each the mean over half a bead around it. error: known
    on all cells of `on`; bead: its width in cells."""
    around = np.abs(masks.blur(error, on, bead / 4)[on])
    return float(np.quantile(around, 1 - REGION))


def reach(rest: np.ndarray) -> np.ndarray:
    """m of error that layers with so much metal in all (`rest`) can still correct."""
    return WITHIN_REACH * rest


def lost(error: np.ndarray, rest: np.ndarray, tolerance: float) -> np.ndarray:
    """bool: where the error stays beyond the tolerance whatever the layers to come do."""
    out: np.ndarray = np.abs(error) > tolerance + reach(rest)
    return out


def too_much(out: np.ndarray, judged: np.ndarray, share_wanted: float) -> bool:
    """Whether so much of the judged cells is lost that no verdict can be good any more."""
    area = int(judged.sum())
    return area > 0 and (out & judged).sum() > LOST_OVER_ALLOWED * (1 - share_wanted) * area


def starved(
    grown: Sequence[np.ndarray], asked: Sequence[np.ndarray], on: np.ndarray, bead: float
) -> np.ndarray:
    """bool: regions of `on` that grew by less than STARVED of what the last layers asked for, as wide as a bead at
    least. grown: NaN = not seen; bead: its width in cells."""
    total_asked, total = np.sum(asked, axis=0), np.sum(grown, axis=0)
    known = on & np.isfinite(total)
    for metal in asked:
        laid = metal[metal > 0]
        known &= metal >= THIN * (float(np.median(laid)) if laid.size else np.inf)
    if not known.any():
        return known
    ratio = masks.blur(total, known, bead / 4) / masks.blur(total_asked, known, bead / 4)
    poor = known & (np.nan_to_num(ratio, nan=1.0) < STARVED)
    return masks.drop_slivers(poor, bead / 2)
