"""The learned law: the damped inverse, what the network adds to it where it may be trusted, and a last layer that
solves for the beads (`bead_solver`) where the request has their paths.

The network never replaces the explicit law. Where it doubts its own answer its share fades out. For a map unlike those
of its training the bead model answers without it, if the request has paths. Without paths, or without a sound model
file, the explicit law answers alone. The answer says so in each case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from .. import filters
from ..beads import solver as bead_solver
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import (
    RATIO_HIGH,
    RATIO_LOW,
    Correction,
    CorrectionInput,
    HeightRequest,
    split_ratio,
)
from . import features, net, net_file
from .explicit import DampedInverse

NO_MODEL = 'none'  # in place of a file of weights: the bead model without a network
DOUBT = 0.25  # layer heights: predicted error at which the confidence is a half
# confidence below which the network has no weight, and from which on its full weight
LOW, FULL = 0.08, 0.2


@dataclass(frozen=True)
class UNetLaw:
    """psi from the explicit law's relative layer height plus the network's change of it.

    Without a network it is the law `bead_solver`.

    explicit: what is corrected, and the fallback. network None: `broken` says why, and the explicit law answers; where
    `broken` says nothing (NO_MODEL), the bead model starts from the explicit law.
    confidence of the result: that of the explicit law times 1/(1 + (predicted error/DOUBT)^2).
    """

    explicit: DampedInverse
    network: net.Network | None
    broken: str = ''
    name: str = 'unet'

    @classmethod
    def load(cls, path: str, explicit: DampedInverse) -> UNetLaw:
        """path '' = the packaged weights, NO_MODEL = none.

        A file that cannot be used is announced in every answer, not raised.
        """
        if path == NO_MODEL:
            return cls(explicit, None)
        try:
            return cls(explicit, _model(Path(path) if path else net_file.PACKAGED))
        except net.ModelError as e:
            return cls(explicit, None, str(e))

    def correct(self, request: CorrectionInput) -> Correction:
        """The beads solved for what the network wants; without it where that cannot be trusted (see `reasons`)."""
        plain = self.explicit.height_request(request)
        if plain is None or self.broken:
            return self._alone(request, self.broken)
        if self.network is None:
            return self._by_beads(request, plain)
        seen = features.build(request, plain.ratio - 1)
        if odd := self.network.unlike(features.SUMMARIES, features.summary(seen.x)):
            return self._without(request, plain, f'input unlike the training: {odd}')
        change, doubt = self.network(seen.x)
        if not (np.isfinite(change).all() and np.isfinite(doubt).all()):
            return self._without(request, plain, 'the network gave an answer that is not finite')
        sure = 1 / (1 + (np.exp(doubt) / DOUBT) ** 2)
        inside = seen.channel('footprint') > 0
        if (middle := float(np.median(sure[inside]))) < LOW:
            return self._without(
                request, plain, f'low confidence of the network: median {middle:.2f}, limit {LOW}'
            )
        return self._both(request, plain, seen, change, np.where(inside, sure, 0.0))

    def _by_beads(self, request: CorrectionInput, plain: HeightRequest) -> Correction:
        """The bead model's answer, started from the explicit law."""
        sure = np.ones_like(plain.ratio)
        return self._solved(request, plain, plain.ratio, sure, self._grid(request))

    def _without(self, request: CorrectionInput, plain: HeightRequest, why: str) -> Correction:
        """The answer without the network, announced as a fallback: the bead model's where there are paths."""
        if not request.paths:
            return self._alone(request, why)
        reason = f'unet: {why}; the bead model answers without the network'
        return replace(
            self._by_beads(request, plain), fallback=True, reasons=(reason,), model_hash=''
        )

    def _both(
        self,
        request: CorrectionInput,
        plain: HeightRequest,
        seen: features.Features,
        change: np.ndarray,
        sure: np.ndarray,
    ) -> Correction:
        inside = seen.channel('footprint') > 0
        weighed = np.clip((sure - LOW) / (FULL - LOW), 0.0, 1.0) * change
        add = seen.resampler.fine(filters.extend(weighed.astype(float), inside)[0])
        sure = np.clip(seen.resampler.fine(filters.extend(sure, inside)[0]), 0.0, 1.0)
        ratio = np.clip(plain.ratio + plain.confidence * add, RATIO_LOW, RATIO_HIGH)
        return self._solved(request, plain, ratio, sure, seen.resampler, weighed)

    def _solved(
        self,
        request: CorrectionInput,
        plain: HeightRequest,
        ratio: np.ndarray,
        sure: np.ndarray,
        grid: Resampler,
        guess: np.ndarray | float = 0.0,
    ) -> Correction:
        """ratio: wished relative layer height, sure: share of the explicit law's confidence, both (rows, cols). guess:
        of the network, see `bead_solver.refine`."""
        if request.paths:
            solved = bead_solver.refine(request, ratio, self.explicit.gain, grid, guess)
            ratio = 1 + plain.confidence * (solved - 1)
        psi, residual = split_ratio(ratio, plain.planned, request.k_gain)
        digest = self.network.digest if self.network else ''
        return Correction(
            psi, plain.confidence * sure, residual, self.name, request.k_gain, model_hash=digest
        )

    @staticmethod
    def _grid(request: CorrectionInput) -> Resampler:
        cell = request.bead_width / CELLS_PER_BEAD
        return Resampler.of(request.z.shape, request.resolution, cell)

    def _alone(self, request: CorrectionInput, why: str) -> Correction:
        """The explicit law's answer, announced as a fallback."""
        result = self.explicit.correct(request)
        reason = f'unet: {why}; {self.explicit.name} answers' if why else ''
        reasons = (*((reason,) if reason else ()), *result.reasons)
        return replace(result, fallback=bool(reasons), reasons=reasons)


@lru_cache(maxsize=4)
def _model(path: Path) -> net.Network:
    """Read once per process: the weights do not change under a running job."""
    return net_file.load(path)
