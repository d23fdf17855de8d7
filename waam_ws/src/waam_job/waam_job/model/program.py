"""The plans of a job's passes, with layers numbered through, and what each pass was to do and did."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.plan import Plan, PlannedLayer

from .geometry import Deviation, deviation


@dataclass
class PassRecord:
    """Set height and errors of one pass: the a-posteriori table of the report (source 004).

    In m. Heights are means over the grid cells that the pass adds metal to, errors are against the pass's own target
    over the interior. NaN: not known or not applicable.
    """

    pass_number: int
    layers: int
    # what the plan before left for this pass; in pass 1, what it is planned to add
    set_height: float
    corrected_height: float  # what the pass adds after the scan, including what was missing
    measured_rms: float = math.nan  # of the scan after the pass
    measured_mean: float = math.nan  # of the scan after the pass
    # thickness of the layers and why, in words; '' = the planner had nothing to choose
    schedule: str = ''

    def measured(self, found: Deviation) -> None:
        """Errors of the surface after the pass, m."""
        self.measured_rms, self.measured_mean = found.rms, found.mean


class Program:
    """`passes` plans, made one after the other from the scan before each. Pass p lays an even share of what is left."""

    def __init__(self, passes: int) -> None:
        self.passes = max(1, passes)
        self.pass_number = 0
        self.offset = 0  # layers of the passes before
        self.arc_time_before = 0.0  # s, of the layers of the passes before
        self.plan: Plan | None = None
        self.whole: Plan | None = None  # of pass 1
        self.records: list[PassRecord] = []
        self._plans: list[Plan] = []

    def add(self, plan: Plan) -> None:
        """The next pass. Its layers get numbers that go on from the last one laid."""
        left: list[PlannedLayer] = []
        if self.plan is not None:
            done = self.here
            left = self.plan.layers[done:]
            self.offset += done
            self.arc_time_before += sum(p.arc_time for p in self.plan.layers[:done])
        self.pass_number += 1
        self.whole = self.whole or plan
        self.plan = _shifted(plan, self.offset)
        self._plans.append(self.plan)
        self.records.append(self._record(left))

    def remember(self, records: list[dict]) -> None:
        """What the passes have reached, from records.json of an interrupted job."""
        for mine in self.records:
            for r in records:
                if r.get('pass_number') == mine.pass_number:
                    known = (r.get('measured_rms'), r.get('measured_mean'))
                    mine.measured_rms, mine.measured_mean = (
                        math.nan if v is None else float(v) for v in known
                    )
                    mine.schedule = mine.schedule or str(r.get('schedule') or '')

    @property
    def planned(self) -> bool:
        """Whether there is a plan yet."""
        return self.plan is not None

    @property
    def current(self) -> Plan:
        """Of the pass that is being laid. RuntimeError while nothing is planned."""
        if self.plan is None:
            raise RuntimeError('nothing is planned yet')
        return self.plan

    @property
    def first(self) -> Plan:
        """Of pass 1: the region and the surface that the job is judged by. RuntimeError while nothing is planned."""
        if self.whole is None:
            raise RuntimeError('nothing is planned yet')
        return self.whole

    @property
    def done_after_pass(self) -> int:
        """Layers that lie on the part when this pass is laid."""
        return self.offset + self.here

    @property
    def here(self) -> int:
        """Layers that this pass lays."""
        return math.ceil(len(self.current.layers) / max(1, self.passes - self.pass_number + 1))

    @property
    def last_pass(self) -> bool:
        """No pass follows the one that is being laid."""
        return self.pass_number >= self.passes

    @property
    def top_ups(self) -> int:
        """Passes beyond those that were asked for: top-up layers where a machined part does not clean up."""
        return max(0, self.pass_number - self.passes)

    @property
    def layers(self) -> list[PlannedLayer]:
        """Those that this pass lays."""
        return self.current.layers[: self.here]

    @property
    def total(self) -> int:
        """Layers of the whole job, as far as planned."""
        return self.offset + len(self.current.layers)

    def layer(self, number: int) -> PlannedLayer:
        """Layer `number` of the job, also of an earlier pass."""
        return next(p for plan in reversed(self._plans) for p in plan.layers if p.number == number)

    def thickness(self, number: int) -> float:
        """Median metal of layer `number` as it is planned now, m; 0 where there is none."""
        found = [p.planned[p.planned > 0] for p in self.current.layers if p.number == number]
        return float(np.median(found[0])) if found and found[0].size else 0.0

    def metal_after(self, number: int) -> np.ndarray:
        """(rows, cols) m of metal that the layers above `number` are still to lay, as it is planned now."""
        rest = (p.planned for p in self.current.layers if p.number > number)
        return np.sum([np.zeros(self.current.spec.shape), *rest], axis=0)

    def target_after(self, number: int) -> np.ndarray:
        """Wanted surface after layer `number` of the job, (rows, cols) m, NaN = do not care."""
        layers, i = self.current.layers, max(0, number - self.offset)
        if i < len(layers):
            return layers[i].target_before
        return self.current.final_target

    @property
    def final_target(self) -> np.ndarray:
        """Surface that the job ends at, (rows, cols) m, NaN = do not care: that of pass 1, and of top-ups."""
        out = self.first.final_target
        for plan in self._plans[self.passes :]:
            out = np.where(np.isnan(out), out, np.fmax(out, plan.final_target))
        return out

    def built_height(self, number: int) -> float:
        """Highest wanted point after `number` layers, m; 0 before the first."""
        tops = [float(np.nanmax(p.target_after)) for p in self.current.layers if p.number <= number]
        return max(tops, default=0.0)

    def _record(self, left: list[PlannedLayer]) -> PassRecord:
        """left: layers that the plan before this one had still to lay, none for pass 1."""
        adds = _sum(p.planned for p in self.layers)
        on = adds > 0
        if not on.any():
            return PassRecord(
                self.pass_number,
                layers=0,
                set_height=0.0,
                corrected_height=math.nan,
            )
        height, before = float(adds[on].mean()), math.nan
        if left:
            before = float(_sum(p.planned for p in left[: self.here])[on].mean())
        first = self.pass_number == 1
        return PassRecord(
            self.pass_number,
            layers=self.here,
            set_height=height if first else before,
            corrected_height=math.nan if first else height,
            schedule='; '.join(self.current.remarks),
        )


def deviation_of(plan: Plan, z: np.ndarray, target: np.ndarray, tolerance: float) -> Deviation:
    """Of a surface z from its target, (rows, cols) m, over the plan's region and interior; tolerance in m."""
    wanted = np.isfinite(target)
    return deviation(z - target, plan.region & wanted, plan.interior & wanted, tolerance)


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
