"""Surfaces of recorded jobs, for fine-tuning: what the scans of a real cell look like before a layer."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import filters
from ..laws import features
from ..laws.explicit import CorrectionInput
from .scenes import SIZE, Recorded


def surface(request: CorrectionInput) -> Recorded | None:
    """One request on the training grid, cut to its middle; None when too little of it is known."""
    footprint = request.footprint
    known = footprint & np.isfinite(request.error)
    if known.sum() < 0.5 * max(footprint.sum(), 1):
        return None
    cell = request.bead_width / features.CELLS_PER_BEAD
    r = features.Resampler.of(request.z.shape, request.resolution, cell)
    height = float(np.median(request.planned[footprint]))
    error, _ = filters.extend(request.error, known)
    error = np.clip(r.mean(error) / height, -features.LIMIT, features.LIMIT)
    inside = r.mean(footprint.astype(float)) > 0.5
    if not inside.any():
        return None
    return Recorded(_fit(error, 'edge'), _fit(inside, 'constant'))


def _fit(values: np.ndarray, mode: str) -> np.ndarray:
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


def from_jobs(folders: list[Path]) -> list[Recorded]:
    """Every corrected layer of recorded jobs (folders with an MCAP record). ValueError names a
    folder that cannot be read.
    """
    from waam_node.conversions import grid_from_msg
    from waam_replay.record import (
        load,  # the reader of whole jobs; training without records needs it not
    )

    from ..conversions import correction_input

    out = []
    for folder in folders:
        calls = load(folder).calls['correct']
        for call in calls:
            request = correction_input(call.request, grid_from_msg(call.request.map.grid), 0.3, 0.9)
            out += [r] if (r := surface(request)) is not None else []
        if not calls:
            raise ValueError(
                f'{folder}: holds no call of correction_server/compute (an open-loop job?)'
            )
    return out
