"""What can be known before the machine is armed: reach, scans, the plan of a build, wire, limits of other nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from waam_plan.mesh.part import PartError, check_fits
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings
from waam_process.names import OPEN_LOOP

from ..model.goal import Code, JobError
from ..model.limits import k_gain_limit
from .planning import build_ahead

if TYPE_CHECKING:
    from .runner import JobRunner


class Foresight:
    """Works on a runner. `plan` is that of a build; that of a restoration needs the scan."""

    def __init__(self, runner: JobRunner) -> None:
        self.runner = runner
        self.plan: Plan | None = None

    def problems(self) -> list[JobError]:
        """Everything that is wrong with the job on this machine; nothing of the reach while that is not known."""
        found = self._gain()
        preparation = self.runner.preparation
        if not preparation.reach_known():
            return found
        settings = preparation.plan_settings()
        pick_up = self.runner.pick_up
        if pick_up and pick_up.planned:
            found += pick_up.wire_problems()
        elif self.runner.goal.mode == 'build':
            spec, spool = self.runner.surveyor.spec, self.runner.journal.wire_left
            self.plan, wrong = build_ahead(self.runner.checked, settings, spec, spool)
            found += wrong
        else:
            found += self._fits(settings)
        return found + self._scans(settings)

    def _gain(self) -> list[JobError]:
        """A correction server refuses more authority than its limit, but only in the first layer."""
        goal = self.runner.goal
        limit = k_gain_limit(self.runner.cell.parameters())
        if goal.profile == OPEN_LOOP or not goal.k_gain > limit:
            return []
        text = f'k_gain is {goal.k_gain:g}, the correction server allows {limit:g} (k_gain_max)'
        return [JobError(Code.BAD_GOAL, text)]

    def _fits(self, settings: PlanSettings) -> list[JobError]:
        try:
            check_fits(self.runner.checked.part, settings)
        except PartError as e:
            return [JobError(Code.PLAN_FAILED, str(e))]
        return []

    def _scans(self, settings: PlanSettings) -> list[JobError]:
        """The lowest and the highest scan of the job, from anywhere in the machine."""
        highest = [float(np.nanmax(self.plan.nominal.z))] if self.plan else []
        for top in (0.0, *highest):
            try:
                self.runner.surveyor.path(top, settings, settings.machine_max)
            except JobError as e:
                return [e]
        return []
