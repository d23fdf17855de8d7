"""Notes what the correction of a job saw and what came of it: layers to train a network on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from waam_adapt import conversions as convert
from waam_adapt.laws.corrector import Corrector
from waam_adapt.types import CorrectionInput
from waam_msgs.msg import CorrectionMap
from waam_msgs.srv import ComputeCorrection
from waam_node.conversions import grid_from_msg
from waam_train import samples


class Watched(NamedTuple):
    """One layer before it is laid: what the correction was asked, the same as the law saw it, and whether the law gave
    way."""

    request: CorrectionInput
    prepared: CorrectionInput
    fallback: bool


@dataclass
class LayerWatch:
    """What the correction was asked before every layer, and the surface after the last one."""

    layers: list[Watched] = field(default_factory=list)
    last: np.ndarray | None = None  # after the newest layer

    def on_correction(
        self, request: ComputeCorrection.Request, answer: CorrectionMap, corrector: Corrector
    ) -> None:
        """Before a layer: the request, its answer, and the corrector that gave it."""
        p = corrector.params
        core = convert.correction_input(
            request, grid_from_msg(request.map.grid), p.k_gain, p.k_gain_max
        )
        self.layers.append(Watched(core, corrector.prepared or core, answer.fallback))
        self.last = None  # a job that ends before the next scan says nothing of this layer

    def on_scan(self, z: np.ndarray) -> None:
        """z: (rows, cols) m."""
        self.last = z

    def samples(self, seed: int, family: str = '') -> list[samples.Sample]:
        """One sample per layer with bead paths whose surface afterwards is known; seed, family: of the cell."""
        surfaces = [w.request.z for w in self.layers[1:]]
        surfaces += [self.last] if self.last is not None else []
        found = (
            samples.sample(w.request, w.prepared, after, seed, family)
            for w, after in zip(self.layers, surfaces, strict=False)
            if w.request.paths and w.prepared.learned is not None and not w.fallback
        )
        return [s for s in found if s is not None]
