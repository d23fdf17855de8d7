"""An interrupted job goes on: what is on disk, what is on the table, and the first bead that is not done."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from waam_node import job_folder
from waam_plan.plan import PlanError, PlannedLayer
from waam_plan.post.store import load_plan
from waam_process.grid import HeightGrid
from waam_process.names import OPEN_LOOP

from ..model.cell import Scan
from ..model.goal import Code, JobError
from ..model.resume import ResumeError, check_unmoved, cold_share, progress_of, rest_of
from ..store import checkpoint as checkpoints
from .planning import wire_of, wire_problems

if TYPE_CHECKING:
    from .runner import JobRunner


class PickUp:
    """Works on a runner whose machine is prepared."""

    def __init__(self, runner: JobRunner) -> None:
        self.runner, self.folder = runner, runner.journal.folder
        self.number, self.planned = 0, False
        self.checkpoint, self.doubts = checkpoints.load(self.folder.path)

    def load(self) -> None:
        """Records and plans of the runs before. `number`: the layer that was under way; `planned`: there is a plan."""
        self.number = self.folder.last_map() + 1
        self.runner.journal.take_over(self.number)
        self.planned = self.number > 0 and self._load_plans(self.number)
        self.runner.program.remember(self.runner.journal.passes_before)

    def wire_problems(self) -> list[JobError]:
        """Whether the spool holds what is certainly missing; how much of the layer under way is laid, the scan says."""
        layers = self._layers_from(
            self.number + 1 if self._spool_knows(self.number) else self.number
        )
        return wire_problems(self._wire(layers), self.runner.journal.wire_left)

    def _spool_knows(self, number: int) -> bool:
        """Whether what the spool is said to hold leaves out all that was laid of a layer."""
        recorded = any(r.layer == number for r in self.runner.journal.layers)
        return recorded or self.runner.goal.new_spool

    def _layers_from(self, number: int) -> list[PlannedLayer]:
        return [p for p in self.runner.plan.layers if p.number >= number]

    def _wire(self, layers: list[PlannedLayer]) -> float:
        return wire_of(layers, self.runner.plan.settings)

    def run(self) -> tuple[Scan, int]:
        """The scan to go on from and the number of the next whole layer; the rest of a begun layer is laid here."""
        runner, number = self.runner, self.number
        for text in self.doubts:
            runner.journal.note('WARNING', 'node', text, 'the generation before is used')
        if not self.planned:
            runner.journal.note(
                'INFO', 'operator', 'resumed before the first layer', 'started anew'
            )
            return runner.begin()
        if number > runner.program.offset + runner.program.here:
            return self._between_passes(number)
        return self._in_layer(number)

    def _load_plans(self, number: int) -> bool:
        """The passes that were planned up to layer `number`; False when nothing was planned."""
        runner = self.runner
        for p in range(1, runner.program.passes + 1):
            file = self.folder.path / job_folder.plan(p)
            finished = runner.program.plan and number <= runner.program.offset + runner.program.here
            if finished or not file.exists():
                break
            try:
                runner.add_pass(load_plan(file), keep=False)
            except PlanError as e:
                raise JobError(Code.BAD_RESUME, str(e)) from None
        return runner.program.plan is not None

    def _between_passes(self, number: int) -> tuple[Scan, int]:
        """All layers planned so far are laid; only a scan (and the next pass) is missing."""
        runner = self.runner
        self._say(number - 1, 'all of it is done')
        return runner.survey(number - 1, required=True), number

    def _in_layer(self, number: int) -> tuple[Scan, int]:
        """The rest of a layer gets the correction of the whole one, from the surface before it: metal that its first
        beads have spread to the side belongs to the plan and is no error."""
        runner, layer = self.runner, self.runner.program.layer(number)
        before = self._stored_scan(number - 1)
        self._relearn(number)
        runner.status.layer = number
        scan = runner.survey(number - 1, required=True)
        try:
            check_unmoved(layer, before.map, scan.map, 1.5 * runner.plan.settings.bead_width)
            asked = replace(layer, planned=self._asked(layer))
            progress = progress_of(asked, before.map, scan.map, self._beads_done(number))
        except ResumeError as e:
            raise JobError(Code.BAD_RESUME, str(e)) from None
        if progress.done == 0:
            self._say(number, 'nothing of it is laid')
            return scan, number
        if progress.complete:
            self._say(number, 'all of it is laid')
            self._spend(layer, [])
            self._remember(number)
            return runner.survey(number), number + 1
        share = self._cold_share(number)
        self._say(
            number,
            f'{progress.done} of {progress.total} segments are laid, on from bead {progress.bead} '
            f'with {share:.0%} of its metal',
        )
        rest = rest_of(layer, progress, share, runner.settings.restart_metal)
        self._spend(layer, [rest])
        scan = runner.cycle.lay(rest, before, resumed=True)
        self._remember(number)
        return scan, number + 1

    def _spend(self, layer: PlannedLayer, rest: list[PlannedLayer]) -> None:
        """What was laid of a begun layer is no longer on the spool. JobError when it does not hold what is missing."""
        journal = self.runner.journal
        if not self._spool_knows(layer.number):
            journal.begun = self._wire([layer]) - self._wire(rest)
        needed = self._wire([*rest, *self._layers_from(layer.number + 1)])
        if short := wire_problems(needed, journal.wire_left):
            raise short[0]

    def _beads_done(self, number: int) -> int:
        c = self.checkpoint
        return c.beads_done if c is not None and c.layer == number else 0

    def _cold_share(self, number: int) -> float:
        """Of the metal, see `resume.cold_share`. Without a whole checkpoint the telemetry track says how warm the layer
        was, up to its last whole bead; 1 when nothing says it."""
        c, heat = self.checkpoint, self.runner.cell.heat()
        known = c is not None and c.layer == number and c.temperature is not None
        before = c.temperature if known else self.folder.last_temperature()
        return cold_share(before, heat.temperature, self.runner.settings.cold_metal)

    def _say(self, layer: int, text: str) -> None:
        self.runner.journal.note('INFO', 'operator', f'resumed in layer {layer}: {text}', 'none')

    def _stored_scan(self, number: int) -> Scan:
        stored = self.folder.read_map(number)
        z, sigma = (stored[n].astype(float) for n in ('z', 'sigma'))
        grid = HeightGrid(self.runner.surveyor.spec, z, sigma)
        return Scan(grid, stored['count'], float(np.isfinite(z).mean()), True)

    def _asked(self, layer: PlannedLayer) -> np.ndarray:
        """Metal (rows, cols) m that the setpoints of a layer asked for; what was planned when nobody wrote it down."""
        stored = self.folder.read_map(layer.number - 1)
        return stored['asked'].astype(float) if 'asked' in stored else layer.planned

    def _remember(self, number: int) -> None:
        """Layer `number` becomes the one that the next scan is compared with."""
        stored, history = self.folder.read_map(number - 1), self.runner.cycle.history
        known = stored is not None and 'asked' in stored
        history.growth = stored['asked'].astype(float) if known else None
        history.surface = stored['z'].astype(float) if known else None
        history.feed_factor = float(stored['feed_factor']) if known else 1.0

    def _relearn(self, number: int) -> None:
        """Shows the correction server the layers so far again, so that it knows the process as it did before."""
        runner = self.runner
        for k in range(1, number):
            stored = self.folder.read_map(k - 1)
            if stored is None or runner.goal.profile == OPEN_LOOP:
                continue
            request = runner.cycle.request(runner.program.layer(k), self._stored_scan(k - 1))
            runner.cell.correct(runner.run_id, request)
            self._remember(k)
