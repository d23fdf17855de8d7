"""Notes what the correction of a job was asked and answered, and what grew: layers to train a growth network on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from waam_adapt import conversions as convert
from waam_adapt.laws.corrector import Corrector
from waam_adapt.laws.unet_law import UNetLaw
from waam_adapt.training import samples
from waam_adapt.types import CorrectionInput, Predicted
from waam_job.model.geometry import asked_growth, driven_growth
from waam_msgs.msg import CorrectionMap
from waam_msgs.srv import ComputeCorrection
from waam_node.conversions import grid_from_msg
from waam_process.grid import GridSpec
from waam_process.segment import Segment


class Watched(NamedTuple):
    """One layer before it is laid: what the correction was asked, m of metal that the setpoints drive (rows, cols), lag
    of the metal in bead widths, slope of growth on metal, share of the planned height that its beads are known to lack
    (on the model's grid; 0 where its beads are not told), and what a growth network predicts, with the headroom that
    was asked for."""

    request: CorrectionInput
    driven: np.ndarray
    lag: float
    slope: float
    missing: np.ndarray | float
    predicted: Predicted | None


@dataclass
class LayerWatch:
    """What the correction was asked and answered before every layer, and the surface after the last one."""

    layers: list[Watched] = field(default_factory=list)
    last: np.ndarray | None = None
    # of the newest answer, until its setpoints are known: grid, factors of the feed
    _spec: GridSpec | None = None
    _factor: float = 1.0

    def on_correction(
        self, request: ComputeCorrection.Request, answer: CorrectionMap, corrector: Corrector
    ) -> None:
        """Before a layer: the request, its answer, and the corrector as it was then."""
        spec = grid_from_msg(request.map.grid)
        p = corrector.params
        core = convert.correction_input(request, spec, p.k_gain, p.k_gain_max)
        psi, residual = (
            convert.named_map(name, getattr(answer, name), spec)
            for name in ('psi', 'residual_height')
        )
        asked = asked_growth(core.planned, psi, answer.k_gain, residual)
        identifier = corrector.identifier
        law, model = corrector.law, identifier.model_of(core)
        beads = identifier.beads_told if isinstance(law, UNetLaw) else identifier.beads
        missing = beads.of(request.layer, model) if model is not None else 0.0
        slope = identifier.slope_of(model)
        predicted = law.predict(core) if isinstance(law, UNetLaw) else None
        if predicted is not None:
            room = identifier.skill.weight * predicted.headroom
            predicted = replace(predicted, headroom=room)
        self.layers.append(Watched(core, asked, beads.lag, slope, missing, predicted))
        self._spec, self._factor = spec, answer.flow_factor * core.heat_factor

    def on_setpoints(self, segments: Sequence[Segment]) -> None:
        """Before a layer: what limits of speed and feed leave of its answer."""
        if self._spec is None:
            return
        last = self.layers[-1]
        driven = driven_growth(last.driven, last.request.planned, self._spec, segments)
        self.layers[-1] = last._replace(driven=driven * self._factor)
        self._spec = None

    def on_scan(self, z: np.ndarray) -> None:
        """z: (rows, cols) m."""
        self.last = z

    def samples(self, seed: int) -> list[samples.Sample]:
        """One sample per layer with bead paths whose surface afterwards is known; seed: of the cell, kept with them."""
        surfaces = [w.request.z for w in self.layers[1:]]
        surfaces += [self.last] if self.last is not None else []
        found = (
            samples.sample(w.request, w.driven, after, w.lag, seed, w.slope, w.missing, w.predicted)
            for w, after in zip(self.layers, surfaces, strict=False)
            if w.request.paths
        )
        return [s for s in found if s is not None]
