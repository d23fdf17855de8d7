"""Surfaces of recorded jobs, for fine-tuning: what the scans of a real cell look like before a layer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from waam_node.conversions import grid_from_msg

from .. import filters
from ..conversions import correction_input
from ..grids import CELLS_PER_BEAD, Resampler
from ..laws import features
from ..types import CorrectionInput
from .parts import SIZE
from .scenes import Recorded

# The requests of correction_server/compute (messages) that the job in a folder made.
ReadRequests = Callable[[Path], Sequence[Any]]
K_GAIN, K_GAIN_MAX = 0.3, 0.9  # of a request that names none; largest that is read


def surface(request: CorrectionInput) -> Recorded | None:
    """One request on the training grid, cut to its middle; None when too little of it is known."""
    footprint = request.footprint
    known = footprint & np.isfinite(request.error)
    if known.sum() < 0.5 * max(footprint.sum(), 1):
        return None
    cell = request.bead_width / CELLS_PER_BEAD
    r = Resampler.of(request.z.shape, request.resolution, cell)
    height = float(np.median(request.planned[footprint]))
    error, _ = filters.extend(request.error, known)
    error = np.clip(r.mean(error) / height, -features.LIMIT, features.LIMIT)
    inside = r.mean(footprint.astype(float)) > 0.5
    if not inside.any():
        return None
    return Recorded(_fit(error, 'edge'), _fit(inside, 'constant'))


def _fit(values: np.ndarray, mode: Literal['edge', 'constant']) -> np.ndarray:
    """The middle SIZE x SIZE cells, continued where the map is smaller."""
    for axis in (0, 1):
        n = values.shape[axis]
        if n >= SIZE:
            values = values.take(range((n - SIZE) // 2, (n - SIZE) // 2 + SIZE), axis)
        else:
            pad = [(0, 0), (0, 0)]
            pad[axis] = ((SIZE - n) // 2, SIZE - n - (SIZE - n) // 2)
            values = np.pad(values, pad, mode=mode)
    return values


def from_jobs(folders: list[Path], read: ReadRequests) -> list[Recorded]:
    """Every corrected layer of recorded jobs. read: gives the requests of a folder, so that training needs no reader
    of records itself. ValueError names a folder that cannot be read.
    """
    out = []
    for folder in folders:
        requests = read(folder)
        for request in requests:
            known = correction_input(request, grid_from_msg(request.map.grid), K_GAIN, K_GAIN_MAX)
            out += [r] if (r := surface(known)) is not None else []
        if not requests:
            raise ValueError(
                f'{folder}: holds no call of correction_server/compute (an open-loop job?)'
            )
    return out
