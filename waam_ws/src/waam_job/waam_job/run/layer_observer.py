"""What looks on while a layer is laid: the metal that it is asked for, on record, and its progress."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.shaft.lines import home
from waam_process.segment import Kind, Segment

from ..model.altered import AlteredMetal
from ..model.cell import Scan
from ..model.records import LayerRecord
from ..store.journal import Following
from .context import JobContext

CHECKPOINT_PERIOD = 1.0  # s between two checkpoints of a bead


@dataclass(frozen=True)
class SetLayer(Following):
    """A layer with its setpoints, ready to be laid."""

    scan: Scan  # the surface before it
    record: LayerRecord
    segments: list[Segment]  # with the approach, numbered as they are handed to the bridge


class LayerObserver:
    """Does nothing. `LayerCycle` calls it while a layer is laid."""

    def begin(self, work: SetLayer) -> None:
        """Everything is set, nothing has moved."""

    def segment_done(self, segment: Segment) -> None:
        """The newest segment that is finished; of several at once the last."""

    def end(self, complete: bool) -> None:
        """complete: False when the layer was cut off."""


class AskedMetal(LayerObserver):
    """Keeps what the layer is asked for with the surface before it, so that a job that is cut off can go on: before it
    is laid, and anew while the operator's override changes it."""

    def __init__(
        self,
        context: JobContext,
        earlier: Sequence[Segment] = (),
        on_record: np.ndarray | None = None,
    ) -> None:
        """earlier, on_record: of a layer that was cut off, the deposits that lie there, and the metal (rows, cols) m
        that the setpoints asked for when they were laid."""
        self.context, self.earlier, self.on_record = context, earlier, on_record

    def begin(self, work: SetLayer) -> None:
        """The first record."""
        settings = self.context.plan_settings()
        self.altered = AlteredMetal(
            home(work.segments, settings), home(list(self.earlier), settings)
        )
        spec, asked = work.scan.map.spec, work.asked
        if self.on_record is not None:
            asked = self.altered.with_earlier(asked, self.on_record, spec)
        self.work = replace(work, asked=asked)
        self._keep()

    def segment_done(self, segment: Segment) -> None:
        """With the override that is in force."""
        factor = self.context.control.metal_factor
        self.altered.heard(segment.index, factor)
        if self.altered.news(factor, self.context.cell.now()):
            self._keep()

    def end(self, complete: bool) -> None:
        """The last record, and a remark for the report, when there was an override."""
        if self.altered.text:
            self.work.record.reasons.append(self.altered.text)
            self._keep()

    @property
    def growth(self) -> np.ndarray:
        """(rows, cols) m of metal that the setpoints in force ask for, with the operator's override."""
        return self.altered.asked(self.work.asked, self.work.scan.map.spec)

    def _keep(self) -> None:
        self.context.keep_scan(self.work.scan, replace(self.work, asked=self.growth))


class BeadProgress(LayerObserver):
    """Bead, share of the job, time left, and checkpoints. Beads laid before an interruption count as done."""

    def __init__(self, context: JobContext) -> None:
        self.context, self.journal = context, context.journal

    def begin(self, work: SetLayer) -> None:
        """What there is to do, and the first checkpoint."""
        program, number = self.context.program, work.layer.number
        deposits = [s for s in work.segments if s.kind == Kind.DEPOSIT]
        whole = program.layer(number).deposits
        beads = list(dict.fromkeys(s.bead for s in whole))
        here = list(dict.fromkeys(s.bead for s in deposits))
        self.segments_before = len(whole) - len(deposits)
        self.beads_before = beads.index(here[0]) if here else len(beads)
        self.beads_after = self.beads_before + work.layer.beads
        last = {s.bead: s.index for s in deposits}
        self.ends = np.array([last[b] for b in here], dtype=np.int64)
        self.starts = {s.index: s.bead for s in deposits}
        self.laid_before = sum(s.duration for s in whole) - sum(s.duration for s in deposits)
        self.times = np.cumsum([s.duration for s in deposits])
        self.indices = np.array([s.index for s in deposits], dtype=np.int64)
        # once: there is an estimate after every segment
        durations = [p.arc_time for p in program.current.layers]
        before = program.arc_time_before
        self.laid_below = before + sum(durations[: number - program.offset - 1])
        self.arc_time = max(before + sum(durations), 1e-9)
        self.last = work.segments[-1].index
        self._seen, self._written = (0, 0), -math.inf
        first = work.segments[0].index
        self.journal.checkpoint(0, self.beads_before, first - 1, self.segments_before)

    def segment_done(self, segment: Segment) -> None:
        """Publishes the status; writes a checkpoint when a bead begins or ends, and every CHECKPOINT_PERIOD within."""
        status = self.journal.status
        done = self.beads_before + int(np.searchsorted(self.ends, segment.index, side='right'))
        bead = self.starts.get(segment.index, 0)
        status.bead = bead or status.bead
        self._estimate(segment.index)
        now = self.context.cell.now()
        new = (done, bead) != self._seen and (done != self._seen[0] or bead)
        if new or (bead and now - self._written >= CHECKPOINT_PERIOD):
            self._seen, self._written = (done, bead), now
            self.journal.checkpoint(bead, done, segment.index, self._laid(segment.index))
        self.context.note_remarks()
        self.context.cell.status(status)

    def end(self, complete: bool) -> None:
        """The last checkpoint of a whole layer."""
        if complete:
            self.journal.checkpoint(0, self.beads_after, self.last, self._laid(self.last))

    def _laid(self, index: int) -> int:
        """Deposit segments of the layer that are complete when segment `index` is."""
        return self.segments_before + int(np.searchsorted(self.indices, index, side='right'))

    def _estimate(self, index: int) -> None:
        """Share of the arc time of all passes, never less than before, and the time left at the pace of all runs."""
        status = self.journal.status
        laid = int(np.searchsorted(self.indices, index, side='right'))
        here = self.laid_before + (float(self.times[laid - 1]) if laid else 0.0)
        share = min(1.0, (self.laid_below + here) / self.arc_time)
        status.progress = max(status.progress, share)
        if status.progress > 0.02:
            spent = self.journal.spent_before + self.journal.elapsed
            status.time_left = spent * (1 / status.progress - 1)
