"""The rest of a layer is corrected while its first beads are laid, by what the scanner shows beside the arc.

It looks when a bead begins and every few seconds, asks the correction server for the correction of the whole layer with
what was seen, sets the segments that are still to come by it, and has the bridge replace those that wait. Every answer
starts from the correction that the layer began with, and is divided into speed and feed once (docs/interfaces.md).
The rest of a layer that was cut off is corrected in the same way, first of all by the scan that it was resumed with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from waam_plan.plan import PlannedLayer
from waam_process.segment import Kind, Segment

from ..model.cell import Correction, FeedRequest, RenewRequest, Scan
from ..model.geometry import asked_growth, driven_growth
from ..model.goal import JobError
from ..model.records import LayerRecord
from ..model.seen import Look, Reach, SeenLayer
from .context import JobContext

WORTH = 0.003  # relative change of a speed or feed below which nothing is replaced
SHARE = 0.5  # of the way from the torch to the scanner, between two looks
LAST_LEFT = 1.0  # s of path; a shorter rest is not worth a request
RESTART = 2.0  # bead widths behind a restart whose metal is not that of a bead


@dataclass(frozen=True)
class Laid:
    """What there is of a layer that was cut off: deposits; asked (rows, cols) m, metal that the setpoints asked for
    when they were laid; scan: the surface with them."""

    deposits: list[Segment]
    asked: np.ndarray
    scan: Scan


class InLayer:
    """One layer, or the rest of one (laid: what there is of it). Call `on_done` with the newest finished segment, `end`
    when the layer is laid or given up.

    `placed`, `correction` and `asked` are those that are in force: of what was replaced, the new ones.
    """

    def __init__(
        self,
        context: JobContext,
        layer: PlannedLayer,
        scan: Scan,
        correction: Correction,
        placed: list[Segment],
        record: LayerRecord,
        laid: Laid | None = None,
    ) -> None:
        self.context, self.cell, self.journal = context, context.cell, context.journal
        self.layer, self.scan, self.record = layer, scan, record
        self.base = self.correction = correction
        self.heat_factor, self.placed = min(record.heat_factor, 1.0), placed
        width = context.program.current.settings.bead_width
        self._first = placed[0].index
        earlier = [s.at(index=self._first - 1) for s in (laid.deposits if laid else ())]
        self.seen = SeenLayer(scan.map.z, Reach.of([*earlier, *placed], scan.map.spec, width))
        self._laid, self._news = laid, False
        self._bead, self._looked, self._done = 0, self.cell.now(), self._first - 1
        self._heard = self._first - 1  # newest segment that was reported
        self._over, self._way = False, 0.0
        # m between two looks: a scanner that trails sees metal that was finished before the look began
        self._far = SHARE * abs(context.program.current.settings.scanner_offset[0])
        self._scan_id: int | None = None
        if laid is not None:
            self._start_from(laid, RESTART * width)

    def _start_from(self, laid: Laid, reach: float) -> None:
        """The scan that the rest is begun with shows ground and finished metal of the whole layer."""
        look = Look(laid.scan.map.z, np.asarray(laid.scan.count, float))
        done = self._first - 1
        self._news = self.seen.add(look, done, done, self.asked, self.cell.now()) > 0
        deposits, path = [s for s in self.placed if s.kind == Kind.DEPOSIT], 0.0
        for s in deposits:
            if path >= reach:
                break
            self.seen.altered(s.index, s.index)
            path += s.length

    def begin(self) -> None:
        """The scanner goes on."""
        self._try(self._begin)

    @property
    def asked(self) -> np.ndarray:
        """Metal that the setpoints in force ask for, (rows, cols) m."""
        return self._with_laid(self.correction)

    def _with_laid(self, c: Correction) -> np.ndarray:
        """(rows, cols) m that the setpoints by a correction ask for; where the metal was laid earlier, as it was."""
        planned = self.layer.planned
        asked = asked_growth(planned, c.psi, c.k_gain, c.residual_height)
        asked = driven_growth(asked, planned, self.scan.map.spec, self.placed)
        if self._laid is None:
            return asked
        return np.where(self.seen.reach.nearest < self._first, self._laid.asked, asked)

    def _try(self, action: Callable[..., None], *args: Any) -> None:
        """A node that cannot answer ends the looking, never the bead."""
        try:
            action(*args)
        except JobError as e:
            self._scan_id = None
            self.record.reasons.append(f'in-layer correction ended: {e}')
            self.journal.note('WARNING', 'correction', str(e), 'the layer goes on as it was set')

    def _begin(self) -> None:
        self._scan_id = self.cell.begin_look(
            self.context.run_id, self.layer.number, self.scan.map.spec
        )

    def on_done(self, segment: Segment) -> None:
        """Looks and corrects when it is time to."""
        if self._scan_id is None:
            return
        control = self.context.control
        if control.metal_factor != 1.0:
            self.seen.altered(self._heard, segment.index + 1)
        newest = segment.index + 1 - self._first
        self._way += sum(s.length for s in self.placed[self._heard + 1 - self._first : newest])
        self._heard = segment.index
        self._over |= self._over_part()
        now, bead = self.cell.now(), segment.bead or self._bead
        new = bead != self._bead
        due = now - self._looked >= self.context.settings.in_layer_period or self._way >= self._far
        self._bead = bead
        if self._over and (new or due):
            self._try(self._look, segment.index, now)
        elif self._news:
            self._try(self._correct, segment.index, now)

    def _over_part(self) -> bool:
        """Whether the scanner's line is over the map."""
        offset = self.context.program.current.settings.scanner_offset[0]
        x0, x1, _, _ = self.scan.map.spec.extent
        return x0 <= self.cell.machine().position[0] + offset <= x1

    def _look(self, done: int, now: float, last: bool = False) -> None:
        assert self._scan_id is not None
        look = self.cell.look(self._scan_id, last)
        told = self.seen.add(look, self._done, done, self.asked, now)
        self._done, self._looked, self._over, self._way = done, now, False, 0.0
        self.record.in_layer_looks += 1
        self.record.in_layer_seen = self.seen.share(self.layer.planned)
        if told and not last:
            self._correct(done, now)

    def _rest(self, done: int) -> list[Segment]:
        """What can still be set: all that begins later than the preview from now on."""
        ahead, preview = 0.0, self.context.settings.in_layer_preview
        for k in range(done + 1 - self._first, len(self.placed)):
            if ahead >= preview:
                return self.placed[k:]
            ahead += self.placed[k].duration
        return []

    def _correct(self, done: int, now: float) -> None:
        self._news = False
        rest = self._rest(done)
        if sum(s.duration for s in rest if s.kind == Kind.DEPOSIT) < LAST_LEFT:
            return
        renewed = self.cell.renew(
            self.context.run_id,
            RenewRequest(
                layer=self.layer.number,
                correction=self.base,
                planned=self.layer.planned,
                ground=self.seen.ground,
                growth=self.seen.growth,
                count=self.seen.count,
                age=self.seen.age(now),
                bead_width=self.context.program.current.settings.bead_width,
            ),
        )
        wanted = self._setpoints(rest, renewed.correction)
        if not _differ(rest, wanted):
            return
        first, count = self.cell.replace(self.context.run_id, wanted, True)
        if count:
            self._in_force(first, wanted, renewed.correction, done, now)

    def _setpoints(self, rest: list[Segment], correction: Correction) -> list[Segment]:
        """The rest of the layer by another correction. The voltage stays: a layer has one."""
        request = FeedRequest(
            material=self.context.goal.material,
            segments=rest,
            correction=correction,
            heat_factor=self.heat_factor,
            apply=True,
        )
        found = self.cell.setpoints(self.context.run_id, request)
        return [s.at(voltage=old.voltage) for s, old in zip(found, rest, strict=True)]

    def _in_force(
        self, first: int, wanted: list[Segment], correction: Correction, done: int, now: float
    ) -> None:
        """What the bridge has taken: setpoints, metal asked for, records."""
        k = first - self._first
        self.placed = self.placed[:k] + wanted[len(wanted) - (len(self.placed) - k) :]
        deposits = [s for s in self.placed[k:] if s.kind == Kind.DEPOSIT]
        if not deposits:
            return
        later, before = self.seen.reach.nearest >= first, self.asked
        self.correction = replace(
            self.correction,
            psi=np.where(later, correction.psi, self.correction.psi),
            residual_height=np.where(
                later, correction.residual_height, self.correction.residual_height
            ),
            handle=None,
        )
        own = self._with_laid(self.base)
        planned = np.where(self.layer.planned > 0, self.layer.planned, np.inf)
        most = float(np.abs((self.asked - own) / planned)[later].max(initial=0.0))
        record = self.record
        record.in_layer_corrections += 1
        record.in_layer_segments += len(deposits)
        record.in_layer_change = max(record.in_layer_change, most)
        self.journal.in_layer(
            {
                'time': now,
                'layer': self.layer.number,
                'bead': self._bead,
                'done': done,
                'first': first,
                'segments': len(deposits),
                'seen': record.in_layer_seen,
                'change_max': most,
                'metal_mean_change': _mean((self.asked - before) / planned, later),
            }
        )
        self.cell.plan(self.context.run_id, self.layer.number, self.placed)

    def end(self) -> None:
        """The scanner goes off. What it showed last counts for the scan pass that follows."""
        if self._scan_id is not None:
            self._try(self._look, self._heard, self.cell.now(), True)
            self._scan_id = None


def _differ(old: list[Segment], new: list[Segment]) -> bool:
    """Whether a setpoint is another one by more than WORTH."""
    return any(
        abs(b.speed - a.speed) > WORTH * a.speed
        or abs(b.wire_feed_speed - a.wire_feed_speed) > WORTH * a.wire_feed_speed
        for a, b in zip(old, new, strict=True)
        if a.kind == Kind.DEPOSIT
    )


def _mean(change: np.ndarray, where: np.ndarray) -> float:
    hit = change[where & (change != 0)]
    return float(hit.mean()) if hit.size else 0.0
