"""The plans of a job's passes, with layers numbered through, and what each pass was to do and did."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.plan import Plan, PlannedLayer

from .geometry import Deviation


@dataclass
class PassRecord:
    """Set height and errors of one pass (m): the a-posteriori table of the report (source 004).

    set_height: mean metal that the pass is planned to add where it adds any. predicted_rms: what the plan itself leaves
    (places that it may not or cannot fill). measured_*: surface after the pass against the pass's own target.
    """

    pass_number: int
    layers: int
    set_height: float
    predicted_rms: float
    measured_rms: float = math.nan
    measured_mean: float = math.nan

    def measured(self, found: Deviation) -> None:
        self.measured_rms, self.measured_mean = found.rms, found.mean


class Program:
    """`passes` plans, made one after the other from the scan before each. Pass p lays an even share of what is left."""

    def __init__(self, passes: int) -> None:
        self.passes = max(1, passes)
        self.pass_number = 0
        self.offset = 0  # layers of the passes before
        self.plan: Plan | None = None
        self.whole: Plan | None = (
            None  # of pass 1: the region and the surface that the job is judged by
        )
        self.records: list[PassRecord] = []
        self._plans: list[Plan] = []

    def add(self, plan: Plan) -> None:
        """The next pass. Its layers get numbers that go on from the last one laid."""
        self.offset += self.here if self.plan else 0
        self.pass_number += 1
        self.whole = self.whole or plan
        self.plan = _shifted(plan, self.offset)
        self._plans.append(self.plan)
        self.records.append(self._record())

    @property
    def here(self) -> int:
        """Layers that this pass lays."""
        return math.ceil(len(self.plan.layers) / (self.passes - self.pass_number + 1))

    @property
    def last_pass(self) -> bool:
        return self.pass_number >= self.passes

    @property
    def layers(self) -> list[PlannedLayer]:
        """Those that this pass lays."""
        return self.plan.layers[: self.here]

    @property
    def total(self) -> int:
        """Layers of the whole job, as far as planned."""
        return self.offset + len(self.plan.layers)

    def layer(self, number: int) -> PlannedLayer:
        """Layer `number` of the job, also of an earlier pass."""
        return next(p for plan in reversed(self._plans) for p in plan.layers if p.number == number)

    def target_after(self, number: int) -> np.ndarray:
        """Wanted surface after layer `number` of the job, (rows, cols) m, NaN = do not care."""
        layers, i = self.plan.layers, max(0, number - self.offset)
        if i < len(layers):
            return layers[i].target_before
        return self.plan.final_target

    def built_height(self, number: int) -> float:
        """Highest wanted point after `number` layers, m; 0 before the first."""
        tops = [float(np.nanmax(p.target_after)) for p in self.plan.layers if p.number <= number]
        return max(tops, default=0.0)

    def _record(self) -> PassRecord:
        laid = np.sum([p.planned for p in self.layers], axis=0) if self.layers else np.zeros(1)
        if not (laid > 0).any():
            return PassRecord(self.pass_number, 0, 0.0, math.nan)
        left = (self.plan.as_found.z + laid - self.target_after(self.layers[-1].number))[
            self.plan.interior
        ]
        left = left[np.isfinite(left)]
        rms = float(np.sqrt(np.mean(left**2))) if left.size else math.nan
        return PassRecord(self.pass_number, self.here, float(laid[laid > 0].mean()), rms)


def _shifted(plan: Plan, offset: int) -> Plan:
    if not offset:
        return plan
    layers = [
        replace(
            p,
            number=p.number + offset,
            segments=[s.at(layer=s.layer + offset) for s in p.segments],
        )
        for p in plan.layers
    ]
    return replace(plan, layers=layers)
