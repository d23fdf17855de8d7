"""Explicit correction laws: formulas from the missing metal to psi, without a network.

`damped_inverse` is the default and the fallback of the learned law. A new law goes into a module of this folder and
into `registry.LAWS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import filters
from ..types import (
    RATIO_HIGH,
    RATIO_LOW,
    Correction,
    CorrectionInput,
    HeightRequest,
    nothing,
    split_ratio,
)


@dataclass(frozen=True)
class Zero:
    """No correction: the plan as it is."""

    name: str = 'zero'

    def correct(self, request: CorrectionInput) -> Correction:
        """psi 0 everywhere."""
        return nothing(request.z.shape, request.k_gain, self.name)

    def prepare(self, request: CorrectionInput) -> None:
        """Nothing: the plan alone decides nothing."""


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of the overlap of beads, smoothed over their footprint and damped.

    The missing metal is taken from the trusted cells (`filters.away_from_edges`: near the footprint's edge the slope of
    the outermost bead is seen, not the level), continued outwards from the nearest of them, filtered by
    `filters.inverse_bead_filter`, and asked for in the share `gain`. The wanted relative layer height is limited to
    RATIO_LOW..RATIO_HIGH and split into speed and residual by `split_ratio`. Away from known cells of the footprint
    confidence and shape fade to 0 at `reach` bead widths, so a small hole is bridged; a wide one gets what the layer
    lacks in the middle of what was seen, so that it holds the level.
    """

    gain: float = 0.9
    regularisation: float = 0.1
    edge_margin: float = 0.5
    reach: float = 0.5
    name: str = 'damped_inverse'

    def prepare(self, request: CorrectionInput) -> None:
        """Nothing that is worth it."""

    def correct(self, request: CorrectionInput) -> Correction:
        """See the class; a fallback without correction when no cell of the footprint is known."""
        asked = self.height_request(request)
        if asked is None:
            reason = 'no known cell in the footprint'
            return nothing(request.z.shape, request.k_gain, self.name, (reason,))
        psi, residual = split_ratio(asked.ratio, asked.planned, request.k_gain)
        return Correction(psi, asked.confidence, residual, self.name, request.k_gain)

    def height_request(self, request: CorrectionInput) -> HeightRequest | None:
        """What is asked of every cell before it is split into speed and residual; None without a known cell."""
        known = request.footprint & np.isfinite(request.error)
        if not known.any():
            return None
        width = request.bead_width / request.resolution  # cells
        trusted = known & filters.away_from_edges(
            request.footprint, self.edge_margin * width, request.direction
        )
        missing, _ = filters.extend(request.error, trusted if trusted.any() else known)
        wanted = filters.inverse_bead_filter(
            missing, request.resolution, request.bead_width, request.direction, self.regularisation
        )
        planned, _ = filters.extend(request.planned, request.footprint)
        seen, sure = self._seen(request, known, width)
        confidence = seen * sure
        level = float(np.median(request.error[trusted if trusted.any() else known]))
        held = np.where(request.footprint, self.gain * (1 - seen) * level / planned, 0.0)
        ratio = np.clip(1 + self.gain * confidence * wanted / planned + held, RATIO_LOW, RATIO_HIGH)
        return HeightRequest(ratio, planned, confidence, held)

    def _seen(
        self, request: CorrectionInput, known: np.ndarray, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(rows, cols) 0..1 from the distance of the nearest known cell, and from its uncertainty; width of a bead in
        cells."""
        sigma = np.full(known.shape, np.nan) if request.sigma is None else request.sigma
        nearest, distance = filters.extend(sigma, known)
        fade = np.clip(2 * (1 - distance / (self.reach * width)), 0.0, 1.0)
        return fade, filters.reliability(nearest, known.shape)
