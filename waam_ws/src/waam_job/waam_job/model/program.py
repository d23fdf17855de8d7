"""The plans of a job's passes, with layers numbered through, and what each pass was to do and did."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.lay.forecast import growth
from waam_plan.plan import Plan, PlannedLayer

from .geometry import Deviation


@dataclass
class PassRecord:
    """Set height and errors of one pass (m): the a-posteriori table of the report (source 004).

    Means over the cells that the pass adds metal to: set_height is what the plan before it had left for it (pass 1:
    what it is planned to add), corrected_height what it adds after the scan, that is with what was missing.
    predicted_rms: surface that the planner's process model makes of the plan, and measured_*: surface after the pass,
    both against the pass's own target over the interior. NaN: not known, or no such thing.
    """

    pass_number: int
    layers: int
    set_height: float
    corrected_height: float
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
        self.arc_time_before = 0.0  # s, of the layers of the passes before
        self.plan: Plan | None = None
        self.whole: Plan | None = (
            None  # of pass 1: the region and the surface that the job is judged by
        )
        self.records: list[PassRecord] = []
        self._plans: list[Plan] = []

    def add(self, plan: Plan) -> None:
        """The next pass. Its layers get numbers that go on from the last one laid."""
        before, done = self.plan, self.here if self.plan else 0
        self.offset += done
        self.arc_time_before += sum(p.arc_time for p in self.layers) if before else 0.0
        self.pass_number += 1
        self.whole = self.whole or plan
        self.plan = _shifted(plan, self.offset)
        self._plans.append(self.plan)
        self.records.append(self._record(before.layers[done:] if before else []))

    def remember(self, records: list[dict]) -> None:
        """What the passes have reached, from records.json of an interrupted job."""
        for mine in self.records:
            for r in records:
                if r.get('pass_number') == mine.pass_number:
                    known = (r.get('measured_rms'), r.get('measured_mean'))
                    mine.measured_rms, mine.measured_mean = (
                        math.nan if v is None else float(v) for v in known
                    )

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

    def _record(self, left: list[PlannedLayer]) -> PassRecord:
        """left: layers that the plan before this one had still to lay, none for pass 1."""
        adds = _sum(p.planned for p in self.layers)
        on = adds > 0
        if not on.any():
            return PassRecord(self.pass_number, 0, 0.0, math.nan, math.nan)
        height, before = float(adds[on].mean()), math.nan
        if left:
            before = float(_sum(p.planned for p in left[: self.here])[on].mean())
        predicted = self._predicted()
        if self.pass_number == 1:
            return PassRecord(1, self.here, height, math.nan, predicted)
        return PassRecord(self.pass_number, self.here, before, height, predicted)

    def _predicted(self) -> float:
        """RMS (m) over the interior of what the process model makes of this pass, against its target."""
        plan = self.plan
        if plan.mode == 'build':
            return math.nan
        surface = plan.as_found.z + _sum(growth(p, plan.spec, plan.settings) for p in self.layers)
        error = (surface - self.target_after(self.layers[-1].number))[plan.interior]
        error = error[np.isfinite(error)]
        return float(np.sqrt(np.mean(error**2))) if error.size else math.nan


def _sum(maps: Iterable[np.ndarray]) -> np.ndarray:
    """Of (rows, cols) maps; a scalar 0 of none."""
    return np.sum(list(maps), axis=0)


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
