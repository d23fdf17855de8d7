"""One layer: cool - correct - set - deposit - scan; what the operator asked for meanwhile is taken between layers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from waam_plan.plan import PlannedLayer, renumber
from waam_process.names import CLOSED_LOOP, OPEN_LOOP
from waam_process.segment import Segment

from ..model.cell import Correction, CorrectionRequest, Scan
from ..model.geometry import asked_growth, follow
from ..model.records import LayerRecord, State
from .cooling import wait_for_interpass
from .progress import BeadProgress

if TYPE_CHECKING:
    from .runner import JobRunner


@dataclass
class History:
    """What the last layer was asked for, for the identification in the correction server."""

    growth: np.ndarray | None = None
    surface: np.ndarray | None = None
    feed_factor: float = 1.0


class LayerCycle:
    """Works on a runner; `history` is what the correction server learns the process from."""

    def __init__(self, runner: JobRunner) -> None:
        self.runner, self.cell = runner, runner.cell
        self.journal, self.goal = runner.journal, runner.goal
        self.history = History()

    def lay(self, layer: PlannedLayer, scan: Scan, resumed: bool = False) -> Scan:
        """Deposits a layer (resumed: what is left of it) onto the surface of `scan` and returns the scan after it."""
        status = self.runner.status
        record = LayerRecord(
            job_id=self.runner.run_id,
            profile=self.goal.profile,
            layer=layer.number,
            pass_number=self.runner.program.pass_number,
        )
        status.layer, status.bead = layer.number, 0
        status.beads = self.runner.program.layer(layer.number).beads
        status.k_gain = self.runner.control.k_gain(self.goal.k_gain)
        self.runner.note_remarks()
        self.journal.state(State.COOLING)
        record.wait, record.temperature = wait_for_interpass(
            self.cell, self.runner.watch, self.journal, self.runner.settings
        )
        scan = scan if resumed else self._renewed(layer, scan)
        error = scan.map.z - layer.target_before
        record.add_errors(error[self.runner.plan.interior & (layer.planned > 0)])
        record.add_scan(scan)
        if self.runner.control.take_wish('skip_layer'):
            return self._skip(layer, scan, record, resumed)
        correction = self._correct(layer, scan, record)
        segments = self._setpoints(layer, scan, correction, record)
        asked = self._asked(layer, correction)
        if not resumed:  # else the file holds the surface before the whole layer, which stays true
            self._keep_scan(layer, scan, correction, asked, record.flow_factor)
        self._deposit(segments, layer, record)
        # what eq 2.19 took off counts as part of the process: the scan then shows whether it was right to
        self.history = History(asked, scan.map.z, record.flow_factor)
        self.journal.layer(record)
        return self.runner.survey(layer.number)

    def _renewed(self, layer: PlannedLayer, scan: Scan) -> Scan:
        """The scan, or a new one when the operator asked for it or this one is too old to lay metal by."""
        age, limit = self.cell.now() - scan.stamp, self.runner.settings.scan_max_age
        if self.runner.control.take_wish('rescan'):
            self.journal.note('INFO', 'operator', 'another scan was asked for', 'scanned again')
        elif limit and age > limit:
            self.journal.note('INFO', 'scan', f'the map is {age:.0f} s old', 'scanned again')
        else:
            return scan
        return self.runner.survey(layer.number - 1)

    def _keep_scan(self, layer, scan, correction, asked, feed_factor: float) -> None:
        number = layer.number - 1
        target = self.runner.program.target_after(number)
        self.journal.scan(
            number, scan, self.runner.plan, target, layer, correction, asked, feed_factor
        )

    def _skip(self, layer: PlannedLayer, scan: Scan, record: LayerRecord, resumed: bool) -> Scan:
        """Leaves the layer out; of a resumed one, what is laid stays and is measured."""
        self.journal.note(
            'WARNING', 'operator', f'layer {layer.number} was skipped', 'layer not laid'
        )
        record.reasons.append('skipped by the operator')
        if not resumed:
            self._keep_scan(layer, scan, None, np.zeros(scan.map.spec.shape), 1.0)
        self.history = History()
        self.journal.layer(record)
        return self.runner.survey(layer.number) if resumed else scan

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
            bead_width=self.runner.plan.settings.bead_width,
            temperature=self.cell.heat().temperature,
            k_gain=self.runner.status.k_gain,
            direction=layer.direction,
            beads=tuple(layer.arc_paths),
        )

    def _correct(self, layer: PlannedLayer, scan: Scan, record: LayerRecord) -> Correction | None:
        if self.goal.profile == OPEN_LOOP:
            return None
        self.journal.state(State.CORRECTING)
        correction = self.cell.correct(self.runner.run_id, self.request(layer, scan))
        self.journal.model(correction.model_hash, layer.number)
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
            segments = follow(segments, scan.map, self.runner.settings.follow_reach)
        factor, material = self.cell.heat().factor, self.goal.material
        segments = self.cell.setpoints(
            self.runner.run_id, material, segments, correction, factor, closed
        )
        record.add_segments(segments)
        return segments

    def _asked(self, layer: PlannedLayer, correction: Correction | None) -> np.ndarray:
        """Metal that the setpoints ask for, (rows, cols) m."""
        if correction is None or self.goal.profile != CLOSED_LOOP:
            return np.where(layer.planned > 0, layer.planned, 0.0)
        c = correction
        return asked_growth(layer.planned, c.psi, c.k_gain, c.residual_height)

    def _deposit(self, segments: list[Segment], layer: PlannedLayer, record: LayerRecord) -> None:
        self.runner.preparation.check_spark(self.runner.run_id)
        self.journal.state(State.DEPOSITING)
        self.cell.take_sums()
        settings = self.runner.preparation.plan_settings()
        placed = renumber(
            segments,
            self.runner.motion.next_index,
            self.runner.motion.position,
            settings,
            self.runner.plan.safe_z,
        )
        self.cell.plan(self.runner.run_id, layer.number, placed)
        started = self.cell.now()
        progress = BeadProgress(self.runner, layer, placed)
        self.journal.checkpoint(0, progress.beads_before, placed[0].index - 1)
        self.runner.motion.execute(placed, progress.on_done)
        self.journal.checkpoint(0, progress.beads_before + layer.beads, placed[-1].index)
        record.duration = self.cell.now() - started
        record.add_sums(self.cell.take_sums())
        if record.telemetry_lost:
            text = f'{record.telemetry_lost} telemetry frames were lost in this layer'
            self.journal.note('WARNING', 'link', text, 'means over the others')
        record.faults = self.journal.faults_in(layer.number)
