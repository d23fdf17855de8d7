"""The job: prepare, scan, plan, then per layer cool - scan - correct - set - deposit, final scan, report data.

Pure: everything outside goes through `Cell`. The state machine is drawn in docs/job.md.
"""

from __future__ import annotations

from dataclasses import replace

from ..model.cell import Cell, Scan
from ..model.geometry import Deviation
from ..model.goal import Checked, Code, JobError
from ..model.records import State, Status
from ..model.verdict import Verdict
from ..store.folder import JobFolder
from . import closing
from .context import JobContext
from .control import Control
from .layer_cycle import LayerCycle
from .learning import Learning
from .outlook import Outlook
from .part_scanner import PartScanner
from .passes import Passes
from .preflight import Preflight
from .preparation import Preparation
from .resume_run import ResumeRun
from .settings import Settings
from .verdict import judge


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
        self.context = context = JobContext.create(
            cell, checked, folder, control=control, settings=settings, run=run
        )
        self.journal = context.journal
        self.preparation = Preparation(context)
        self.scanner = PartScanner(context)
        self.passes = Passes(context)
        self.preflight = Preflight(context, self.scanner)
        self.learning = Learning(context)
        self.outlook = Outlook(context)
        self.cycle = LayerCycle(context, self.scanner, self.preparation, self.learning)
        self.resume = ResumeRun(context, self.scanner, self.passes, self.cycle) if run > 1 else None
        self.verdict = Verdict(settings.share_in_tolerance, checked.goal.tolerance)

    def run(self) -> Status:
        """Returns the final status; errors end up in it (and in the folder), they are not raised."""
        try:
            self.journal.state(State.PREPARING, 'checking cell, part and plan')
            self._check()
            self._prepare()
            scan, first = self._begin()
            self._finish(self._lay(scan, first))
        except JobError as e:
            closing.fail(self.context, e)
        except (
            Exception
        ) as e:  # a fault of this software: reported, and the machine is left in order
            closing.fail(self.context, JobError(Code.UNKNOWN, f'{type(e).__name__}: {e}'))
            raise
        finally:
            self._release()
        return self.status

    def _check(self) -> None:
        """JobError with everything that can be known to be wrong before anything moves."""
        resumed = self.resume.load() if self.resume else None
        cell, job = self.preparation.not_ready(), self.preflight.problems(resumed)
        self.passes.ahead = self.preflight.plan
        if cell or job:
            code = Code.MACHINE_NOT_READY if cell else job[0].code
            raise JobError(code, '; '.join([*cell, *map(str, job)]))

    def _prepare(self) -> None:
        context, journal = self.context, self.journal
        journal.started = context.cell.now()  # only now is there a clock for certain
        journal.remarks = self.preparation.remarks()
        self.learning.begin()
        journal.say('; '.join(['arming and homing', *journal.remarks]))
        goal = context.goal
        custom = (f'job_id={context.run_id}', f'loop_mode={goal.loop_mode}', *goal.notes)
        self.preparation.run(context.record_folder, custom)

    def _begin(self) -> tuple[Scan, int]:
        """The scan to begin with and the number of the first layer."""
        if self.resume and (found := self.resume.run()):
            return found
        scan = self.scanner.scan_after(0, required=True)
        self.passes.begin(scan)
        return scan, 1

    def _lay(self, scan: Scan, first: int) -> Scan:
        """All layers from number `first` on, through all passes."""
        while True:
            for layer in self.context.program.layers:
                if layer.number >= first:
                    believed = scan.plausible
                    scan = self.cycle.lay(layer, scan)
                    laid = self.cycle.history
                    before = laid.surface if believed else None
                    self.outlook.after(layer, scan, before, laid.growth, laid.skipped)
            if not self.passes.next(scan):
                return scan

    def _finish(self, scan: Scan) -> None:
        self.journal.state(State.FINISHING)
        self.passes.measured(scan, self.context.program.layers[-1].number)
        self.verdict = judge(self.context, scan)
        self.learning.finish()
        self.journal.state(State.DONE, self.verdict.text)

    def _release(self) -> None:
        if self.status.state != State.DONE:  # what failed after the last scan has failed
            self.verdict = replace(self.verdict, final=None)
        closing.release(self.context, self.verdict)

    @property
    def status(self) -> Status:
        """Where the job stands."""
        return self.context.status

    @property
    def final(self) -> Deviation | None:
        """Of the last scan from the surface that was wanted; None when the job did not come so far."""
        return self.verdict.final

    @property
    def in_tolerance(self) -> bool:
        """Verdict of the finished job (finish machined: it cleans up); False before."""
        return self.verdict.good
