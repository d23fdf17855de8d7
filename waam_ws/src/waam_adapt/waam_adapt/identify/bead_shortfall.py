"""What the beads of a job do unlike the nominal bead model (`beads.bead_bias`), for laws that solve for them."""

from __future__ import annotations

import numpy as np

from ..beads.bead_bias import BeadBias
from ..beads.features import known_mean
from ..beads.model import MARGIN, inner_mean
from ..types import BeadDeviation, CorrectionInput
from .evidence import MIN_GROWTH
from .layers import AskedLayer, SeenLayer, grid_of, model_of_request


class BeadShortfall:
    """Growth of each layer against what the bead model expects of its setpoints."""

    def __init__(self, learning: float) -> None:
        """learning: 0..1, weight of the newest layer at least; 0 = never."""
        self.learning = learning
        self.state = BeadBias()

    def observe(self, seen: SeenLayer) -> None:
        """With one more layer, when its beads are known."""
        layer, model = seen.layer, seen.model
        if model is None or self.learning <= 0:
            return
        grid = grid_of(layer.before.shape, layer.resolution, layer.bead_width)
        laid = np.where(layer.footprint, layer.commanded, np.nan)
        plan = laid if layer.planned is None else layer.planned
        plan = np.where(plan > MIN_GROWTH, plan, np.nan)
        slope = seen.process.slope_on(model)
        asked = model.of_cells(laid / plan, layer.resolution) ** slope
        settled = seen.laid_with.updates >= 2
        growth = (layer.after - layer.before) / plan
        footprint, margin = np.isfinite(laid), MARGIN * layer.bead_width / layer.resolution
        known = footprint & np.isfinite(growth)
        growth, share = inner_mean(growth, known, footprint, grid, margin)
        height, _ = known_mean(plan, grid)
        self.state = self.state.learn(
            seen.number,
            model,
            asked,
            growth,
            share,
            self.learning,
            allowed=seen.laid_with.flow_factor(slope) ** -slope if settled else None,
            height=height,
        )

    def prepare(self, request: CorrectionInput, asked: AskedLayer) -> CorrectionInput:
        """With what the beads of the layer are known to lack."""
        model, beads, process = model_of_request(request), self.state, asked.process
        if model is None:
            return request
        slope = process.slope_on(model, process.slope_sigma)
        return request.with_prediction(
            learned=BeadDeviation(
                missing=beads.of(asked.number, model) - beads.surplus,
                lag=beads.lag * request.bead_width,
                slope=slope,
                scale=slope,
                fill=beads.fill,
                layers=asked.layers_seen,
                scatter=process.layer_noise,
                response=beads.response,
            )
        )
