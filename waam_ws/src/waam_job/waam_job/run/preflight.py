"""What can be known before the machine is armed: reach, scans, the plan of a build, wire, limits of other nodes."""

from __future__ import annotations

import math

import numpy as np

from waam_plan.import_gcode.place import path_box
from waam_plan.mesh.part import PartError, check_fits
from waam_plan.mesh.placed import check_whole
from waam_plan.plan import Plan, PlanError, check_points
from waam_plan.settings import PlanSettings
from waam_process.loop_mode import LoopMode

from ..model.goal import Code, JobError
from ..model.limits import k_gain_limit
from . import work_frame
from .context import JobContext
from .part_scanner import PartScanner
from .planning import build_ahead


class Preflight:
    """`plan` is that of a build; that of a restoration needs the scan."""

    def __init__(self, context: JobContext, scanner: PartScanner) -> None:
        self.context, self.scanner = context, scanner
        self.cell, self.checked, self.goal = context.cell, context.checked, context.goal
        self.plan: Plan | None = None

    def problems(self, resumed: list[JobError] | None = None) -> list[JobError]:
        """Everything that is wrong with the job on this machine. The reach is left out while it is not known.

        resumed: what is wrong with the plan of a job that goes on; None = there is no plan yet.
        """
        found = self._gain() + self._tilt()
        if not work_frame.reach_known(self.cell.machine()):
            return found
        settings = self.context.plan_settings()
        found += self._plan(settings) if resumed is None else resumed
        return found + self._scans(settings)

    def _plan(self, settings: PlanSettings) -> list[JobError]:
        """For a build the whole plan, for a restoration whether the part fits."""
        if self.goal.mode != 'build':
            return self._fits(settings)
        spool = self.context.journal.wire_left
        self.plan, wrong = build_ahead(self.checked, settings, self.scanner.spec, spool)
        return wrong

    def _gain(self) -> list[JobError]:
        """A correction server refuses more authority than its limit, but only in the first layer."""
        limit = k_gain_limit(self.cell.parameters())
        if self.goal.loop_mode == LoopMode.OPEN_LOOP or not self.goal.k_gain > limit:
            return []
        text = (
            f'k_gain is {self.goal.k_gain:g}, the correction server allows {limit:g} (k_gain_max)'
        )
        return [JobError(Code.BAD_GOAL, text)]

    def _tilt(self) -> list[JobError]:
        """The positioner stands as the plan has it; a gantry has none."""
        wanted = self.context.plan_settings().tilt_deg
        bridge = self.cell.parameters().get('bridge') or self.cell.parameters().get('robot_bridge')
        stands = math.degrees(float((bridge or {}).get('tilt', 0.0)))
        if abs(wanted - stands) < 1e-3:
            return []
        text = (
            f'the plan is for a part tilted by {wanted:g} deg (tilt_deg), the positioner of the bridge stands at '
            f'{stands:g} deg (parameter tilt)'
        )
        return [JobError(Code.BAD_GOAL, text)]

    def _fits(self, settings: PlanSettings) -> list[JobError]:
        part, program = self.checked.part, self.checked.program
        try:
            if program is not None:
                check_points(path_box(program), settings)
            elif part is not None:
                check_fits(part, settings)
                check_whole(part, self.scanner.spec, self.checked.offset)
        except (PartError, PlanError) as e:
            return [JobError(Code.PLAN_FAILED, str(e))]
        return []

    def _scans(self, settings: PlanSettings) -> list[JobError]:
        """The lowest and the highest scan of the job, from anywhere in the machine."""
        highest = [float(np.nanmax(self.plan.nominal.z))] if self.plan else []
        for top in (0.0, *highest):
            try:
                self.scanner.path(top, settings, settings.machine_max)
            except JobError as e:
                return [e]
        return []
