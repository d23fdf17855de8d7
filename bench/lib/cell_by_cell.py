"""The plain laws of published cells, as baselines: cell by cell, without neighbours and without the feed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_adapt import filters
from waam_adapt.types import MIN_GAIN, Correction, CorrectionInput, nothing


@dataclass(frozen=True)
class Proportional:
    """psi = -gain*error/(k_gain*planned): no smoothing, no knowledge of the bead, no residual for the feed."""

    gain: float = 0.7
    name: str = 'proportional'

    def correct(self, request: CorrectionInput) -> Correction:
        """psi 0 where the map or the footprint is unknown."""
        if request.k_gain < MIN_GAIN:
            return nothing(request.z.shape, request.k_gain, self.name)
        known = request.footprint & np.isfinite(request.error)
        missing = np.where(known, request.error, 0.0) / np.where(known, request.planned, 1.0)
        psi = np.clip(-self.gain * missing / request.k_gain, -1.0, 1.0)
        confidence = np.where(known, filters.reliability(request.sigma, known.shape), 0.0)
        return Correction(psi, confidence, np.zeros_like(psi), self.name, request.k_gain)
