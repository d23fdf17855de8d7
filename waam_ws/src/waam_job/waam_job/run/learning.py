"""What former jobs of the cell have taught, from the file to the correction server, and what this one adds to it.

Every request of a job carries the same text, so the record says what a job started with, and a correction server that
was restarted has it again. The answers carry the same with what the job has shown so far; the last one is kept when the
job has ended in order.
"""

from __future__ import annotations

from typing import Any

from waam_node import job_folder
from waam_process.learned import Learned, LearnedError, parse, regime_of
from waam_process.loop_mode import LoopMode

from ..model.goal import planner_fields
from ..store.learned import LearnedFile, read
from ..store.trace import notes_of
from .context import JobContext

SIMULATED = 'simulated'


class Learning:
    """Of one run of a job. `text` goes with every request, '' = nothing is known of former jobs, nor kept."""

    def __init__(self, context: JobContext) -> None:
        self.context, self.journal, self.goal = context, context.journal, context.goal
        self.file: LearnedFile | None = None  # known once the controller is
        self.text, self.taught = '', ''  # what the job starts with, and the newest answer
        self._facts: dict[str, Any] = self.journal.learned

    def _file(self) -> LearnedFile | None:
        """None: the job starts without, and keeps nothing."""
        goal, settings = self.goal, self.context.settings
        if goal.fresh or goal.learned_dir is None or goal.loop_mode == LoopMode.OPEN_LOOP:
            return None
        wanted = planner_fields(goal, self.context.checked.material)
        regime = regime_of(wanted['bead_width'], wanted['layer_height'])
        named = SIMULATED if settings.simulated else self.context.cell.machine().identity
        if settings.chuck_steps_per_turn:
            named += '_chuck'  # metal grows otherwise on a shaft
        return LearnedFile.of(goal.learned_dir, settings.cell or named, goal.material, regime)

    def begin(self) -> None:
        """Reads the file, or for a run that goes on what the job had started with."""
        self.file = self._file()
        if self.file is None:
            if self.goal.fresh:
                self._say('starts without what former jobs have taught, as asked for')
            return
        if self.context.run > 1:
            self._resume()
            return
        found, trouble = self.file.read()
        self._facts['file'], self._facts['jobs'] = str(self.file.path), found.jobs
        self._facts['sha256'] = found.sha256 if found.jobs else ''
        self._facts['trouble'] = trouble
        if trouble:
            self.journal.note(
                'WARNING', 'correction', trouble, 'starts as the first job of its cell'
            )
        self._start(found, notes_of(self.goal).get('wire_lot', ''))

    def _start(self, found: Learned, lot: str) -> None:
        self.text = found.for_job(lot).text()
        self.journal.folder.keep(job_folder.LEARNED, self.text)
        of = f'of cell {found.cell} with {found.material}, {found.regime}'
        if not found.jobs:
            self._say(f'starts fresh: no job has taught anything yet {of}')
            return
        plural = 's' if found.jobs > 1 else ''
        lot_said = ', with another lot of wire' if found.other_lot(lot) else ''
        self._say(f'starts with what {found.jobs} job{plural} taught {of}{lot_said}')

    def _resume(self) -> None:
        """A run that goes on has what the job had started with; one of before this was kept has nothing."""
        try:
            found = read(self.journal.folder.path / job_folder.LEARNED)
        except FileNotFoundError:
            return
        except LearnedError as e:
            reaction = 'goes on without what former jobs have taught'
            self.journal.note('WARNING', 'correction', str(e), reaction)
            return
        self.text = found.text()
        self._facts['jobs'] = found.jobs

    def _say(self, text: str) -> None:
        self.journal.remarks.append(text)

    def finish(self) -> None:
        """Keeps what the job has taught, when it ended in order, in closed loop and in one run."""
        closed = self.goal.loop_mode == LoopMode.CLOSED_LOOP
        wanted = self.context.settings.keep_learned and closed and self.context.run == 1
        if self.file is None or not self.taught or not wanted:
            return
        try:
            learned = parse(self.taught)
            said = self.file.write(learned, self.journal.folder.job_id)
        except (OSError, LearnedError) as e:
            text = f'what the job has taught could not be kept in {self.file.path}: {e}'
            self.journal.note('WARNING', 'correction', text, 'the next job starts as this one did')
            return
        self._facts['sha256_after'] = learned.sha256
        if said:
            self._say(said)
