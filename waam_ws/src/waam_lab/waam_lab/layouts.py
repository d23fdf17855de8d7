"""Layouts of a job: the same part laid in other ways, what came of them, and the one to take.

How evenly beads fit a part is a matter of its shape, and a little more or less of a bead changes the result by a third.
The planner's process model does not see it (docs/planning.md), the laboratory does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.finish import MACHINED
from waam_process.materials import get

from .job import LabJob, LabResult

MIN_GAIN = 0.03  # a layout that does not succeed either must have so much less RMS


@dataclass(frozen=True)
class Layout:
    """What is changed of a job."""

    name: str
    width: float = 1.0  # bead width over that of the job
    strategy: str = ''  # how layers are filled; '' = as the job has it
    settings: tuple[str, ...] = ()  # of the planner


ASKED = Layout('as asked')
MACHINING = (f'finish={MACHINED}',)
OTHERS = (
    Layout('finish machined', settings=MACHINING),
    Layout('narrow beads', 0.7),
    Layout('parallel beads', strategy='zigzag'),
    Layout('narrow parallel beads', 0.75, 'zigzag'),
)


def others(job: LabJob) -> tuple[Layout, ...]:
    """Layouts that differ from the job's own and that it can have. A program has its path."""
    if job.goal.program is not None:
        return ()
    own = _own(job)
    able = [one for one in OTHERS if not (one.strategy and job.goal.strategy)]
    if job.goal.mode != 'restore' or job.goal.allowance or 'finish' in own:
        able = [one for one in able if one.settings != MACHINING]
    return tuple(one for one in able if laid(job, one) != job)


def _own(job: LabJob) -> set[str]:
    return {text.partition('=')[0].strip() for text in job.goal.plan_settings}


def laid(job: LabJob, layout: Layout) -> LabJob:
    """The job with that layout. Settings of the planner that the job has itself stay as they are."""
    goal, own = job.goal, _own(job)
    added = tuple(t for t in layout.settings if t.partition('=')[0] not in own)
    width = goal.bead_width
    if layout.width != 1.0:
        width = round(layout.width * (width or get(goal.material).bead_width), 6)
    settings = (*goal.plan_settings, *added)
    strategy = goal.strategy or layout.strategy
    return replace(
        job, goal=replace(goal, bead_width=width, strategy=strategy, plan_settings=settings)
    )


@dataclass(frozen=True)
class Trial:
    """One layout and what came out of it, cell by cell."""

    layout: Layout
    results: tuple[LabResult, ...]

    def mean(self, name: str) -> float:
        """Mean of a figure over the cells; NaN when a job failed."""
        if any(r.failed for r in self.results):
            return math.nan
        return float(np.mean([getattr(r, name) for r in self.results]))

    @property
    def good(self) -> int:
        """Cells on which it is in tolerance, or cleans up."""
        return sum(r.in_tolerance for r in self.results)

    @property
    def machined(self) -> bool:
        """Whether it is judged by what is below nominal after machining."""
        return any(math.isfinite(r.clean_share) for r in self.results)


def best(asked: Trial, trials: Sequence[Trial]) -> Trial | None:
    """The trial that succeeds on most cells, on more than what was asked for; as laid before machined, then the least
    RMS. Where none succeeds more often: the least RMS with the same finish, if it is MIN_GAIN less. None: nothing is
    better."""
    able = [t for t in trials if math.isfinite(t.mean('time'))]
    share = asked.good / len(asked.results)
    better = [t for t in able if t.good / len(t.results) > share]
    if better:
        return min(better, key=lambda t: (-t.good / len(t.results), t.machined, t.mean('rms')))
    limit = (1 - MIN_GAIN) * asked.mean('rms')  # NaN where what was asked for cannot be laid
    less = [
        t
        for t in able
        if (t.machined == asked.machined or not math.isfinite(limit)) and not t.mean('rms') >= limit
    ]
    return min(less, key=lambda t: t.mean('rms')) if less else None


def options(job: LabJob, layout: Layout) -> list[str]:
    """What `waam job run` and `waam plan` want to hear for that layout, beyond what the job has."""
    goal = laid(job, layout).goal
    words = []
    if goal.bead_width != job.goal.bead_width:
        words += ['--bead-width', f'{goal.bead_width * 1e3:g}']
    if goal.strategy != job.goal.strategy:
        words += ['--strategy', goal.strategy]
    for text in goal.plan_settings[len(job.goal.plan_settings) :]:
        words += ['--finish', MACHINED] if text in MACHINING else ['--set', text]
    return words
