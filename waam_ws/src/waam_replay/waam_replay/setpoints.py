"""Setpoints again, from the recorded segments and a correction map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_adapt import conversions as convert
from waam_adapt.feed.feed_forward import Field, Limits, Path, Setpoints, compute
from waam_adapt.feed.params import FeedParams
from waam_process import materials
from waam_record.read_record import Exchange

from .corrections import PsiAgain
from .parameters import JobParams

COMPARED = ('speed', 'wire_feed_speed', 'voltage', 'wire_feed_base', 'psi', 'residual_height')


@dataclass(frozen=True)
class FeedAgain:
    """The setpoints of one layer: `recorded` and `result` have one entry per segment in each of `COMPARED`."""

    layer: int
    path: Path
    recorded: dict[str, np.ndarray]
    result: Setpoints

    @property
    def deposit(self) -> np.ndarray:
        """(n,) bool, segments that lay metal."""
        return self.result.deposit

    @property
    def identical(self) -> bool:
        """Speed, feed, voltage and their terms of every segment that deposits, to the last bit."""
        d = self.deposit
        return all(
            self.recorded[n][d].tobytes() == getattr(self.result, n)[d].tobytes() for n in COMPARED
        )

    def difference(self, name: str) -> tuple[float, float]:
        """RMS and largest difference of one setpoint over the segments that deposit, SI."""
        d = getattr(self.result, name)[self.deposit] - self.recorded[name][self.deposit]
        if not d.size:
            return 0.0, 0.0
        return float(np.sqrt(np.mean(d**2))), float(np.abs(d).max())


def field_of(again: PsiAgain) -> Field:
    """The correction as it travels: rounded to what the message holds."""

    def rounded(values: np.ndarray) -> np.ndarray:
        return values.astype(np.float32).astype(float)

    r = again.result
    k_gain, flow = float(np.float32(r.k_gain)), float(np.float32(again.flow_factor))
    ratio = float(np.float32(again.width_ratio))
    return Field(again.spec, rounded(r.psi), rounded(r.residual_height), k_gain, flow, ratio)


def one(call: Exchange, again: PsiAgain | None, params: FeedParams, job: JobParams) -> FeedAgain:
    """again: the correction computed again; None when the job asked for none (open loop)."""
    request = call.request
    material = materials.get(request.material, params.materials_file or None)
    limits = Limits.of(
        material, (params.speed_min, params.speed_max), (params.feed_min, params.feed_max)
    )
    path, voltage = convert.path_from_msgs(request.segments)
    volts = np.where(voltage > 0, voltage, material.voltage)
    heat = request.heat_factor if np.isnan(job.heat_factor) else job.heat_factor
    apply = request.apply_correction and job.apply_correction
    field = field_of(again) if again is not None and len(request.correction.psi) else None
    result = compute(
        path,
        material,
        limits,
        voltage=volts,
        correction=field,
        apply=apply,
        heat_factor=heat,
    )
    answered = call.response.segments
    recorded = {n: np.array([getattr(s, n) for s in answered], float) for n in COMPARED}
    layer = int(answered[0].layer) if len(answered) else 0
    return FeedAgain(layer, path, recorded, result)
