"""An interrupted job goes on: what is on disk, what is on the table, and the first bead that is not done."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np

from waam_node import job_folder
from waam_plan.gcode.store import load_plan
from waam_plan.plan import PlanError, PlannedLayer
from waam_plan.shaft.lines import home, inside_turn
from waam_process.grid import HeightGrid
from waam_process.loop_mode import LoopMode

from ..model.cell import Scan
from ..model.goal import Code, JobError
from ..model.resume import (
    ResumeError,
    check_place,
    check_unmoved,
    cold_share,
    laid_range,
    progress_of,
    rest_of,
)
from ..model.shift import expected_of, find_shift
from ..store import checkpoint as checkpoints
from .context import JobContext
from .layer_cycle import History, LayerCycle
from .layer_observer import AskedMetal
from .part_scanner import PartScanner
from .passes import Passes
from .planning import wire_of, wire_problems


class ResumeRun:
    """Brings a run to the point where the run before it stopped."""

    def __init__(
        self, context: JobContext, scanner: PartScanner, passes: Passes, cycle: LayerCycle
    ) -> None:
        self.context, self.scanner, self.passes, self.cycle = context, scanner, passes, cycle
        self.journal, self.program, self.goal = context.journal, context.program, context.goal
        self.cell, self.settings, self.folder = (
            context.cell,
            context.settings,
            context.journal.folder,
        )
        self.number = 0  # of the layer that was under way
        self.lost = ''  # why the records of the runs before cannot be used
        self.checkpoint, self.doubts = checkpoints.load(self.folder.path)

    def load(self) -> list[JobError] | None:
        """Reads records and plans of earlier runs. Returns the problems of the wire; None when nothing was planned."""
        self.number = self.folder.last_map() + 1
        self.lost = self.journal.take_over(self.number)
        try:
            if self.number > 0:
                self._load_plans(self.number)
            self.program.remember(self.journal.passes_before)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, StopIteration) as e:
            text = f'plans and records do not belong together ({type(e).__name__}: {e})'
            raise JobError(Code.BAD_RESUME, text) from None
        return self.wire_problems() if self.program.planned else None

    def wire_problems(self) -> list[JobError]:
        """Whether the spool holds what is certainly missing. The scan finds how much of the current layer is laid."""
        layers = self._layers_from(
            self.number + 1 if self._spool_knows(self.number) else self.number
        )
        return wire_problems(self._wire(layers), self.journal.wire_left)

    def _spool_knows(self, number: int) -> bool:
        """Whether the entered length of wire already excludes all that was laid of a layer."""
        recorded = any(r.layer == number for r in self.journal.layers)
        return recorded or self.goal.new_spool

    def _layers_from(self, number: int) -> list[PlannedLayer]:
        return [p for p in self.program.current.layers if p.number >= number]

    def _wire(self, layers: list[PlannedLayer]) -> float:
        return wire_of(layers, self.program.current.settings)

    def run(self) -> tuple[Scan, int] | None:
        """The scan to go on from and the number of the next whole layer; the rest of a begun layer is laid here.

        None: nothing was planned before the interruption, the job starts anew.
        """
        for text in self.doubts:
            self.journal.note('WARNING', 'node', text, 'the generation before is used')
        if self.lost:
            self.journal.note('WARNING', 'node', self.lost, 'the report begins with this run')
        if not self.program.planned:
            text = 'resumed before the first layer'
            self.journal.note('INFO', 'operator', text, 'started anew')
            return None
        if self.number > self.program.done_after_pass:
            return self._between_passes(self.number)
        return self._in_layer(self.number)

    def _load_plans(self, number: int) -> None:
        """The passes that were planned up to layer `number`."""
        for p in count(1):
            file = self.folder.path / job_folder.plan(p)
            finished = self.program.planned and number <= self.program.done_after_pass
            if finished or not file.exists():
                return
            try:
                self.passes.add(load_plan(file), keep=False)
            except PlanError as e:
                raise JobError(Code.BAD_RESUME, str(e)) from None

    def _between_passes(self, number: int) -> tuple[Scan, int]:
        """All layers planned so far are laid; only a scan (and the next pass) is missing."""
        self._say(number - 1, 'all of it is done')
        scan = self.scanner.scan_after(number - 1, required=True)
        try:
            last = self.program.layer(number - 1)
            self._check_place(last, self._stored_scan(number - 1), scan)
        except ResumeError as e:
            raise JobError(Code.BAD_RESUME, str(e)) from None
        return scan, number

    def _in_layer(self, number: int) -> tuple[Scan, int]:
        """The rest of a layer gets the correction of the whole one, from the surface before it: metal that its first
        beads have spread to the side belongs to the plan and is no error."""
        layer = self.program.layer(number)
        before = self._stored_scan(number - 1)
        self._relearn(number)
        self.journal.status.layer = number
        scan = self.scanner.scan_after(number - 1, required=True)
        settings = self.program.current.settings
        shown = replace(layer, segments=home(layer.segments, settings))  # where the maps show them
        try:
            self._check_place(shown, before, scan, laid_range(shown.deposits, *self._laid(number)))
            check_unmoved(layer, before.map, scan.map, 1.5 * settings.bead_width)
            asked = replace(shown, planned=self._asked(layer))
            progress = progress_of(asked, before.map, scan.map, *self._laid(number))
        except ResumeError as e:
            raise JobError(Code.BAD_RESUME, str(e)) from None
        if progress.done == 0:
            self._say(number, 'nothing of it is laid')
            return scan, number
        if progress.complete:
            self._say(number, 'all of it is laid')
            self._spend(layer, [])
            self._remember(number)
            return self.cycle.found(layer, before), number + 1
        share = self._cold_share(number)
        self._say(
            number,
            f'{progress.done} of {progress.total} segments are laid, on from bead {progress.bead} '
            f'with {share:.0%} of its metal',
        )
        rest = rest_of(layer, progress, share, self.settings.restart_metal)
        self._spend(layer, [rest])
        left = min(s.index for s in rest.deposits)
        earlier = [s for s in layer.deposits if s.index < left]
        scan = self.cycle.lay(rest, before, AskedMetal(self.context, earlier, asked.planned))
        self._remember(number)
        return scan, number + 1

    def _check_place(
        self, layer: PlannedLayer, before: Scan, scan: Scan, laid: tuple[int, int] = (0, 0)
    ) -> None:
        """ResumeError where the part was moved since the map `before`, on which at least and at most so many deposits
        of the layer were laid. What the shape does not show of a shift is noted."""
        settings = self.program.current.settings
        ground = inside_turn(before.map, settings)
        expected = expected_of(ground, layer.volume, layer.deposits, *laid)
        ahead = [s for p in self._layers_from(layer.number) for s in home(p.deposits, settings)]
        places = np.array(
            [s.start[:2] for s in ahead] or [(scan.map.spec.x.mean(), scan.map.spec.y.mean())]
        )
        shift = find_shift(expected, scan.map, places)
        check_place(shift, layer.number)
        if shift.unseen:
            text = f'whether the part was moved is not known for certain: {shift.unseen}'
            self.journal.note(
                'WARNING', 'operator', text, 'look at the place of the part before the arc'
            )
            self.journal.say(text)
        else:
            text = f'the part lies in its place: up to {shift.words}'
            self.journal.note('INFO', 'operator', text, 'none')

    def _spend(self, layer: PlannedLayer, rest: list[PlannedLayer]) -> None:
        """What was laid of a begun layer is no longer on the spool. JobError when it does not hold what is missing."""
        journal = self.journal
        if not self._spool_knows(layer.number):
            journal.begun = self._wire([layer]) - self._wire(rest)
        needed = self._wire([*rest, *self._layers_from(layer.number + 1)])
        if short := wire_problems(needed, journal.wire_left):
            raise short[0]

    def _laid(self, number: int) -> tuple[int, int | None]:
        """Beads and deposit segments of layer `number` that the checkpoint calls done; None = it does not say."""
        c = self.checkpoint
        return (c.beads_done, c.laid) if c is not None and c.layer == number else (0, None)

    def _cold_share(self, number: int) -> float:
        """Of the metal, see `resume.cold_share`. Without a whole checkpoint the telemetry track says how warm the layer
        was, up to its last whole bead; 1 when nothing says it."""
        c, before = self.checkpoint, self.folder.last_temperature()
        if c is not None and c.layer == number and c.temperature is not None:
            before = c.temperature
        return cold_share(before, self.cell.heat().temperature, self.settings.cold_metal)

    def _say(self, layer: int, text: str) -> None:
        self.journal.note('INFO', 'operator', f'resumed in layer {layer}: {text}', 'none')

    def _map(self, number: int) -> dict[str, np.ndarray]:
        """What is stored of the surface after layer `number`. JobError when it cannot be read."""
        stored = self.folder.read_map(number)
        name, spec = job_folder.map_after(number), self.scanner.spec
        if stored is None:
            raise JobError(Code.BAD_RESUME, f'{name} is missing or torn')
        place = [spec.origin_x, spec.origin_y, spec.resolution]
        told = [*np.ravel(stored.get('origin', ())), *np.ravel(stored.get('resolution', ()))]
        maps = [stored.get(n) for n in ('z', 'sigma', 'count')]
        maps += [stored[n] for n in ('asked',) if n in stored]
        same = len(told) == 3 and np.allclose(told, place, atol=1e-9)
        if not same or any(
            m is None or m.shape != spec.shape or m.dtype.kind not in 'fiu' for m in maps
        ):
            raise JobError(Code.BAD_RESUME, f'{name} holds no maps on the grid of this job')
        return stored

    def _stored_scan(self, number: int) -> Scan:
        stored = self._map(number)
        z, sigma = (stored[n].astype(float) for n in ('z', 'sigma'))
        widths = np.ravel(stored.get('bead_width', np.full(3, np.nan)))
        width, u, expected = (float(v) for v in widths) if widths.size == 3 else (np.nan,) * 3
        return Scan(
            map=HeightGrid(self.scanner.spec, z, sigma),
            count=stored['count'],
            coverage=float(np.isfinite(z).mean()),
            plausible=True,
            stored=True,
            bead_width=width,
            bead_width_u=u,
            bead_width_expected=expected,
        )

    def _asked(self, layer: PlannedLayer) -> np.ndarray:
        """Metal (rows, cols) m that the setpoints of a layer asked for; what was planned when nobody wrote it down."""
        stored = self._map(layer.number - 1)
        return stored['asked'].astype(float) if 'asked' in stored else layer.planned

    def _remember(self, number: int) -> None:
        """Layer `number` becomes the one that the next scan is compared with."""
        stored = self._map(number - 1)
        self.cycle.history = History()
        if 'asked' in stored and 'feed_factor' in stored:
            self.cycle.history = History(
                growth=stored['asked'].astype(float),
                surface=stored['z'].astype(float),
                feed_factor=float(stored['feed_factor']),
            )

    def _relearn(self, number: int) -> None:
        """Repeats the layers so far to the correction server, so that it knows the process as before."""
        if self.goal.loop_mode == LoopMode.OPEN_LOOP:
            return
        for k in range(1, number):
            if self.folder.read_map(k - 1) is None:
                continue
            request = self.cycle.request(self.program.layer(k), self._stored_scan(k - 1))
            self.cell.correct(self.context.run_id, request)
            self._remember(k)
