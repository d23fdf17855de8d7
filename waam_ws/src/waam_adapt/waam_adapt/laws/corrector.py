"""The correction server without ROS: check the map, learn from the last layer, correct the next one.

The node and the offline replay both answer through this class, so that a replayed job is answered by what answered it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_node.params import param
from waam_process.learned import Learned

from ..identify.bead_width import SeenWidth, WidthEstimate, WidthIdentifier
from ..identify.estimate import Estimate
from ..identify.evidence import Layer
from ..identify.forecast_weight import ForecastWeight, ForecastWeights
from ..identify.identification import Identifier, Start
from ..identify.layers import Outcome
from ..types import Correction, CorrectionInput, LastLayer
from .checks import MapLimits, MapOrigin, reasons_against, safe_correct
from .registry import BEAD_LAWS, GONE, LAWS, make_law
from .unet_law import UNetLaw


@dataclass(frozen=True)
class CorrectionParams:
    """Parameters of the node correction_server."""

    law: str = param(
        'unet',
        'correction law',
        choices=tuple(LAWS),
        gone=GONE,
    )
    model: str = param(
        '',
        "file with the weights of law unet; '' = the packaged ones, none = the bead model alone",
    )
    k_gain: float = param(
        0.3, 'authority over travel speed when a request names none', '', 0.0, 0.3
    )
    k_gain_max: float = param(0.3, 'largest k_gain that a request may ask for', '', 0.0, 0.9)
    gain: float = param(
        0.9, 'share of the height error that one layer is asked to remove', '', 0.0, 1.2
    )
    max_age: float = param(300.0, 'oldest map that is used, ROS time', 's', 1.0)
    identify: bool = param(
        True, 'learn the efficiency ratio and give it as flow_factor, and what beads lack'
    )
    learning: float = param(
        0.3,
        'weight of the newest layer in what beads lack at the same place; 0 = off',
        '',
        0.0,
        1.0,
    )
    hold_width: bool = param(
        False, 'hold the planned bead width by the voltage, from the widths that the scans show'
    )


@dataclass(frozen=True)
class Answer:
    """What the correction server says to one request."""

    correction: Correction  # psi and its terms
    flow_factor: float  # for the wire feed
    estimate: Estimate  # what is believed of the process
    # by former jobs and this one; None = nothing was told of former ones
    learned: Learned | None = None
    width: WidthEstimate = WidthEstimate()  # measured over expected bead width
    width_ratio: float = 0.0  # of it, for the voltage; 0 = the voltage stays as programmed
    outcome: Outcome | None = None  # RMS of the surface after the layer; None = nothing can be said


class Corrector:
    """Answers the requests of one job after another, in the order of their layers."""

    def __init__(self, params: CorrectionParams) -> None:
        p = self.params = params
        self.law = make_law(p.law, p.gain, model=p.model)
        self.limits = MapLimits(p.max_age)
        forecast = self.law.forecast if isinstance(self.law, UNetLaw) else None
        self.identifier = Identifier(p.learning, p.law in BEAD_LAWS, forecast)
        self.widths = WidthIdentifier()
        self.prepared: CorrectionInput | None = None  # the newest request, as the law saw it

    def answer(
        self,
        layer: int,
        request: CorrectionInput,
        origin: MapOrigin,
        last: LastLayer,
        learned: Learned | None = None,
        seen: SeenWidth = SeenWidth(),
    ) -> Answer:
        """A map that is not to be trusted removes the correction and teaches nothing; the reasons are in the answer.

        learned: what the job starts with, the same for all of its layers. seen: bead width in the map.
        """
        reasons = reasons_against(origin, request, self.limits)
        width = self.widths.add(origin.expected_job_id, layer, SeenWidth() if reasons else seen)
        self.identifier.start(origin.expected_job_id, layer, self._start(learned))
        if not reasons and last.before is not None and last.growth is not None:
            self.identifier.add(
                Layer(
                    last.before,
                    request.z,
                    last.growth * last.feed_factor,
                    request.resolution,
                    request.bead_width,
                )
            )
        flow, expected, outcome = 1.0, request, None
        if self.params.identify:
            expected = self.identifier.prepare(request, trusted=not reasons)
            flow = self.identifier.flow_factor(request)
            outcome = self.identifier.memory[layer].outcome
        self.prepared = expected
        correction = safe_correct(self.law, expected, reasons)
        return Answer(
            correction,
            flow,
            self.identifier.estimate,
            self._after(learned, origin),
            width,
            width.ratio if self.params.hold_width and width.layers else 0.0,
            outcome,
        )

    def prepare(self, request: CorrectionInput) -> None:
        """Computes the geometry of a layer's beads before its surface is known. `bead_model` and `plan_geometry` keep
        it, so that `answer` need not; answers are the same without it."""
        if request.paths and request.footprint.any():
            self.law.prepare(request)

    def _start(self, learned: Learned | None) -> Start:
        """What a job begins with."""
        first = self.law.first_weight if isinstance(self.law, UNetLaw) else (0.0, 0.0)
        return Start.of(learned, ForecastWeights(*map(ForecastWeight, first)))

    def _after(self, learned: Learned | None, origin: MapOrigin) -> Learned | None:
        """What was learned with what this job has shown so far."""
        taught = self.identifier.taught() if self.params.identify else None
        if learned is None or taught is None:
            return learned
        return learned.after(taught, origin.expected_job_id)


def warm_up(params: CorrectionParams) -> None:
    """Answers for one imagined layer: loops and network are loaded now, not in the first answer of a job. It takes
    0.4 s of a core, seconds on a busy one, and a node gives no heartbeat meanwhile."""
    width, resolution = 6e-3, 0.5e-3
    flat = np.zeros((48, 48))
    planned = np.zeros_like(flat)
    planned[6:-6, 6:-6] = 1.5e-3
    passes = [
        [(5e-3, y), (19e-3, y)][::way]
        for y, way in zip((6e-3, 10e-3, 14e-3, 18e-3), (1, -1) * 2, strict=True)
    ]
    paths = (np.array(passes).reshape(-1, 2),)  # a zig-zag such as the network knows
    request = CorrectionInput(flat, flat, planned, resolution, width, 0.3, paths=paths)
    origin = MapOrigin(0.0, 'warm-up', 'warm-up', 1, 1, plausible=True)
    Corrector(params).answer(1, request, origin, LastLayer(flat - planned, planned))
