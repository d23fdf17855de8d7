"""The job: prepare, scan, plan, then per layer cool - scan - correct - set - deposit, final scan, report data.

Pure: everything outside goes through `Cell`. The state machine is drawn in docs/job.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_plan.plan import Plan, PlannedLayer, renumber
from waam_process.segment import Segment

from .cell import Cell, Correction, CorrectionRequest, Scan
from .control import Control
from .cooling import wait_for_interpass
from .folder import JobFolder
from .geometry import Deviation, asked_growth, deviation, follow
from .goal import Checked, Code, JobError
from .journal import Journal
from .motion import Motion
from .pickup import PickUp
from .planning import make_plan
from .preparation import Preparation
from .program import Program
from .progress import BeadProgress
from .records import LayerRecord, State, Status
from .settings import Settings
from .surveyor import Surveyor
from .watch import Watch

OPEN_LOOP, CLOSED_LOOP = 'open_loop', 'closed_loop'


@dataclass
class History:
    """What the last layer was asked for, for the identification in the correction server."""

    growth: np.ndarray | None = None
    surface: np.ndarray | None = None
    feed_factor: float = 1.0


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
        self.run_id = folder.job_id if run == 1 else f'{folder.job_id}.r{run}'
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
        self.history = History()
        self.as_found_rms = math.nan
        self.final: Deviation | None = None

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
            self.journal.state(State.PREPARING, 'arming and homing')
            suffix = '' if self.run_number == 1 else f'_{self.run_number}'
            custom = (f'job_id={self.run_id}', f'profile={self.goal.profile}', *self.goal.notes)
            record = str(self.journal.folder.path / f'record{suffix}')
            self.preparation.check_ready()
            self.journal.started = self.cell.now()  # only now is there a clock for certain
            self.preparation.run(self.run_id, record, custom)
            pick_up = PickUp(self) if self.run_number > 1 else None
            scan, first = pick_up.run() if pick_up else self.begin()
            self._finish(self._lay(scan, first))
            self.journal.state(State.DONE, self._verdict_text())
        except JobError as e:
            self._fail(e)
        finally:
            self._release()
        return self.status

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
        laid = self.program.offset + (self.program.here if self.program.plan else 0)
        plan = make_plan(self.checked, self.preparation.plan_settings(), scan.map, laid)
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

    # ---- layers --------------------------------------------------------------------------------

    def _lay(self, scan: Scan, first: int) -> Scan:
        """All layers from number `first` on, through all passes."""
        while True:
            for layer in self.program.layers:
                if layer.number >= first:
                    scan = self.one_layer(layer, scan)
            if not self._next_pass(scan):
                return scan

    def one_layer(self, layer: PlannedLayer, scan: Scan, resumed: bool = False) -> Scan:
        """Deposits a layer (resumed: what is left of it) onto the surface of `scan` and returns the scan after it."""
        status = self.status
        record = LayerRecord(
            job_id=self.run_id,
            profile=self.goal.profile,
            layer=layer.number,
            pass_number=self.program.pass_number,
        )
        status.layer, status.bead = layer.number, 0
        status.beads = self.program.layer(layer.number).beads
        status.k_gain = self.control.k_gain(self.goal.k_gain)
        self.note_remarks()
        self.journal.state(State.COOLING)
        record.wait, record.temperature = wait_for_interpass(
            self.cell, self.watch, self.journal, self.settings
        )
        if self.control.take_wish('rescan'):
            self.journal.note('INFO', 'operator', 'another scan was asked for', 'scanned again')
            scan = self.survey(layer.number - 1)
        error = scan.map.z - layer.target_before
        record.add_errors(error[self.plan.interior & (layer.planned > 0)])
        record.add_scan(scan)
        if self.control.take_wish('skip_layer'):
            return self._skip(layer, scan, record)
        correction = self._correct(layer, scan, record)
        segments = self._setpoints(layer, scan, correction, record)
        asked = self._asked(layer, correction)
        if not resumed:  # else the file holds the surface before the whole layer, which stays true
            self._keep_scan(layer, scan, correction, asked, record.flow_factor)
        self._deposit(segments, layer, record)
        # what eq 2.19 took off counts as part of the process: the scan then shows whether it was right to
        self.history = History(asked, scan.map.z, record.flow_factor)
        self.journal.layer(record)
        return self.survey(layer.number)

    def _keep_scan(self, layer, scan, correction, asked, feed_factor: float) -> None:
        number = layer.number - 1
        target = self.program.target_after(number)
        self.journal.scan(number, scan, self.plan, target, layer, correction, asked, feed_factor)

    def _skip(self, layer: PlannedLayer, scan: Scan, record: LayerRecord) -> Scan:
        self.journal.note(
            'WARNING', 'operator', f'layer {layer.number} was skipped', 'layer not laid'
        )
        record.reasons.append('skipped by the operator')
        self._keep_scan(layer, scan, None, np.zeros(scan.map.spec.shape), 1.0)
        self.history = History()
        self.journal.layer(record)
        return scan

    def request(self, layer: PlannedLayer, scan: Scan) -> CorrectionRequest:
        """What the correction server needs for a layer on the surface of `scan`."""
        return CorrectionRequest(
            layer=layer.number,
            scan=scan,
            target=layer.target_before,
            planned=layer.planned,
            previous_growth=self.history.growth,
            previous_surface=self.history.surface,
            previous_feed_factor=self.history.feed_factor,
            bead_width=self.plan.settings.bead_width,
            temperature=self.cell.heat().temperature,
            k_gain=self.status.k_gain,
            direction=layer.direction,
        )

    def _correct(self, layer: PlannedLayer, scan: Scan, record: LayerRecord) -> Correction | None:
        if self.goal.profile == OPEN_LOOP:
            return None
        self.journal.state(State.CORRECTING)
        correction = self.cell.correct(self.run_id, self.request(layer, scan))
        record.add_correction(correction, layer.planned > 0, self.goal.profile == CLOSED_LOOP)
        if correction.fallback:
            removed = not correction.psi.any()
            reaction = 'correction removed' if removed else 'explicit law'
            self.journal.note('WARNING', 'correction', '; '.join(correction.reasons), reaction)
        return correction

    def _setpoints(
        self, layer: PlannedLayer, scan: Scan, correction: Correction | None, record: LayerRecord
    ) -> list[Segment]:
        """Speed, feed and voltage of every segment; in closed loop the torch also follows the measured surface."""
        closed = self.goal.profile == CLOSED_LOOP
        segments = layer.segments
        if closed and scan.plausible:
            segments = follow(segments, scan.map, self.settings.follow_reach)
        factor, material = self.cell.heat().factor, self.goal.material
        segments = self.cell.setpoints(self.run_id, material, segments, correction, factor, closed)
        record.add_segments(segments)
        return segments

    def _asked(self, layer: PlannedLayer, correction: Correction | None) -> np.ndarray:
        """Metal that the setpoints ask for, (rows, cols) m."""
        if correction is None or self.goal.profile != CLOSED_LOOP:
            return np.where(layer.planned > 0, layer.planned, 0.0)
        c = correction
        return asked_growth(layer.planned, c.psi, c.k_gain, c.residual_height)

    def _deposit(self, segments: list[Segment], layer: PlannedLayer, record: LayerRecord) -> None:
        self.journal.state(State.DEPOSITING)
        self.cell.take_sums()
        settings = self.preparation.plan_settings()
        placed = renumber(
            segments, self.motion.next_index, self.motion.position, settings, self.plan.safe_z
        )
        self.cell.plan(self.run_id, layer.number, placed)
        started = self.cell.now()
        progress = BeadProgress(self, layer, placed)
        self.journal.checkpoint(0, progress.beads_before, placed[0].index - 1)
        self.motion.execute(placed, progress.on_done)
        self.journal.checkpoint(0, progress.beads_before + layer.beads, placed[-1].index)
        record.duration = self.cell.now() - started
        record.add_sums(self.cell.take_sums())
        record.faults = self.journal.faults_in(layer.number)

    def note_remarks(self) -> None:
        """What the operator changed elsewhere becomes part of the job's record."""
        for text in self.control.take_remarks():
            self.journal.note('INFO', 'operator', text, 'none')

    # ---- scanning ------------------------------------------------------------------------------

    def survey(self, layer: int, required: bool = False) -> Scan:
        """The surface after `layer` layers, with its deviation in the status."""
        top = self.program.built_height(layer) if self.program.plan else 0.0
        scan = self.surveyor.scan(layer, top, self.preparation.plan_settings(), required)
        if self.program.plan is not None:
            found = self.deviation(scan.map.z, self.program.target_after(layer))
            self.status.height_error_rms, self.status.height_error_max = found.rms, found.max
            self.cell.status(self.status)
        return scan

    def deviation(self, z: np.ndarray, target: np.ndarray, whole: bool = False) -> Deviation:
        """Of a surface from its target, over this pass's region or the whole job's."""
        plan = self.program.whole if whole else self.plan
        wanted = np.isfinite(target)
        return deviation(
            z - target, plan.region & wanted, plan.interior & wanted, self.goal.tolerance
        )

    # ---- the end -------------------------------------------------------------------------------

    def _finish(self, scan: Scan) -> None:
        """Judged by the region and the surface of the first plan, however many passes there were."""
        self.journal.state(State.FINISHING)
        whole, number = self.program.whole, self.program.layers[-1].number
        self._note_pass(scan, number)
        target = whole.final_target
        self.journal.scan(number, scan, whole, target)
        self.final = self.deviation(scan.map.z, target, whole=True)
        self.as_found_rms = self.deviation(whole.as_found.z, target, whole=True).rms
        record = LayerRecord(
            job_id=self.run_id,
            profile=self.goal.profile,
            layer=number,
            pass_number=self.program.pass_number,
            final=True,
        )
        record.add_errors((scan.map.z - target)[whole.interior])
        record.add_scan(scan)
        record.temperature = self.cell.heat().temperature
        self.journal.layer(record)
        self.status.progress, self.status.time_left = 1.0, 0.0

    def _fail(self, error: JobError) -> None:
        self.status.error_code = int(error.code)
        aborted = error.code == Code.ABORTED
        if aborted:
            self.journal.note('WARNING', 'operator', str(error), 'arc ended, queue dropped')
        self.journal.state(State.ABORTED if aborted else State.FAILED, str(error))

    def _release(self) -> None:
        """Leaves machine and folder in order; what cannot be done is written down, not raised."""
        if self.status.state != State.DONE:
            self._try(lambda: self.cell.command('STOP'))
        self._try(lambda: self.cell.command('DISARM'))
        self._try(lambda: self.cell.record(False, ''))
        self.note_remarks()
        self.journal.report(self.in_tolerance, self.final, self.as_found_rms, self.program.records)

    def _try(self, step) -> None:
        try:
            step()
        except JobError as e:
            self.journal.note('WARNING', 'link', f'at the end of the job: {e}', 'none')

    @property
    def in_tolerance(self) -> bool:
        done = self.final is not None and self.status.state == State.DONE
        return done and self.final.share_in_tolerance >= self.settings.share_in_tolerance

    def _verdict_text(self) -> str:
        f = self.final
        return (
            f'RMS {f.rms * 1e3:.3f} mm, {f.share_in_tolerance * 100:.1f} % of the interior within '
            f'+-{self.goal.tolerance * 1e3:.2f} mm'
        )
