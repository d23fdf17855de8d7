"""One layer: cool - correct - set - deposit - scan; requests of the operator are served between layers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_plan.plan import PlannedLayer, laid_share, renumber
from waam_plan.shaft.lines import arc_paths, home, in_their_places, segments_with_copies
from waam_process.loop_mode import LoopMode
from waam_process.segment import Segment

from ..model.cell import Correction, CorrectionRequest, FeedRequest, Heat, NextLayer, Scan
from ..model.geometry import asked_growth, driven_growth, follow, laid_beads
from ..model.records import LayerRecord, State
from ..store.journal import Following
from .context import JobContext
from .cooling import Cooling
from .layer_observer import AskedMetal, BeadProgress, LayerObserver, SetLayer
from .learning import Learning
from .part_scanner import PartScanner
from .preparation import Preparation


@dataclass
class History:
    """The commands of the last layer, for the identification in the correction server."""

    growth: np.ndarray | None = None  # (rows, cols) m of metal
    surface: np.ndarray | None = None  # (rows, cols) m, before the layer
    feed_factor: float = 1.0  # of the wire feed, flow times heat (eq 2.19)
    skipped: bool = False  # the operator left the layer out


class LayerCycle:
    """Lays one layer after the other. The correction server learns the process from `history`."""

    def __init__(
        self,
        context: JobContext,
        scanner: PartScanner,
        preparation: Preparation,
        learning: Learning,
    ) -> None:
        self.context, self.scanner, self.preparation = context, scanner, preparation
        self.learning = learning
        self.cell, self.journal, self.goal = context.cell, context.journal, context.goal
        self.control, self.settings = context.control, context.settings
        self.program, self.motion, self.run_id = context.program, context.motion, context.run_id
        self.loop_mode = context.goal.loop_mode
        self.cooling = Cooling(context)
        self.history = History()

    def lay(self, layer: PlannedLayer, scan: Scan, asked: AskedMetal | None = None) -> Scan:
        """Deposits a layer onto the surface of `scan` and returns the scan after it. asked: knows what lies there of a
        layer that was cut off; `layer` then is its rest, and `scan` that before the whole layer."""
        asked = asked or AskedMetal(self.context)
        wait, temperature = self._cool(layer)
        scan = self._renewed(layer, scan)
        record = self._record(layer, scan, wait, temperature)
        if self.control.take_request('skip_layer'):
            return self._skip(layer, scan, record)
        heat = self.cell.heat()
        correction = self._correct(layer, scan, heat, record)
        work = self._set(layer, scan, correction, heat, record)
        self._tell_next(layer.number + 1)
        self._deposit(work, asked, BeadProgress(self.context))
        self.history = History(asked.growth, scan.map.z, work.feed_factor)
        self.journal.layer(record)
        return self.scanner.scan_after_layer(layer, scan)

    def found(self, layer: PlannedLayer, before: Scan) -> Scan:
        """For a layer that was cut off after its last segment: its record, and the scan after it."""
        record = self._record(layer, before)
        record.reasons.append('laid before the interruption')
        self.journal.layer(record)
        return self.scanner.scan_after(layer.number)

    def _record(
        self, layer: PlannedLayer, scan: Scan, wait: float = 0.0, temperature: float = math.nan
    ) -> LayerRecord:
        """With what is known before the layer is laid on the surface of `scan`."""
        record = LayerRecord(
            job_id=self.run_id,
            loop_mode=self.goal.loop_mode,
            layer=layer.number,
            pass_number=self.program.pass_number,
            wait=wait,
            temperature=temperature,
        )
        error = scan.map.z - layer.target_before
        record.add_errors(error[self.program.current.interior & (layer.planned > 0)])
        record.add_scan(scan)
        return record

    def _cool(self, layer: PlannedLayer) -> tuple[float, float]:
        """Announces the layer and waits until it may begin: s waited, and the temperature then, degC."""
        status = self.journal.status
        status.layer, status.bead = layer.number, 0
        status.beads = self.program.layer(layer.number).beads
        status.k_gain = self.control.k_gain(self.goal.k_gain)
        self.context.note_remarks()
        self.journal.state(State.COOLING)
        return self.cooling.wait(layer.number)

    def _renewed(self, layer: PlannedLayer, scan: Scan) -> Scan:
        """The scan, or a new one when the operator asked for it or this one is too old to lay metal by. The surface
        before a layer that was cut off cannot be scanned any more."""
        if scan.stored:
            return scan
        age, limit = self.cell.now() - scan.stamp, self.settings.scan_max_age
        if self.control.take_request('rescan'):
            self.journal.note('INFO', 'operator', 'another scan was asked for', 'scanned again')
        elif limit and age > limit:
            self.journal.note('INFO', 'scan', f'the map is {age:.0f} s old', 'scanned again')
        else:
            return scan
        return self.scanner.scan_after(layer.number - 1)

    def _skip(self, layer: PlannedLayer, scan: Scan, record: LayerRecord) -> Scan:
        """Leaves the layer out. Of one that was cut off the metal that was laid stays and is measured."""
        self.journal.note(
            'WARNING', 'operator', f'layer {layer.number} was skipped', 'layer not laid'
        )
        record.reasons.append('skipped by the operator')
        if not scan.stored:
            self.context.keep_scan(
                scan, Following(layer=layer, asked=np.zeros(scan.map.spec.shape))
            )
        self.history = History(skipped=True)
        self.journal.layer(record)
        return self.scanner.scan_after(layer.number) if scan.stored else scan

    def request(
        self, layer: PlannedLayer, scan: Scan, heat: Heat | None = None
    ) -> CorrectionRequest:
        """What the correction server needs for a layer on the surface of `scan`. heat: None = as it is now."""
        heat = heat or self.cell.heat()
        return CorrectionRequest(
            layer=layer.number,
            scan=scan,
            target=layer.target_before,
            planned=layer.planned,
            previous_growth=self.history.growth,
            previous_surface=self.history.surface,
            previous_feed_factor=self.history.feed_factor,
            bead_width=self.program.current.settings.bead_width,
            temperature=heat.temperature,
            k_gain=self.journal.status.k_gain,
            direction=layer.direction[:2],
            beads=arc_paths(layer, self.program.current.settings),
            heat_factor=heat.factor,
            learned=self.learning.text,
            ratio_high=self.program.current.ratio_high,
            next_thickness=self.program.thickness(layer.number + 1),
        )

    def _tell_next(self, number: int) -> None:
        """The correction server prepares layer `number` while the one before it is laid."""
        plan = self.program.current
        for layer in self.program.layers:
            if layer.number == number and self.loop_mode != LoopMode.OPEN_LOOP:
                coming = NextLayer(
                    number,
                    plan.spec,
                    layer.planned,
                    plan.settings.bead_width,
                    layer.direction[:2],
                    arc_paths(layer, plan.settings),
                )
                self.cell.next_layer(self.run_id, coming)

    def _correct(
        self, layer: PlannedLayer, scan: Scan, heat: Heat, record: LayerRecord
    ) -> Correction | None:
        if self.loop_mode == LoopMode.OPEN_LOOP:
            return None
        self.journal.state(State.CORRECTING)
        # also of the rest of a layer: the metal that is planned and the beads that lay it belong together
        whole = self.program.layer(layer.number)
        correction = self.cell.correct(self.run_id, self.request(whole, scan, heat))
        self.learning.taught = correction.learned
        self.journal.model(correction.model_hash, layer.number)
        record.add_correction(correction, layer.planned > 0, self.loop_mode == LoopMode.CLOSED_LOOP)
        if correction.fallback:
            removed = not correction.confidence.any()  # psi alone is 0 on a level surface, too
            reaction = 'correction removed' if removed else 'corrected without the network'
            self.journal.note('WARNING', 'correction', '; '.join(correction.reasons), reaction)
        return correction

    def _set(
        self,
        layer: PlannedLayer,
        scan: Scan,
        correction: Correction | None,
        heat: Heat,
        record: LayerRecord,
    ) -> SetLayer:
        """Speed, feed and voltage of every segment; in closed loop the torch also follows the measured surface, but a
        third-party program keeps its path. With the approach from where the torch is, numbered on from the last one
        laid."""
        closed = self.loop_mode == LoopMode.CLOSED_LOOP
        motion, settings = self.motion, self.context.plan_settings()
        segments = layer.segments
        if closed and scan.plausible and self.context.checked.program is None:
            reach = self.settings.follow_reach
            segments = follow(segments, scan.map, reach, settings.unrolled)
        request = FeedRequest(
            material=self.goal.material,
            segments=home(segments, settings),
            correction=correction,
            heat_factor=heat.factor,
            apply=closed,
        )
        segments = in_their_places(self.cell.setpoints(self.run_id, request), segments)
        record.add_segments(segments)
        safe_z = self.program.current.safe_z
        return SetLayer(
            layer=layer,
            asked=self._asked(layer, correction, segments),
            correction=correction,
            feed_factor=record.flow_factor * record.heat_factor,
            scan=scan,
            record=record,
            segments=renumber(segments, motion.next_index, motion.position, settings, safe_z),
        )

    def _asked(
        self, layer: PlannedLayer, correction: Correction | None, segments: list[Segment]
    ) -> np.ndarray:
        """Metal that the setpoints ask for within the limits of layer height, speed and feed, (rows, cols) m."""
        plan = self.program.current
        whole = self.program.layer(layer.number)
        own = plan.mode == 'restore' and self.context.checked.program is None
        share = laid_share(whole, plan.spec, plan.settings) if own else 1.0
        if correction is None or self.loop_mode != LoopMode.CLOSED_LOOP:
            return share * np.where(layer.planned > 0, layer.planned, 0.0)
        c = correction
        asked = asked_growth(layer.planned, c.psi, c.k_gain, c.residual_height)
        return share * driven_growth(
            asked, layer.planned, plan.spec, segments_with_copies(segments, plan.settings)
        )

    def _deposit(self, work: SetLayer, *observers: LayerObserver) -> None:
        layer, record, segments = work.layer, work.record, work.segments
        material = self.context.checked.material
        for observer in observers:
            observer.begin(work)
        self.preparation.check_spark()
        self.journal.state(State.DEPOSITING)
        self.cell.take_sums()
        self.cell.plan(self.run_id, layer.number, home(segments, self.context.plan_settings()))
        started = self.cell.now()
        self.scanner.laid(layer.number, laid_beads(segments, material))
        complete = False
        try:
            self.motion.execute(segments, [o.segment_done for o in observers])
            complete = True
        finally:
            for observer in observers:
                observer.end(complete)
        record.duration = self.cell.now() - started
        record.add_sums(self.cell.take_sums(), material.set_current)
        if record.telemetry_lost:
            text = f'{record.telemetry_lost} telemetry frames were lost in this layer'
            self.journal.note('WARNING', 'link', text, 'means over the others')
        record.faults = self.journal.faults_in(layer.number)
