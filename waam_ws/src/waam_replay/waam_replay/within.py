"""Corrections within layers again, from the recorded requests: what was seen beside the arc is in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_adapt import answers
from waam_adapt.feed.feed_forward import Field
from waam_adapt.laws.corrector import CorrectionParams
from waam_adapt.types import Correction
from waam_node.conversions import grid_from_msg
from waam_process.grid import GridSpec
from waam_record.read_record import Exchange

from .recorded import RecordedCorrection
from .setpoints import FeedAgain


@dataclass
class RenewedAgain:
    """The correction of the rest of a layer: the recorded one (message) and the same computed again; feed: the
    setpoints that were computed from it, None when nobody asked."""

    recorded: RecordedCorrection
    spec: GridSpec
    result: Correction
    flow_factor: float
    width_ratio: float
    feed: FeedAgain | None = None

    @property
    def layer(self) -> int:
        """The layer that was being laid."""
        return self.recorded.layer

    @property
    def identical(self) -> bool:
        """psi and residual height, to the last bit of what was answered."""
        pairs = (
            (self.recorded.psi, self.result.psi),
            (self.recorded.residual_height, self.result.residual_height),
        )
        return all(_bits(a) == _bits(b) for a, b in pairs)

    @property
    def field(self) -> Field:
        """As it travels to the setpoints: rounded to what the message holds."""
        psi, residual = (
            v.astype(np.float32).astype(float)
            for v in (self.result.psi, self.result.residual_height)
        )
        k_gain = float(np.float32(self.result.k_gain))
        return Field(self.spec, psi, residual, k_gain, self.flow_factor, self.width_ratio)

    def belongs_to(self, correction: RecordedCorrection) -> bool:
        """Whether setpoints that were asked for with this correction are those of this answer."""
        same = self.recorded.layer == correction.layer
        return same and _bits(self.recorded.psi) == _bits(correction.psi)


def _bits(values: object) -> bytes:
    return np.asarray(values, np.float32).tobytes()


def renewed(calls: list[Exchange], params: CorrectionParams) -> list[RenewedAgain]:
    """Every answered request, in order."""
    made = []
    for call in calls:
        if call.response is None or call.response.error_code:
            continue
        found = answers.renewal_of(params, call.request)
        before = call.request.correction
        made.append(
            RenewedAgain(
                call.response.correction,
                grid_from_msg(before.grid),
                found.correction,
                float(np.float32(before.flow_factor)),
                float(np.float32(before.width_ratio)),
            )
        )
    return made
