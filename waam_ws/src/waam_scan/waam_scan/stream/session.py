"""One scan from begin to finish: profiles wait until telemetry brackets them, then go into the fusion; at the end there
is a map, with every reason not to trust it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from waam_process.grid import GridSpec

from ..fusion.height_map import FusedMap, Fusion
from ..fusion.kernels import read_only, rows_seen
from ..fusion.plausibility import PlausibilityLimits, jump_reasons, map_reasons, stream_reasons
from .poses import MAX_GAP_NS, PoseStatus, PoseTrack
from .profiles import ProfileBlock, ProfileCounts, SequenceWatch, StampWatch

EMPTY_ENDS = 1.5  # both ends of a scan lie equally far beside the part, or nearly so
DEFAULT_PERIOD_NS = 20_000_000
MAX_WAITING = 5000  # profiles that wait for telemetry: some seconds, 40 MB with 1000 points each
REFRESH_S = 0.25  # cells are worked up during the scan this often


@dataclass(frozen=True)
class PreviousMap:
    """A map of the job that was believed: the reference for the next one."""

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
    """A scan in progress: `add` profiles, `resolve` after new telemetry (poses come from `track`), `close` at the end.

    not_before_ns: profiles with earlier stamps belong to another surface. until_ns: end of the scanning motion, once it
    was asked for. batches, refused: received, and malformed; refusal: why the last message was not taken. fresh:
    profiles that are not from before the scan.
    """

    fusion: Fusion
    track: PoseTrack
    max_gap_ns: int = MAX_GAP_NS
    max_waiting: int = MAX_WAITING
    not_before_ns: int = -(2**62)
    job_id: str = ''
    layer: int = 0
    scan_id: int = 0
    laid: LaidBeads = LaidBeads()
    until_ns: int | None = None
    batches: int = 0
    refused: int = 0
    refusal: str = ''
    fresh: int = 0
    remarks: list[str] = field(default_factory=list)
    counts: ProfileCounts = field(default_factory=ProfileCounts)
    watch: StampWatch = field(default_factory=StampWatch)
    sequences: SequenceWatch = field(default_factory=SequenceWatch)
    oldest_used_ns: int | None = None
    newest_used_ns: int | None = None
    oldest_empty_ns: int | None = None
    newest_empty_ns: int | None = None
    _waiting: deque[ProfileBlock] = field(default_factory=deque)
    _refreshed: float = -1.0
    _passed: bool = False

    @property
    def spec(self) -> GridSpec:
        """The cells of the map."""
        return self.fusion.spec

    @property
    def waiting(self) -> int:
        """Profiles that wait for telemetry."""
        return sum(len(b) for b in self._waiting)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest profile that was added."""
        return self.watch.newest_ns

    @property
    def lost(self) -> int:
        """Batches that are missing by their sequence numbers."""
        return self.sequences.lost

    @property
    def closing(self) -> bool:
        """The end was asked for; profiles up to `until_ns` are still waited for."""
        return self.until_ns is not None

    @property
    def complete(self) -> bool:
        """Whether everything up to `until_ns` is here and has its pose."""
        if self.newest_ns is None or self.until_ns is None:
            return False
        period = self.watch.period_ns or DEFAULT_PERIOD_NS
        reached = self._passed or self.newest_ns >= self.until_ns - period
        return reached and self.waiting == 0

    # ---- profiles in -------------------------------------------------------------------------

    def add_batch(self, sequence: int, block: ProfileBlock) -> None:
        """A numbered batch; missing numbers count as lost."""
        before = self.newest_ns
        self.add(block)
        after = self.newest_ns
        self.sequences.follow(sequence, before is None or (after is not None and after > before))
        self.batches += 1

    def is_past(self, block: ProfileBlock) -> bool:
        """Whether all of it is from after the end, as of a scanner that always measures; nothing before it is missing
        then."""
        if self.until_ns is None or int(block.stamps.min()) + self._delay_ns <= self.until_ns:
            return False
        self._passed = True
        return True

    @property
    def _delay_ns(self) -> int:
        return round(self.fusion.mounting.delay * 1e9)

    def add(self, block: ProfileBlock) -> None:
        """Takes profiles in any order; repeated ones, those from before the scan and those without a return are
        rejected."""
        if not len(block):
            return
        block = block.shifted(self._delay_ns)
        new = self.watch.check(block.stamps, self.counts)
        fresh = block.stamps >= self.not_before_ns
        seen = rows_seen(read_only(block.x), read_only(block.z))
        self.counts.stale += int((new & ~fresh).sum())
        self.fresh += int((new & fresh).sum())
        self._pass_over(block.take(new & fresh & ~seen))
        self._push(block.take(new & fresh & seen))
        self.resolve()

    def _pass_over(self, empty: ProfileBlock) -> None:
        """Profiles without a return, as beside a tall part, where the table is out of range."""
        if len(empty):
            self.counts.empty += len(empty)
            self.fusion.dropouts += empty.z.size
            first, last = int(empty.stamps.min()), int(empty.stamps.max())
            self.oldest_empty_ns = min(self.oldest_empty_ns or first, first)
            self.newest_empty_ns = max(self.newest_empty_ns or last, last)

    def _push(self, block: ProfileBlock) -> None:
        if len(block):
            self._waiting.append(block)
        while self.waiting > self.max_waiting and len(self._waiting) > 1:
            self.counts.overflow += len(self._waiting.popleft())

    def resolve(self) -> None:
        """Fuses every waiting profile that telemetry brackets now; rejects those that it never will."""
        newest = self.track.newest_ns
        if newest is None:
            return
        for _ in range(len(self._waiting)):
            block = self._waiting.popleft()
            rest = self._fuse(block) if int(block.stamps.min()) <= newest else block
            if len(rest):
                self._waiting.append(rest)

    def _fuse(self, block: ProfileBlock) -> ProfileBlock:
        """Returns what must still wait."""
        tcp, status = self.track.at(block.stamps, self.max_gap_ns)
        ok = status == PoseStatus.OK
        if ok.any():
            good = block.take(ok)
            self.fusion.add(tcp[ok], good.x, good.z)
            first, last = int(good.stamps.min()), int(good.stamps.max())
            self.oldest_used_ns = min(self.oldest_used_ns or first, first)
            self.newest_used_ns = max(self.newest_used_ns or last, last)
        self.counts.used += int(ok.sum())
        self.counts.gap += int((status == PoseStatus.GAP).sum())
        self.counts.too_old += int((status == PoseStatus.TOO_OLD).sum())
        return block.take(status == PoseStatus.WAITING)

    def refresh(self, now: float, period: float = REFRESH_S) -> None:
        """Works up what came, every `period` s of the caller's steady clock, so that the map is ready soon at the
        end."""
        if now - self._refreshed >= period:
            self._refreshed = now
            self.fusion.refresh()

    # ---- the map -----------------------------------------------------------------------------

    def close(self) -> FusedMap:
        """Telemetry ends here, what still waits is rejected: the map."""
        self.resolve()
        self.counts.no_pose += self.waiting
        self._waiting.clear()
        return self.fusion.result()

    def doubts(
        self, fused: FusedMap, before: PreviousMap | None, limits: PlausibilityLimits
    ) -> list[str]:
        """Why the map should not be trusted; empty when it may be."""
        if before and (before.job_id, before.spec) != (self.job_id, fused.spec):
            before = None  # nothing to compare with
        last = self.newest_used_ns or 0
        begin, end = self._empty_ends()
        # the end of a scan may lie beside the part; a scanner gone blind shows in the loss of coverage, or, in a first
        # map, in an end that is emptier than the beginning
        if before or end <= EMPTY_ENDS * begin:
            last = max(last, self.newest_empty_ns or 0)
        age = (self.until_ns - last) * 1e-9 if self.until_ns else 0.0
        bad = self.lost + self.refused
        reasons = map_reasons(fused, limits)
        reasons += stream_reasons(
            self.counts.used, self.counts.untrusted, self.batches, bad, age, limits
        )
        if before:
            reasons += jump_reasons(fused, before.z, self.layer - before.layer, limits)
        return reasons

    def _empty_ends(self) -> tuple[float, float]:
        """How far the scan went without seeing anything at its beginning and at its end, m; beside a tall part the
        table is out of range. The time for which the scanner stands at an end does not count. Where telemetry does not
        reach back so far, the times themselves, s."""
        if self.oldest_used_ns is None or self.oldest_empty_ns is None:
            return 0.0, 0.0
        first, last = self.oldest_used_ns, self.newest_used_ns or 0
        begin, end = min(self.oldest_empty_ns, first), max(self.newest_empty_ns or 0, last)
        tcp, status = self.track.at(np.array([begin, first, last, end]), self.max_gap_ns)
        if (status != PoseStatus.OK).any():
            return (first - begin) * 1e-9, (end - last) * 1e-9
        return float(np.linalg.norm(tcp[1] - tcp[0])), float(np.linalg.norm(tcp[3] - tcp[2]))

    def notes(self) -> list[str]:
        """Remarks that do not make a map implausible."""
        return self.remarks + self.counts.reasons() + self.counts.remarks()

    def why_empty(self) -> str:
        """The reason for a map without a single point."""
        c, f = self.counts, self.fusion
        if not (c.used or c.rejected):
            return 'no profiles arrived' + (f' (refused: {self.refusal})' if self.refusal else '')
        if c.used == 0 and c.empty == c.rejected:
            return f'all {c.empty} profiles are drop-outs: the scanner saw nothing'
        if c.used == 0:
            return 'no profile has a trustworthy pose: ' + ', '.join(c.reasons())
        inside = f.points - f.outside - f.dropouts
        if f.outside and inside <= 0:
            return f'all {f.outside} points lie outside the grid or the height limits (mounting or work zero wrong?)'
        return f'{c.used} profiles gave no point that a neighbour supports'
