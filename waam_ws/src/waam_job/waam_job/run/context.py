"""What the pieces of a running job share."""

from __future__ import annotations

from dataclasses import dataclass

from waam_node import job_folder
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings
from waam_process.segment import Point

from ..model.cell import Cell, Scan
from ..model.goal import Checked, JobGoal
from ..model.program import Program
from ..model.records import Status
from ..store.folder import JobFolder
from ..store.journal import Following, Journal
from . import work_frame
from .control import Control
from .motion import Motion
from .settings import Settings
from .watch import Watch


@dataclass(frozen=True)
class JobContext:
    """One run of one job. The pieces take what they need of it when they are made."""

    cell: Cell
    checked: Checked  # the goal, with part and material
    settings: Settings
    control: Control  # what the operator asks for
    journal: Journal  # status, records and files of the job
    program: Program  # plans of all passes
    watch: Watch  # reacts to faults wherever the job waits
    motion: Motion  # hands segments to the bridge
    run: int  # 1 = first start of the job
    run_id: str  # name of this run in messages to other nodes

    @classmethod
    def create(
        cls,
        cell: Cell,
        checked: Checked,
        folder: JobFolder,
        *,
        control: Control,
        settings: Settings,
        run: int,
    ) -> JobContext:
        """Makes everything that a run starts with."""
        run_id = job_folder.run_id(folder.job_id, run)
        program = Program(checked.goal.passes)
        journal = Journal(
            cell, checked.goal, folder, run, program.records, material=checked.material
        )
        watch = Watch(cell, control, settings.limits, journal.note, journal.paused)
        return cls(
            cell=cell,
            checked=checked,
            settings=settings,
            control=control,
            journal=journal,
            program=program,
            watch=watch,
            motion=Motion(cell, watch, run_id),
            run=run,
            run_id=run_id,
        )

    @property
    def goal(self) -> JobGoal:
        """What was asked for, after its check."""
        return self.checked.goal

    @property
    def status(self) -> Status:
        """Where the job stands; belongs to the journal, which publishes it."""
        return self.journal.status

    @property
    def plan(self) -> Plan:
        """Of the pass that is being laid."""
        return self.program.current

    @property
    def record_folder(self) -> str:
        """Of this run; the recorder knows the recording by it."""
        return str(self.journal.folder.path / job_folder.record(self.run))

    @property
    def work_zero(self) -> Point:
        """Machine coordinates of the part's lower corner."""
        return work_frame.work_zero(self.goal, self.settings)

    def keep_scan(self, scan: Scan, following: Following) -> None:
        """The surface before a layer goes into the folder, with what the layer is asked for."""
        number = following.layer.number - 1
        target = self.program.target_after(number)
        self.journal.scan(number, scan, self.program.current, target, following)

    def plan_settings(self) -> PlanSettings:
        """What the planner needs of goal, material and machine."""
        return work_frame.plan_settings(self.checked, self.settings, self.cell.machine())

    def note_remarks(self) -> None:
        """What the operator changed elsewhere becomes part of the job's record."""
        for text in self.control.take_remarks():
            self.journal.note('INFO', 'operator', text, 'none')
        self.journal.heard()
