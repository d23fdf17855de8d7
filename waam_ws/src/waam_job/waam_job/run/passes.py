"""Plans the passes of a job: the first from the surface as found, each further one from the scan before it."""

from __future__ import annotations

import numpy as np

from waam_plan.fill.linking import arc_starts
from waam_plan.finish import MACHINED
from waam_plan.plan import Plan
from waam_process.loop_mode import LoopMode

from ..model.cell import Scan
from ..model.goal import Code, JobError
from ..model.program import deviation_of
from ..model.stock import low_places, stock_of
from .context import JobContext
from .planning import check_ground, make_plan, wire_problems

MAX_TOP_UPS = 2  # what they do not bring above nominal, a third does not either


class Passes:
    """Fills the program. `ahead`: the plan of a build, when it was made before the machine was armed."""

    def __init__(self, context: JobContext) -> None:
        self.context = context
        self.program, self.journal, self.goal = context.program, context.journal, context.goal
        self.ahead: Plan | None = None

    def begin(self, scan: Scan) -> None:
        """The plan of pass 1 from the surface as found. JobError when there is nothing to do or no plate under it."""
        self.add(self._plan(scan))
        if not self.program.layers:
            raise JobError(
                Code.PLAN_FAILED,
                'nothing to deposit: the surface is nowhere below the nominal part',
            )
        if self.goal.mode == 'build':
            check_ground(self.program.current, scan.map)

    def next(self, scan: Scan) -> bool:
        """Plans what the scan finds missing. False when this was the last pass or nothing is missing.

        A part that is machined afterwards and does not clean up is topped up: a pass on what is below nominal.
        """
        done = self.program.done_after_pass
        if self.goal.layers and done >= self.goal.layers:
            return False
        if self.program.last_pass:
            return self._top_up(scan, done)
        self.measured(scan, done)
        plan = self._plan(scan)
        if not plan.layers:
            self.journal.note('INFO', 'height', 'nothing is missing any more', 'pass left out')
            return False
        self.add(plan)
        return True

    def _top_up(self, scan: Scan, done: int) -> bool:
        """Plans metal for what is below nominal; False where the part cleans up, or no more can be done."""
        first, number = self.program.first, self.program.top_ups + 1
        if first.settings.finish != MACHINED or self.goal.loop_mode != LoopMode.CLOSED_LOOP:
            return False
        if number > MAX_TOP_UPS or not scan.plausible:
            return False
        stock = stock_of(first, scan.map.z)
        if stock.cleans_up:
            return False
        try:
            plan = self._plan(scan, low_places(first, scan.map.z))
        except JobError as e:  # the part is laid: it is judged as it is
            self.journal.note('WARNING', 'height', f'{stock.text}; {e}', 'no top-up')
            return False
        if not plan.layers:
            text = f'{stock.text}; too narrow for a bead'
            self.journal.note('WARNING', 'height', text, 'no top-up')
            return False
        self.measured(scan, done)
        self.journal.note('INFO', 'height', stock.text, f'top-up {number} there')
        self.add(plan)
        return True

    def measured(self, scan: Scan, layer: int) -> None:
        """Keeps what the pass that ends with this scan, after `layer`, has reached."""
        target, tolerance = self.program.target_after(layer), self.goal.tolerance
        found = deviation_of(self.program.current, scan.map.z, target, tolerance)
        self.program.records[-1].measured(found)
        self.journal.keep()

    def add(self, plan: Plan, keep: bool = True) -> None:
        """Makes a plan the next pass; `keep` writes it into the folder."""
        self.program.add(plan)
        if keep:
            self.journal.plan(plan, self.program.pass_number)
        status = self.journal.status
        status.layers, status.pass_number = self.program.total, self.program.pass_number
        status.passes = max(status.passes, status.pass_number)

    def _plan(self, scan: Scan, low: np.ndarray | None = None) -> Plan:
        laid = self.program.layers if self.program.planned else []
        below = arc_starts(laid[-1].segments) if laid else None
        plan = self.ahead or make_plan(
            self.context.checked,
            self.context.plan_settings(),
            scan.map,
            laid=self.program.offset + len(laid),
            below=below,
            low=low,
        )
        if short := wire_problems(plan.wire, self.journal.wire_left):
            raise short[0]
        for text in plan.remarks:
            self.journal.note('INFO', 'height', text, 'none')
        for text in plan.warnings:
            self.journal.note('WARNING', 'height', text, 'none')
        return plan
