"""Notes what the correction of a job was asked and answered, and what grew: layers to train a growth network on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waam_adapt import conversions as convert
from waam_adapt.laws.corrector import Corrector
from waam_adapt.training import samples
from waam_adapt.types import CorrectionInput
from waam_msgs.msg import CorrectionMap
from waam_msgs.srv import ComputeCorrection
from waam_node.conversions import grid_from_msg


@dataclass
class LayerWatch:
    """What the correction was asked and answered before every layer, and the surface after the last one."""

    # request, metal that was asked for (rows, cols) in m, lag in bead widths, slope of growth on metal
    layers: list[tuple[CorrectionInput, np.ndarray, float, float]] = field(default_factory=list)
    last: np.ndarray | None = None

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
        asked = core.planned / (1 + answer.k_gain * psi) + np.nan_to_num(residual)
        asked = np.where(core.footprint, asked, 0.0) * answer.flow_factor * core.heat_factor
        identifier = corrector.identifier
        slope = identifier.slope_of(identifier.model_of(core))
        self.layers.append((core, asked, identifier.beads.lag, slope))

    def on_scan(self, z: np.ndarray) -> None:
        """z: (rows, cols) m."""
        self.last = z

    def samples(self, seed: int) -> list[samples.Sample]:
        """One sample per layer with bead paths whose surface afterwards is known; seed: of the cell, kept with them."""
        surfaces = [core.z for core, *_ in self.layers[1:]]
        surfaces += [self.last] if self.last is not None else []
        found = (
            samples.sample(core, asked, after, lag, seed, slope)
            for (core, asked, lag, slope), after in zip(self.layers, surfaces, strict=False)
            if core.paths
        )
        return [s for s in found if s is not None]
