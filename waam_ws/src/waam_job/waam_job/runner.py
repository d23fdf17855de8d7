"""The job: prepare, scan, plan, then per layer cool - scan - correct - set - deposit, final scan, report data.

Pure: everything outside goes through `Cell`. The state machine is drawn in docs/job.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waam_plan.build import plan_build
from waam_plan.plan import Plan, PlannedLayer, renumber
from waam_plan.restore import plan_restoration
from waam_plan.scanning import scan_segments
from waam_plan.settings import PlanSettings
from waam_plan.surface import top_surface
from waam_process.segment import Kind, Point, Segment

from .cell import Cell, Correction, CorrectionRequest, Scan
from .control import Control
from .folder import JobFolder
from .geometry import Deviation, asked_growth, deviation, follow, part_grid
from .goal import Checked, Code, JobError
from .journal import Journal
from .motion import Motion
from .records import LayerRecord, State, Status
from .watch import Limits, Watch

READY_LOOKS = 50  # a tenth of a second apart


@dataclass(frozen=True)
class Settings:
    """How this machine runs jobs (parameters of the node). SI."""

    work_offset: Point = (0.100, 0.080, 0.020)
    plate_zero: Point = (0.020, 0.020, 0.010)
    margin: float = 5e-3
    resolution: float = 0.5e-3
    follow_reach: float = 3e-3
    cooling_timeout: float = 1800.0
    pyrometer_patience: float = 30.0
    home_timeout: float = 120.0
    share_in_tolerance: float = 0.95
    lease_nodes: tuple[str, ...] = ()
    limits: Limits = field(default_factory=Limits)


@dataclass
class History:
    """What the last layer was asked for, for the identification in the correction server."""

    growth: np.ndarray | None = None
    surface: np.ndarray | None = None
    feed_factor: float = 1.0


class JobRunner:
    """Runs one checked goal on a cell and leaves a complete job folder, whatever happens."""

    def __init__(
        self, cell: Cell, checked: Checked, folder: JobFolder, control: Control, settings: Settings
    ) -> None:
        self.cell, self.checked, self.goal = cell, checked, checked.goal
        self.job_id, self.settings = folder.job_id, settings
        self.journal = Journal(cell, checked.goal, folder)
        self.watch = Watch(cell, control, settings.limits, self.journal.note, self.journal.paused)
        self.motion = Motion(cell, self.watch, folder.job_id)
        self.history = History()
        self.plan: Plan | None = None
        self.as_found_rms = math.nan
        self.final: Deviation | None = None

    @property
    def status(self) -> Status:
        return self.journal.status

    def run(self) -> Status:
        """Returns the final status; errors end up in it (and in the folder), they are not raised."""
        try:
            self.journal.state(State.PREPARING, 'arming and homing')
            self._prepare()
            scan = self._scan(0)
            self.plan = self._make_plan(scan)
            for layer in self.plan.layers:
                scan = self._one_layer(layer, scan)
            self._finish(scan)
            self.journal.state(State.DONE, self._verdict_text())
        except JobError as e:
            self._fail(e)
        finally:
            self._release()
        return self.status

    # ---- before the first spark ----------------------------------------------------------------

    def _prepare(self) -> None:
        """Interlocks (all that is wrong at once), record, arming, homing, work zero."""
        self._check_ready()
        settings = self.settings
        custom = (f'job_id={self.job_id}', f'profile={self.goal.profile}', *self.goal.notes)
        self.cell.record(True, str(self.journal.folder.path / 'record'), custom)
        self.cell.command('ARM', text=self.job_id, names=settings.lease_nodes)
        self.motion.until(lambda m: m.armed_job == self.job_id, 10.0, 'the controller did not arm')
        self.motion.home(settings.home_timeout)
        self.cell.command('SET_ZERO', vector=self._work_zero())
        self.cell.wait(0.1)
        self.motion.position = self.cell.machine().position
        self.cell.take_sums()
        self.cell.take_track()

    def _work_zero(self) -> Point:
        """Machine coordinates of the part's lower corner: the clamp's zero, or inside and on top of the plate."""
        if self.goal.mode == 'restore':
            return self.settings.work_offset
        pairs = zip(self.settings.work_offset, self.settings.plate_zero, strict=True)
        return tuple(a + b for a, b in pairs)

    def _check_ready(self) -> None:
        """All that is wrong at once; what may only be late (a node that has just started) gets a few seconds."""
        for _ in range(READY_LOOKS):
            problems = self._problems()
            if not problems:
                return
            self.cell.wait(0.1)
        raise JobError(Code.MACHINE_NOT_READY, '; '.join(problems))

    def _problems(self) -> list[str]:
        machine = self.cell.machine()
        problems = []
        if not machine.connected:
            problems.append(machine.message or 'no controller is connected')
        elif machine.state != 'IDLE':
            problems.append(
                f'the controller is in {machine.state}: {machine.fault_text or "not idle"}'
            )
        if not self.cell.heat().known:
            problems.append('no temperature is coming in (pyrometer or thermal_compensator silent)')
        return problems

    def _plan_settings(self) -> PlanSettings:
        material, goal = self.checked.material, self.goal
        machine, zero = self.cell.machine(), self._work_zero()
        low, high = (
            tuple(a - b for a, b in zip(limit, zero, strict=True))
            for limit in (machine.limit_min, machine.limit_max)
        )
        return PlanSettings(
            machine_min=low,
            machine_max=high,
            layer_height=goal.layer_height or material.layer_height,
            bead_width=goal.bead_width or material.bead_width,
            speed=material.speed,
            grid=self.settings.resolution,
        )

    def _make_plan(self, scan: Scan) -> Plan:
        part, goal = self.checked.part, self.goal
        try:
            if goal.mode == 'build':
                plan = plan_build(part, self._plan_settings(), goal.layers, scan.map.spec)
            else:
                corner = tuple(-float(v) for v in part.bounds[0])
                nominal = top_surface(part.mesh, scan.map.spec, corner)
                plan = plan_restoration(scan.map, nominal, self._plan_settings(), goal.layers)
        except ValueError as e:
            raise JobError(Code.PLAN_FAILED, str(e)) from None
        for text in plan.warnings:
            self.journal.note('WARNING', 'height', text, 'none')
        if not plan.layers:
            raise JobError(
                Code.PLAN_FAILED,
                'nothing to deposit: the surface is nowhere below the nominal part',
            )
        self.status.layers = len(plan.layers)
        self.journal.plan(plan)
        return plan

    # ---- one layer -----------------------------------------------------------------------------

    def _one_layer(self, layer: PlannedLayer, scan: Scan) -> Scan:
        """Deposits one layer onto the surface of `scan` and returns the scan after it."""
        record = LayerRecord(job_id=self.job_id, profile=self.goal.profile, layer=layer.number)
        self.status.layer, self.status.bead, self.status.beads = layer.number, 0, layer.beads
        record.wait = self._cool(record)
        error = scan.map.z - layer.target_before
        record.add_errors(error[self.plan.interior & (layer.planned > 0)])
        record.add_scan(scan)
        correction = self._correct(layer, scan, record)
        segments = self._setpoints(layer, scan, correction, record)
        self.journal.scan(
            layer.number - 1, scan, self.plan, self._target(layer.number - 1), layer, correction
        )
        self._deposit(segments, layer, record)
        self._remember(layer, scan, correction, record)
        self.journal.layer(record)
        return self._scan(layer.number, scan)

    def _cool(self, record: LayerRecord) -> float:
        """Waits for the interpass limit; returns the seconds waited. An unbelievable pyrometer stops the job."""
        self.journal.state(State.COOLING)
        started = self.cell.now()
        doubtful_since: float | None = None
        while True:
            self.watch.tick()
            heat, now = self.cell.heat(), self.cell.now()
            if heat.plausible:
                doubtful_since = None
                if heat.ready:
                    record.temperature = heat.temperature
                    return now - started
                wait = f'{heat.wait:.0f} s to go' if math.isfinite(heat.wait) else 'waiting'
                self.journal.say(
                    f'cooling: {heat.temperature:.0f} C, limit {heat.limit:.0f} C, {wait}'
                )
            else:
                doubtful_since = doubtful_since or now
                if now - doubtful_since > self.settings.pyrometer_patience:
                    text = f'temperature is not believed: {"; ".join(heat.reasons) or "no reason given"}'
                    self.journal.note('FAULT', 'temperature', text, 'job ended before the layer')
                    raise JobError(Code.MACHINE_NOT_READY, text)
            if now - started > self.settings.cooling_timeout:
                raise JobError(
                    Code.TIMEOUT, f'not below {heat.limit:.0f} C after {now - started:.0f} s'
                )

    def _correct(self, layer: PlannedLayer, scan: Scan, record: LayerRecord) -> Correction | None:
        if self.goal.profile == 'open_loop':
            return None
        self.journal.state(State.CORRECTING)
        request = CorrectionRequest(
            layer=layer.number,
            scan=scan,
            target=layer.target_before,
            planned=layer.planned,
            previous_growth=self.history.growth,
            previous_surface=self.history.surface,
            previous_feed_factor=self.history.feed_factor,
            bead_width=self._plan_settings().bead_width,
            temperature=self.cell.heat().temperature,
            k_gain=self.goal.k_gain,
            direction=layer.direction,
        )
        correction = self.cell.correct(self.job_id, request)
        record.add_correction(correction, layer.planned > 0, self.goal.profile == 'closed_loop')
        if correction.fallback:
            reasons = '; '.join(correction.reasons)
            self.journal.note(
                'WARNING',
                'correction',
                reasons,
                'correction removed' if not correction.psi.any() else 'explicit law',
            )
        return correction

    def _setpoints(
        self, layer: PlannedLayer, scan: Scan, correction: Correction | None, record: LayerRecord
    ) -> list[Segment]:
        """Speed, feed and voltage of every segment; in closed loop the torch also follows the measured surface."""
        closed = self.goal.profile == 'closed_loop'
        segments = layer.segments
        if closed and scan.plausible:
            segments = follow(segments, scan.map, self.settings.follow_reach)
        factor, material = self.cell.heat().factor, self.goal.material
        segments = self.cell.setpoints(self.job_id, material, segments, correction, factor, closed)
        record.add_segments(segments)
        return segments

    def _deposit(self, segments: list[Segment], layer: PlannedLayer, record: LayerRecord) -> None:
        self.journal.state(State.DEPOSITING)
        self.cell.take_sums()
        placed = renumber(
            segments,
            self.motion.next_index,
            self.motion.position,
            self._plan_settings(),
            self.plan.safe_z,
        )
        self.cell.plan(self.job_id, layer.number, placed)
        started = self.cell.now()
        self.motion.execute(placed, lambda s: self._progress(s, layer))
        record.duration = self.cell.now() - started
        record.add_sums(self.cell.take_sums())
        record.faults = self.journal.faults_in(layer.number)

    def _progress(self, segment: Segment, layer: PlannedLayer) -> None:
        if not segment.bead:
            return
        if segment.bead != self.status.bead:
            self.status.bead = segment.bead
            self.journal.checkpoint(segment)
        durations = [p.arc_time for p in self.plan.layers]
        before = sum(s.duration for s in layer.deposits if s.bead < segment.bead)
        done = sum(durations[: layer.number - 1]) + before
        self.status.progress = min(1.0, done / max(sum(durations), 1e-9))
        if self.status.progress > 0.02:
            elapsed = self.cell.now() - self.journal.started
            self.status.time_left = elapsed * (1 / self.status.progress - 1)
        self.cell.status(self.status)

    def _remember(
        self, layer: PlannedLayer, scan: Scan, correction: Correction | None, record: LayerRecord
    ) -> None:
        """What was asked for, to be compared with what the next scan finds."""
        self.history.surface = scan.map.z
        # what eq 2.19 took off counts as part of the process: the scan then shows whether it was right to
        self.history.feed_factor = record.flow_factor
        growth = np.where(layer.planned > 0, layer.planned, 0.0)
        if correction is not None and self.goal.profile == 'closed_loop':
            c = correction
            growth = asked_growth(layer.planned, c.psi, c.k_gain, c.residual_height)
        self.history.growth = growth

    # ---- scanning ------------------------------------------------------------------------------

    def _scan(self, layer: int, before: Scan | None = None) -> Scan:
        """Scans the part; an implausible map is scanned again once. The first one must be plausible."""
        for attempt in (1, 2):
            self.journal.state(State.SCANNING, 'scanning' if attempt == 1 else 'scanning again')
            scan = self._scan_once(layer)
            if scan.plausible:
                break
            text = f'map after layer {layer}: {"; ".join(scan.reasons)}'
            reaction = 'scanned again' if attempt == 1 else 'correction removed'
            self.journal.note('WARNING', 'scan', text, reaction)
        else:
            if before is None:
                raise JobError(
                    Code.SCAN_FAILED, f'the surface as found could not be measured: {text}'
                )
        if self.plan is not None:
            found = self._deviation(scan.map.z, self._target(layer))
            self.status.height_error_rms, self.status.height_error_max = found.rms, found.max
            self.cell.status(self.status)
        return scan

    def _scan_once(self, layer: int) -> Scan:
        size = self.checked.part.bounds[1] - self.checked.part.bounds[0]
        margin = self.settings.margin
        spec = part_grid(self.checked.part.bounds, self.settings.resolution, margin)
        rectangle = (-margin, -margin, float(size[0]) + margin, float(size[1]) + margin)
        top = float(size[2]) if self.goal.mode == 'restore' else self._built_height(layer)
        try:
            segments = scan_segments(rectangle, top, self._plan_settings(), self.motion.position)
        except ValueError as e:
            raise JobError(Code.PLAN_FAILED, f'the part cannot be scanned: {e}') from None
        shift = self.motion.next_index - segments[0].index
        segments = [s.at(index=s.index + shift, layer=layer) for s in segments]
        first = next(i for i, s in enumerate(segments) if s.kind == Kind.SCAN)
        if first:  # approach with the laser off: profiles from far above would only be empty
            self.motion.execute(segments[:first])
        scan_id = self.cell.begin_scan(self.job_id, layer, spec)
        self.motion.execute(segments[first:])
        return self.cell.finish_scan(scan_id, self.cell.now())

    def _built_height(self, layer: int) -> float:
        """Highest point after `layer` layers of a build, m above the plate: the scanner's range is short."""
        if layer == 0 or self.plan is None:
            return 0.0
        return float(max(np.nanmax(p.target_after) for p in self.plan.layers[:layer]))

    def _target(self, layer: int) -> np.ndarray:
        """Wanted surface after `layer` layers, (rows, cols) m."""
        layers = self.plan.layers
        return layers[layer].target_before if layer < len(layers) else self.plan.final_target

    def _deviation(self, z: np.ndarray, target: np.ndarray) -> Deviation:
        wanted = np.isfinite(target)
        plan = self.plan
        return deviation(
            z - target, plan.region & wanted, plan.interior & wanted, self.goal.tolerance
        )

    # ---- the end -------------------------------------------------------------------------------

    def _finish(self, scan: Scan) -> None:
        self.journal.state(State.FINISHING)
        plan, target = self.plan, self.plan.final_target
        number = plan.layers[-1].number
        self.journal.scan(number, scan, plan, target)
        self.final = self._deviation(scan.map.z, target)
        self.as_found_rms = self._deviation(plan.as_found.z, target).rms
        record = LayerRecord(
            job_id=self.job_id, profile=self.goal.profile, layer=number, final=True
        )
        record.add_errors((scan.map.z - target)[plan.interior])
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
        self.journal.track()
        self._try(lambda: self.cell.record(False, ''))
        self.journal.report(self.in_tolerance, self.final, self.as_found_rms)

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
