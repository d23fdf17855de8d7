"""One scan from begin to finish: which job and layer it belongs to, what came, and what the map is worth."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waam_process.grid import GridSpec

from .assembler import Assembler, ProfileBlock
from .fusion import FusedMap
from .plausibility import PlausibilityLimits, jump_reasons, map_reasons, stream_reasons

DEFAULT_PERIOD_NS = 20_000_000


@dataclass(frozen=True)
class PreviousMap:
    """The last map of the job that was believed: the reference for the next one."""

    job_id: str
    layer: int
    spec: GridSpec
    z: np.ndarray


@dataclass
class EndWatch:
    """Decides when a finishing scan has waited enough. Times in s of a steady clock, stamps in ns.

    quiet: s without news after which nothing more is expected; news are profiles, and telemetry as long as it has not
    reached `until_ns`. end: when to give up although news keep coming.
    """

    until_ns: int
    quiet: float
    end: float
    news: float
    newest_pose_ns: int | None

    def gives_up(self, now: float) -> bool:
        return now > self.end

    def is_quiet(self, now: float, newest_pose_ns: int | None, last_batch: float) -> bool:
        if newest_pose_ns != self.newest_pose_ns and newest_pose_ns < self.until_ns:
            self.news, self.newest_pose_ns = now, newest_pose_ns
        return now - max(self.news, last_batch) > self.quiet


@dataclass
class Session:
    """A scan in progress. `batches`, `lost`, `refused` count batches received, missing by sequence, and malformed."""

    job_id: str
    layer: int
    scan_id: int
    assembler: Assembler
    began: float = 0.0  # s, steady clock of the caller
    batches: int = 0
    lost: int = 0
    refused: int = 0
    until_ns: int | None = None  # end of the scanning motion, once finish was asked for
    remarks: list[str] = field(default_factory=list)
    _sequence: int | None = None
    _period_ns: int = DEFAULT_PERIOD_NS

    @property
    def spec(self) -> GridSpec:
        return self.assembler.fusion.spec

    def add(self, sequence: int, block: ProfileBlock) -> None:
        """A batch. A gap in the sequence counts the missing ones; a number that falls is a scanner that restarted."""
        if self._sequence is not None and sequence > self._sequence + 1:
            self.lost += sequence - self._sequence - 1
        self._sequence = sequence
        self.batches += 1
        if len(block) > 1:
            self._period_ns = max(1, int(np.median(np.diff(block.stamps))))
        self.assembler.add(block)

    @property
    def closing(self) -> bool:
        return self.until_ns is not None

    @property
    def complete(self) -> bool:
        """Whether everything up to `until_ns` is here and has its pose."""
        newest = self.assembler.newest_ns
        if newest is None or self.until_ns is None:
            return False
        return newest >= self.until_ns - self._period_ns and self.assembler.waiting == 0

    def close(self) -> FusedMap:
        """No more profiles: the map."""
        self.assembler.close()
        return self.assembler.fusion.result()

    def doubts(
        self, fused: FusedMap, before: PreviousMap | None, limits: PlausibilityLimits
    ) -> list[str]:
        """Why the map should not be trusted; empty when it may be."""
        counts = self.assembler.counts
        last = self.assembler.newest_used_ns or 0
        age = (self.until_ns - last) * 1e-9 if self.until_ns else 0.0
        reasons = map_reasons(fused, limits)
        bad = self.lost + self.refused
        reasons += stream_reasons(counts.used, counts.untrusted, self.batches, bad, age, limits)
        if before and before.job_id == self.job_id and before.spec == fused.spec:
            reasons += jump_reasons(fused, before.z, self.layer - before.layer, limits)
        return reasons

    def notes(self) -> list[str]:
        """Remarks that do not make a map implausible."""
        return self.remarks + self.assembler.counts.reasons()
