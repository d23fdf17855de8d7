"""Follows a layer while it is laid: bead, share of the job, time left, and checkpoints."""

from __future__ import annotations

import math

import numpy as np

from waam_plan.plan import PlannedLayer
from waam_process.segment import Kind, Segment

from .context import JobContext

PERIOD = 1.0  # s between two checkpoints of a bead


class BeadProgress:
    """Call `on_done` with the newest finished segment. Beads laid before an interruption count as done."""

    def __init__(self, context: JobContext, layer: PlannedLayer, placed: list[Segment]) -> None:
        self.context, self.journal = context, context.journal
        program = context.program
        deposits = [s for s in placed if s.kind == Kind.DEPOSIT]
        whole = program.layer(layer.number).deposits
        beads = list(dict.fromkeys(s.bead for s in whole))
        here = list(dict.fromkeys(s.bead for s in deposits))
        self.segments_before = len(whole) - len(deposits)
        self.beads_before = beads.index(here[0]) if here else len(beads)
        last = {s.bead: s.index for s in deposits}
        self.ends = np.array([last[b] for b in here], dtype=np.int64)
        self.starts = {s.index: s.bead for s in deposits}
        self.laid_before = sum(s.duration for s in whole) - sum(s.duration for s in deposits)
        self.times = np.cumsum([s.duration for s in deposits])
        self.indices = np.array([s.index for s in deposits], dtype=np.int64)
        # once: there is an estimate after every segment
        durations = [p.arc_time for p in program.current.layers]
        before = program.arc_time_before
        self.laid_below = before + sum(durations[: layer.number - program.offset - 1])
        self.arc_time = max(before + sum(durations), 1e-9)
        self._seen, self._written = (0, 0), -math.inf

    def on_done(self, segment: Segment) -> None:
        """Publishes the status; writes a checkpoint when a bead begins or ends, and every PERIOD s within a bead."""
        status = self.journal.status
        done = self.beads_before + int(np.searchsorted(self.ends, segment.index, side='right'))
        bead = self.starts.get(segment.index, 0)
        status.bead = bead or status.bead
        self._estimate(segment.index)
        now = self.context.cell.now()
        new = (done, bead) != self._seen and (done != self._seen[0] or bead)
        if new or (bead and now - self._written >= PERIOD):
            self._seen, self._written = (done, bead), now
            self.journal.checkpoint(bead, done, segment.index, self.laid(segment.index))
        self.context.note_remarks()
        self.context.cell.status(status)

    def laid(self, index: int) -> int:
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
