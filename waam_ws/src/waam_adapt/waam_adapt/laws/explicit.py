"""Explicit correction laws: formulas from the missing metal to psi, without a network.

`damped_inverse` is the default and the fallback of the learned law. A new law goes into a module of this folder and
into `registry.LAWS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import filters
from ..types import (
    MIN_GAIN,
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


def cell_by_cell(
    request: CorrectionInput, name: str, faster: Callable[[np.ndarray], np.ndarray]
) -> Correction:
    """A law without neighbours and residual. faster: relative change of speed (rows, cols) for the missing share of the
    planned metal (rows, cols), 0 for 0."""
    if request.k_gain < MIN_GAIN:
        return nothing(request.z.shape, request.k_gain, name)
    known = request.footprint & np.isfinite(request.error)
    missing = np.where(known, request.error, 0.0) / np.where(known, request.planned, 1.0)
    psi = np.clip(faster(missing) / request.k_gain, -1.0, 1.0)
    confidence = np.where(known, filters.reliability(request.sigma, known.shape), 0.0)
    return Correction(psi, confidence, np.zeros_like(psi), name, request.k_gain)


@dataclass(frozen=True)
class Proportional:
    """psi = -gain*error/(k_gain*planned), cell by cell: no smoothing, no knowledge of the bead, no
    residual for the feed.

    Kept as the plain reference that published cells use; `DampedInverse` is the one to weld with.
    """

    gain: float = 0.7
    name: str = 'proportional'

    def correct(self, request: CorrectionInput) -> Correction:
        """See the class; psi 0 where the map or the footprint is unknown."""
        return cell_by_cell(request, self.name, lambda missing: -self.gain * missing)


@dataclass(frozen=True)
class LogLog:
    """Speed from the inverse of one fixed model ln(height) = exponent*ln(speed) + b, cell by cell, no residual.

    1 + k_gain*psi = (wanted/planned)**(1/exponent); b cancels, for the plan's height belongs to the plan's speed. What
    published single-bead cells do with their regression; exponent: -0.5 lies amid the fits of the material table.
    """

    gain: float = 0.7
    exponent: float = -0.5
    name: str = 'log_log'

    def correct(self, request: CorrectionInput) -> Correction:
        """See the class; psi 0 where the map or the footprint is unknown."""

        def faster(missing: np.ndarray) -> np.ndarray:
            ratio = np.clip(1 + self.gain * missing, RATIO_LOW, RATIO_HIGH)
            return ratio ** (1 / self.exponent) - 1

        return cell_by_cell(request, self.name, faster)


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of the overlap of beads, smoothed over their footprint and damped.

    The missing metal is taken from the trusted cells (`filters.away_from_edges`: near the footprint's edge the slope of
    the outermost bead is seen, not the level), continued outwards from the nearest of them, filtered by
    `filters.inverse_bead_filter`, and asked for in the share `gain`. The wanted relative layer height is limited to
    RATIO_LOW..RATIO_HIGH and split into speed and residual by `split_ratio`. Away from known cells of the footprint
    confidence and correction fade to 0 at `reach` bead widths, so a small hole is bridged and a wide one is left alone.
    """

    gain: float = 0.9
    regularisation: float = 0.1
    edge_margin: float = 0.5
    reach: float = 0.5
    name: str = 'damped_inverse'

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
        confidence = self._confidence(request, known, width)
        ratio = np.clip(1 + self.gain * confidence * wanted / planned, RATIO_LOW, RATIO_HIGH)
        return HeightRequest(ratio, planned, confidence)

    def _confidence(self, request: CorrectionInput, known: np.ndarray, width: float) -> np.ndarray:
        """(rows, cols) 0..1 from uncertainty and distance of the nearest known cell; width of a bead in cells."""
        sigma = np.full(known.shape, np.nan) if request.sigma is None else request.sigma
        nearest, distance = filters.extend(sigma, known)
        fade = np.clip(2 * (1 - distance / (self.reach * width)), 0.0, 1.0)
        return fade * filters.reliability(nearest, known.shape)
