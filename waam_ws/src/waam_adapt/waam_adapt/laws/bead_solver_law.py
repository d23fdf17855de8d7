"""The base law: the explicit law's answer, solved for the beads where the request tells their paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..beads import solver
from ..beads.model import bead_model
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import RATIO_LOW, Correction, CorrectionInput, split_ratio
from .explicit import DampedInverse


@dataclass(frozen=True)
class BeadSolver:
    """psi from the relative layer heights that the beads need by the nominal bead model (`beads.solver`), started from
    the explicit law; without paths the explicit law answers."""

    explicit: DampedInverse
    name: str = 'bead_solver'

    def prepare(self, request: CorrectionInput) -> None:
        """The model of the beads, which is kept for `correct`."""
        bead_model(request.paths, _grid(request).shape, request.bead_width)

    def correct(self, request: CorrectionInput) -> Correction:
        """A fallback without correction when no cell of the footprint is known."""
        plain = self.explicit.height_request(request)
        if plain is None or not request.paths:
            return self.explicit.correct(request)
        solved = solver.refine(request, plain.ratio, self.explicit.gain, _grid(request))
        ratio = np.maximum(1 + plain.confidence * (solved - 1) + plain.held, RATIO_LOW)
        psi, residual = split_ratio(ratio, plain.planned, request.k_gain)
        return Correction(psi, plain.confidence, residual, self.name, request.k_gain)


def _grid(request: CorrectionInput) -> Resampler:
    return Resampler.of(request.z.shape, request.resolution, request.bead_width / CELLS_PER_BEAD)
