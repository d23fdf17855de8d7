"""The end of a job: the verdict over the whole region, what a failure leaves, machine and folder in order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..model import tolerance_map
from ..model.cell import Scan
from ..model.geometry import Deviation
from ..model.goal import Code, JobError
from ..model.records import LayerRecord, State

if TYPE_CHECKING:
    from .runner import JobRunner


CLASS_OF = {  # of the anomaly that a failure leaves when nothing else has said what happened
    Code.MACHINE_NOT_READY: 'link',
    Code.PLAN_FAILED: 'height',
    Code.BAD_RESUME: 'height',
    Code.SCAN_FAILED: 'scan',
    Code.LINK_LOST: 'link',
    Code.TIMEOUT: 'link',
}


class Ending:
    """Works on a runner. `final` is None until the last scan was judged."""

    def __init__(self, runner: JobRunner) -> None:
        self.runner, self.cell = runner, runner.cell
        self.journal, self.goal = runner.journal, runner.goal
        self.as_found_rms = math.nan
        self.final: Deviation | None = None
        self.map: dict | None = None

    def judge(self, scan: Scan) -> None:
        """Judged by the region and the surface of the first plan, however many passes there were."""
        whole, number = self.runner.program.whole, self.runner.program.layers[-1].number
        target = whole.final_target
        self.journal.scan(number, scan, whole, target)
        self.final = self.runner.deviation(scan.map.z, target, whole=True)
        wanted = np.isfinite(target)
        region, inner = whole.region & wanted, whole.interior & wanted
        self.map = tolerance_map.write(
            self.journal.folder.path,
            scan.map.spec,
            scan.map.z - target,
            region,
            inner,
            self.goal.tolerance,
        )
        self.as_found_rms = self.runner.deviation(whole.as_found.z, target, whole=True).rms
        record = LayerRecord(
            job_id=self.runner.run_id,
            profile=self.goal.profile,
            layer=number,
            pass_number=self.runner.program.pass_number,
            final=True,
        )
        record.add_errors((scan.map.z - target)[whole.interior])
        record.add_scan(scan)
        record.temperature = self.cell.heat().temperature
        self.journal.layer(record)
        self.journal.status.progress, self.journal.status.time_left = 1.0, 0.0

    def fail(self, error: JobError) -> None:
        self.journal.status.error_code = int(error.code)
        aborted = error.code == Code.ABORTED
        if aborted:
            self.journal.note('WARNING', 'operator', str(error), 'arc ended, queue dropped')
        elif not self.journal.faulted:
            self.journal.note('FAULT', CLASS_OF.get(error.code, 'node'), str(error), 'job ended')
        self.journal.state(State.ABORTED if aborted else State.FAILED, str(error))

    def release(self) -> None:
        """Leaves machine and folder in order; what cannot be done is written down, not raised."""
        if self.journal.status.state != State.DONE:
            self._try(lambda: self.cell.command('STOP'))
        self._try(lambda: self.cell.command('DISARM'))
        self._try(lambda: self.cell.record(False, ''))
        self.runner.note_remarks()
        self.journal.report(self.in_tolerance, self.final, self.as_found_rms, self.map)

    def _try(self, step) -> None:
        try:
            step()
        except JobError as e:
            self.journal.note('WARNING', 'link', f'at the end of the job: {e}', 'none')

    @property
    def in_tolerance(self) -> bool:
        done = self.final is not None and self.journal.status.state == State.DONE
        return done and self.final.share_in_tolerance >= self.runner.settings.share_in_tolerance

    def verdict_text(self) -> str:
        f = self.final
        return (
            f'RMS {f.rms * 1e3:.3f} mm, {f.share_in_tolerance * 100:.1f} % of the interior within '
            f'+-{self.goal.tolerance * 1e3:.2f} mm'
        )
