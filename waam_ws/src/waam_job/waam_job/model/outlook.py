"""Whether the loop still brings the part towards its target. Pure; lengths in m."""

from __future__ import annotations

from collections.abc import Sequence

GROWTH = 1.05  # by which the error must grow from one layer to the next
LAYERS = 2  # in a row
TOLERANCES = 3.0  # tolerances below which an error that grows is left to the verdict
THICKNESSES = 0.25  # of a layer, the same
WITHIN_REACH = 0.4  # of a layer's thickness: more than that no single layer corrects


def diverges(rms: Sequence[float], tolerance: float, thickness: float) -> bool:
    """Whether the RMS errors after the layers so far, the last one last, have grown LAYERS times in a row, to more than
    a loop that converges shows. thickness: of a layer."""
    last = list(rms[-LAYERS - 1 :])
    if len(last) <= LAYERS or last[-1] <= max(TOLERANCES * tolerance, THICKNESSES * thickness):
        return False
    return all(after > GROWTH * before for before, after in zip(last, last[1:], strict=False))
