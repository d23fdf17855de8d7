"""Room that a thick layer leaves for thinner ones on it, where a network foretells humps.

A thin layer is laid with nearly the least feed, so where its metal comes together it cannot lay much less: it lays the
hump below it again. A hollow it can fill. So the thick layer below is asked to stay low where it will grow too much.
"""

from __future__ import annotations

import numpy as np

from ..types import CorrectionInput
from .residual import middle

THINNER = 0.75  # of the thickness of a layer: a thinner one on it needs room
SHARE = 0.75  # of the growth beside the bead model that is foretold


def under_thinner(
    request: CorrectionInput, growth: np.ndarray, inner: np.ndarray
) -> np.ndarray | float:
    """(rows, cols) share of the planned height by which the layer is to stay low, its mean over the cells that count
    taken off; 0 where no thinner layer follows (docs/equations.md, I8).

    growth (rows, cols): share of the planned height that is foretold beside the bead model; inner (rows, cols): weight
    of the cells that count.
    """
    if not 0 < request.next_thickness < THINNER * middle(request):
        return 0.0
    room = SHARE * np.maximum(growth, 0.0)
    mean = float((room * inner).sum()) / max(float(inner.sum()), 1e-9)
    return (room - mean) * inner
