"""Psi again, from the recorded requests: surface, target, planned metal and what the last layer was asked for.

The answers come from the class that the node uses; its state (the identified process) grows layer by layer from the
requests alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from waam_adapt import conversions as convert
from waam_adapt.identify.estimate import Estimate
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.types import Correction, CorrectionInput
from waam_node.conversions import grid_from_msg
from waam_process.grid import GridSpec
from waam_record.read_record import Exchange

from .maps import MapAgain


@dataclass(frozen=True)
class PsiAgain:
    """One correction: the recorded one (message) and the same computed again."""

    recorded: Any  # waam_msgs/CorrectionMap
    spec: GridSpec
    core: CorrectionInput
    result: Correction
    flow_factor: float
    estimate: Estimate
    width_ratio: float = 0.0

    @property
    def layer(self) -> int:
        """The layer that the correction is for."""
        return self.recorded.layer

    @property
    def identical(self) -> bool:
        """psi, confidence, residual and the factors, to the last bit of what is published."""
        m, r = self.recorded, self.result
        maps = (
            (m.psi, r.psi),
            (m.confidence, r.confidence),
            (m.residual_height, r.residual_height),
        )
        same = all(
            np.asarray(a, np.float32).tobytes() == np.asarray(b, np.float32).tobytes()
            for a, b in maps
        )
        numbers = (
            (m.k_gain, r.k_gain),
            (m.flow_factor, self.flow_factor),
            (getattr(m, 'width_ratio', 0.0), self.width_ratio),  # older records do not have it
        )
        return same and all(np.float32(a) == np.float32(b) for a, b in numbers)

    @property
    def difference(self) -> tuple[float, float]:
        """RMS and largest difference of psi over the footprint."""
        old = np.asarray(self.recorded.psi, np.float32).reshape(self.spec.shape)
        d = (self.result.psi.astype(np.float32) - old)[self.core.footprint].astype(float)
        if not d.size:
            return 0.0, 0.0
        return float(np.sqrt(np.mean(d**2))), float(np.abs(d).max())


class Corrections:
    """Answers the recorded requests of one job in order; k_gain: in place of the recorded one, NaN = as recorded."""

    def __init__(self, params: CorrectionParams, k_gain: float = float('nan')) -> None:
        self.params, self._corrector, self._k_gain = params, Corrector(params), k_gain

    def one(self, call: Exchange, surface: MapAgain | None) -> PsiAgain:
        """surface: the map computed again, in place of the recorded one."""
        request, p = call.request, self.params
        spec = grid_from_msg(request.map.grid)
        if not np.isnan(self._k_gain):
            request = replace(request, k_gain=self._k_gain)
        core = convert.correction_input(request, spec, p.k_gain, p.k_gain_max)
        origin = convert.map_origin(request, call.ros_ns * 1e-9)
        if surface is not None:
            core = replace(core, z=surface.z.astype(float), sigma=surface.sigma.astype(float))
            origin = replace(origin, plausible=surface.plausible, reasons=surface.reasons)
        last = convert.last_layer(request, spec)
        learned = convert.learned_of(request)
        seen = convert.seen_width(request)
        a = self._corrector.answer(request.layer, core, origin, last, learned, seen)
        return PsiAgain(
            call.response.correction,
            spec,
            core,
            a.correction,
            a.flow_factor,
            a.estimate,
            a.width_ratio,
        )
