"""One scan from begin to finish: which job and layer it belongs to, what came, and what the map is worth."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waam_process.grid import GridSpec

from ..bead_width import BeadWidth, bead_width
from ..fusion.height_map import FusedMap
from ..fusion.plausibility import PlausibilityLimits, jump_reasons, map_reasons, stream_reasons
from .assembler import Assembler
from .profiles import ProfileBlock, SequenceWatch

EMPTY_ENDS = 1.5  # both ends of a scan lie equally far beside the part, or nearly so
DEFAULT_PERIOD_NS = 20_000_000


@dataclass(frozen=True)
class PreviousMap:
    """The last map of the job that was believed: the reference for the next one."""

    job_id: str
    layer: int
    spec: GridSpec
    z: np.ndarray


@dataclass(frozen=True)
class LaidBeads:
    """Beads of the layer that was laid last: paths, each (n, 2) m in the work frame from arc on to arc off, and of each
    point (n,) m the width that is expected of the piece that ends there."""

    paths: tuple[np.ndarray, ...] = ()
    widths: tuple[np.ndarray, ...] = ()


@dataclass
class Surfaces:
    """The last maps that were believed: the newest one, and the one of the layer below it."""

    last: PreviousMap | None = None
    _below: PreviousMap | None = None

    def add(self, new: PreviousMap) -> None:
        """A scan that was believed. One of a layer that was scanned before takes the place of that one."""
        if self.last is not None and self.last.layer != new.layer:
            self._below = self.last
        self.last = new

    def below(self, job_id: str, layer: int, spec: GridSpec) -> np.ndarray | None:
        """Surface under `layer`, (rows, cols) m; None when it is not known on these cells in this job."""
        for found in (self.last, self._below):
            if found is not None and (found.job_id, found.layer, found.spec) == (
                job_id,
                layer - 1,
                spec,
            ):
                return found.z
        return None


@dataclass
class EndWatch:
    """Decides when a finishing scan has waited enough. Times in s of a steady clock.

    News are profiles, and telemetry as long as it has not reached `until_ns`.
    """

    until_ns: int | None  # stamp of the end of the motion
    quiet: float  # s without news, after which nothing more is expected
    end: float  # when to give up although messages keep coming
    news: float  # when the last news came
    newest_pose_ns: int | None  # stamp of the newest telemetry

    def gives_up(self, now: float) -> bool:
        """Whether it is too late to wait any longer, at steady time `now`, s."""
        return now > self.end

    def is_quiet(self, now: float, newest_pose_ns: int | None, last_batch: float) -> bool:
        """Whether no news came for `quiet` s. newest_pose_ns: stamp, ns; last_batch: when one came, s."""
        new = newest_pose_ns != self.newest_pose_ns
        if new and (newest_pose_ns or 0) < (self.until_ns or 0):
            self.news, self.newest_pose_ns = now, newest_pose_ns
        return now - max(self.news, last_batch) > self.quiet


@dataclass
class Session:
    """A scan in progress. `batches`, `lost`, `refused` count batches received, missing by sequence, and malformed."""

    job_id: str
    layer: int
    scan_id: int
    assembler: Assembler
    laid: LaidBeads = LaidBeads()
    began: float = 0.0  # s, steady clock of the caller
    batches: int = 0
    refused: int = 0
    until_ns: int | None = None  # end of the scanning motion, once finish was asked for
    remarks: list[str] = field(default_factory=list)
    sequences: SequenceWatch = field(default_factory=SequenceWatch)
    _refreshed: float = -1.0

    @property
    def lost(self) -> int:
        """Batches that are missing by their sequence numbers."""
        return self.sequences.lost

    @property
    def spec(self) -> GridSpec:
        """The cells of the map."""
        return self.assembler.fusion.spec

    def add(self, sequence: int, block: ProfileBlock) -> None:
        """A batch; missing numbers count as lost."""
        before = self.assembler.newest_ns
        self.assembler.add(block)
        after = self.assembler.newest_ns
        self.sequences.follow(sequence, before is None or (after is not None and after > before))
        self.batches += 1

    def refresh(self, now: float, period: float) -> None:
        """Works up what came, every `period` s of the caller's steady clock, so that the map is ready soon at the
        end."""
        if now - self._refreshed >= period:
            self._refreshed = now
            self.assembler.fusion.refresh()

    @property
    def closing(self) -> bool:
        """The end was asked for; profiles up to `until_ns` are still waited for."""
        return self.until_ns is not None

    @property
    def complete(self) -> bool:
        """Whether everything up to `until_ns` is here and has its pose."""
        newest = self.assembler.newest_ns
        if newest is None or self.until_ns is None:
            return False
        period = self.assembler.watch.period_ns or DEFAULT_PERIOD_NS
        return newest >= self.until_ns - period and self.assembler.waiting == 0

    def close(self) -> FusedMap:
        """No more profiles: the map."""
        self.assembler.close()
        return self.assembler.fusion.result()

    def doubts(
        self, fused: FusedMap, before: PreviousMap | None, limits: PlausibilityLimits
    ) -> list[str]:
        """Why the map should not be trusted; empty when it may be."""
        counts = self.assembler.counts
        if before and (before.job_id, before.spec) != (self.job_id, fused.spec):
            before = None  # nothing to compare with
        last = self.assembler.newest_used_ns or 0
        begin, end = self.assembler.empty_ends
        # the end of a scan may lie beside the part; a scanner gone blind shows in the loss of coverage, or, in a first
        # map, in an end that is emptier than the beginning
        if before or end <= EMPTY_ENDS * begin:
            last = max(last, self.assembler.newest_empty_ns or 0)
        age = (self.until_ns - last) * 1e-9 if self.until_ns else 0.0
        reasons = map_reasons(fused, limits)
        bad = self.lost + self.refused
        reasons += stream_reasons(counts.used, counts.untrusted, self.batches, bad, age, limits)
        if before:
            reasons += jump_reasons(fused, before.z, self.layer - before.layer, limits)
        return reasons

    def width(self, fused: FusedMap, surfaces: Surfaces) -> BeadWidth:
        """Of the beads that were laid last, where they stand free and the surface below them is known."""
        below = surfaces.below(self.job_id, self.layer, fused.spec)
        if below is None or not self.laid.paths:
            return BeadWidth()
        return bead_width(below, fused.z, fused.spec, self.laid.paths, self.laid.widths)

    def notes(self) -> list[str]:
        """Remarks that do not make a map implausible."""
        counts = self.assembler.counts
        return self.remarks + counts.reasons() + counts.remarks()
