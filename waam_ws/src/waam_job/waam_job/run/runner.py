"""The job: prepare, scan, plan, then per layer cool - scan - correct - set - deposit, final scan, report data.

Pure: everything outside goes through `Cell`. The state machine is drawn in docs/job.md.
"""

from __future__ import annotations

import numpy as np

from waam_node import job_folder
from waam_plan.fill.linking import arc_starts
from waam_plan.plan import Plan

from ..model.cell import Cell, Scan
from ..model.geometry import Deviation, deviation
from ..model.goal import Checked, Code, JobError
from ..model.program import Program
from ..model.records import State, Status
from ..store.folder import JobFolder
from ..store.journal import Journal
from .control import Control
from .layer_cycle import CLOSED_LOOP, LayerCycle
from .motion import Motion
from .part_scanner import Surveyor
from .planning import make_plan, wire_problems
from .preflight import Foresight
from .preparation import Preparation
from .resume_run import PickUp
from .settings import Settings
from .verdict import Ending
from .watch import Watch


class JobRunner:
    """Runs one checked goal on a cell and leaves a complete job folder, whatever happens.

    run: 1 = a new job; above, the job in `folder` goes on where its surface says that it stopped.
    """

    def __init__(
        self,
        cell: Cell,
        checked: Checked,
        folder: JobFolder,
        control: Control,
        settings: Settings,
        run: int = 1,
    ) -> None:
        self.cell, self.checked, self.goal = cell, checked, checked.goal
        self.control, self.settings, self.run_number = control, settings, run
        # towards the other nodes every run is a job of its own: its segments count from 1, its maps start anew
        self.run_id = job_folder.run_id(folder.job_id, run)
        self.journal = Journal(cell, checked.goal, folder, run)
        self.watch = Watch(cell, control, settings.limits, self.journal.note, self.journal.paused)
        self.motion = Motion(cell, self.watch, self.run_id)
        self.preparation = Preparation(cell, self.motion, checked, settings)
        self.surveyor = Surveyor(
            cell,
            self.motion,
            self.journal,
            checked,
            self.run_id,
            settings.resolution,
            settings.margin,
        )
        self.program = Program(self.goal.passes)
        self.journal.passes = self.program.records
        self.pick_up = PickUp(self) if run > 1 else None
        self.foresight = Foresight(self)
        self.cycle = LayerCycle(self)
        self.ending = Ending(self)

    @property
    def status(self) -> Status:
        return self.journal.status

    @property
    def plan(self) -> Plan:
        """Of the pass that is being laid."""
        return self.program.plan

    def run(self) -> Status:
        """Returns the final status; errors end up in it (and in the folder), they are not raised."""
        try:
            self.journal.state(State.PREPARING, 'checking cell, part and plan')
            custom = (f'job_id={self.run_id}', f'profile={self.goal.profile}', *self.goal.notes)
            record = str(self.journal.folder.path / job_folder.record(self.run_number))
            self._check()
            self.journal.started = self.cell.now()  # only now is there a clock for certain
            self.journal.remarks = self.preparation.remarks()
            self.journal.say('; '.join(['arming and homing', *self.journal.remarks]))
            self.preparation.run(self.run_id, record, custom)
            scan, first = self.pick_up.run() if self.pick_up else self.begin()
            self._finish(self._lay(scan, first))
            self.journal.state(State.DONE, self.ending.verdict_text())
        except JobError as e:
            self.ending.fail(e)
        except (
            Exception
        ) as e:  # a fault of this software: told as such, and the machine is left in order
            self.ending.fail(JobError(Code.UNKNOWN, f'{type(e).__name__}: {e}'))
            raise
        finally:
            self._release()
        return self.status

    def _check(self) -> None:
        """JobError with everything that can be known to be wrong before anything moves."""
        if self.pick_up:
            self.pick_up.load()
        cell, job = self.preparation.not_ready(), self.foresight.problems()
        if cell or job:
            code = Code.MACHINE_NOT_READY if cell else job[0].code
            raise JobError(code, '; '.join([*cell, *map(str, job)]))

    def begin(self) -> tuple[Scan, int]:
        """Scan as found and the plan of pass 1. Returns the scan and the number of the first layer."""
        scan = self.survey(0, required=True)
        self.add_pass(self._make_plan(scan))
        if not self.plan.layers:
            raise JobError(
                Code.PLAN_FAILED,
                'nothing to deposit: the surface is nowhere below the nominal part',
            )
        return scan, 1

    # ---- planning ------------------------------------------------------------------------------

    def _make_plan(self, scan: Scan) -> Plan:
        program, settings = self.program, self.preparation.plan_settings()
        laid = program.layers if program.plan else []
        below = arc_starts(laid[-1].segments) if laid else None
        plan = self.foresight.plan or make_plan(
            self.checked, settings, scan.map, program.offset + len(laid), below
        )
        if short := wire_problems(plan.wire, self.journal.wire_left):
            raise short[0]
        for text in plan.warnings:
            self.journal.note('WARNING', 'height', text, 'none')
        return plan

    def add_pass(self, plan: Plan, keep: bool = True) -> None:
        """Makes a plan the next pass; `keep` writes it into the folder."""
        self.program.add(plan)
        if keep:
            self.journal.plan(plan, self.program.pass_number)
        self.status.layers = self.program.total
        self.status.pass_number = self.program.pass_number

    def _next_pass(self, scan: Scan) -> bool:
        """Plans what the scan finds missing. False when this was the last pass or nothing is missing."""
        program, goal = self.program, self.goal
        done = program.offset + program.here
        if program.last_pass or (goal.layers and done >= goal.layers):
            return False
        self._note_pass(scan, done)
        plan = self._make_plan(scan)
        if not plan.layers:
            self.journal.note('INFO', 'height', 'nothing is missing any more', 'pass left out')
            return False
        self.add_pass(plan)
        return True

    def _note_pass(self, scan: Scan, done: int) -> None:
        """Keeps what the pass that ends with this scan has reached."""
        self.program.records[-1].measured(
            self.deviation(scan.map.z, self.program.target_after(done))
        )
        self.journal.keep()

    # ---- layers --------------------------------------------------------------------------------

    def _lay(self, scan: Scan, first: int) -> Scan:
        """All layers from number `first` on, through all passes."""
        while True:
            for layer in self.program.layers:
                if layer.number >= first:
                    scan = self.cycle.lay(layer, scan)
            if not self._next_pass(scan):
                return scan

    # ---- scanning ------------------------------------------------------------------------------

    def survey(self, layer: int, required: bool = False) -> Scan:
        """The surface after `layer` layers, with its deviation in the status."""
        top = self.program.built_height(layer) if self.program.plan else 0.0
        scan = self.surveyor.scan(layer, top, self.preparation.plan_settings(), required)
        if self.program.plan is not None:
            found = self.deviation(scan.map.z, self.program.target_after(layer))
            self.status.height_error_rms, self.status.height_error_max = found.rms, found.max
            self.cell.status(self.status)
            if layer and found.max > self.settings.height_warning:
                self._note_height(layer, scan)
        return scan

    def _note_height(self, layer: int, scan: Scan) -> None:
        """The place where the surface is farthest from what was wanted."""
        wanted = self.program.target_after(layer)
        error = np.where(self.plan.interior, scan.map.z - wanted, np.nan)
        row, col = np.unravel_index(np.nanargmax(np.abs(error)), error.shape)
        spec = scan.map.spec
        place = (float(spec.x[col]), float(spec.y[row]), float(scan.map.z[row, col]))
        ended = layer >= self.program.total
        closed = self.goal.profile == CLOSED_LOOP and not ended
        self.journal.note(
            'WARNING',
            'height',
            f'{error[row, col] * 1e3:+.2f} mm after layer {layer}',
            'the next layer corrects it' if closed else 'none',
            place,
        )

    def deviation(self, z: np.ndarray, target: np.ndarray, whole: bool = False) -> Deviation:
        """Of a surface from its target, over this pass's region or the whole job's."""
        plan = self.program.whole if whole else self.plan
        wanted = np.isfinite(target)
        return deviation(
            z - target, plan.region & wanted, plan.interior & wanted, self.goal.tolerance
        )

    def note_remarks(self) -> None:
        """What the operator changed elsewhere becomes part of the job's record."""
        for text in self.control.take_remarks():
            self.journal.note('INFO', 'operator', text, 'none')
        self.journal.heard()

    # ---- the end -------------------------------------------------------------------------------

    def _finish(self, scan: Scan) -> None:
        self.journal.state(State.FINISHING)
        self._note_pass(scan, self.program.layers[-1].number)
        self.ending.judge(scan)

    def _release(self) -> None:
        self.ending.release()

    @property
    def final(self) -> Deviation | None:
        """Of the last scan from the surface that was wanted; None when the job did not come so far."""
        return self.ending.final

    @property
    def in_tolerance(self) -> bool:
        return self.ending.in_tolerance
