"""Layouts of a job: the same part laid in other ways, tried on cells of their own, and the one to take.

How evenly beads fit a part is a matter of its shape, and a little more or less of a bead changes the result by a third.
The planner's process model does not see it (docs/planning.md), the laboratory does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waam_process.materials import get
from waam_sim.config import plant_params

from . import params
from .job import LabJob, LabResult
from .plants import random_plant

FIRST_CELL = 9001  # seed of the first cell for choosing; reports are on other seeds
MIN_GAIN = 0.03  # a layout must have so much less RMS than the one that was asked for
MAX_TIME = 1.25  # machine time, over that of the layout that was asked for


@dataclass(frozen=True)
class Layout:
    """What is changed of a job."""

    name: str
    width: float = 1.0  # bead width over that of the job
    settings: tuple[str, ...] = ()  # of the planner


FINISH = ('finish_layers=4', 'finish_growth=1.2')
LAYOUTS = (
    Layout('as asked'),
    Layout('narrow beads', 5 / 6),
    Layout('growing finish', 1.0, FINISH),
    Layout('narrow beads, growing finish', 5 / 6, FINISH),
)


def laid(job: LabJob, layout: Layout) -> LabJob:
    """The job with that layout. Settings of the planner that the job has itself stay as they are."""
    goal = job.goal
    own = {text.partition('=')[0].strip() for text in goal.plan_settings}
    added = tuple(t for t in layout.settings if t.partition('=')[0] not in own)
    width = goal.bead_width
    if layout.width != 1.0:
        width = round(layout.width * (width or get(goal.material).bead_width), 6)
    settings = (*goal.plan_settings, *added)
    return replace(job, goal=replace(goal, bead_width=width, plan_settings=settings))


def on_cells(job: LabJob, cells: int) -> list[LabJob]:
    """The job on so many cells for choosing. Each has physics of its own, unless the job says which it wants."""
    if cells < 1:
        raise ValueError(f'--choose {cells}: needs at least one cell')
    seeds = range(FIRST_CELL, FIRST_CELL + cells)
    if job.plant is not None or 'cell' in job.overrides:
        return [replace(job, seed=seed) for seed in seeds]
    usual = plant_params(params.make(preset=job.preset).cell)
    plants = {s: random_plant(np.random.default_rng(s), usual) for s in seeds}
    return [replace(job, seed=s, plant=plant) for s, plant in plants.items()]


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
    def in_tolerance(self) -> int:
        return sum(r.in_tolerance for r in self.results)


HEAD = ('layout', 'RMS, mm', 'within tolerance', 'jobs in tolerance', 'machine time, s', '')


def row(trial: Trial, taken: Trial | None) -> list[str]:
    """The figures of a trial as text, under HEAD; what is said of it last: taken, or why a job failed."""
    failed = next((r.message for r in trial.results if r.failed), '')
    if failed:
        return [trial.layout.name, '–', '–', '–', '–', failed]
    return [
        trial.layout.name,
        f'{trial.mean("rms") * 1e3:.3f}',
        f'{trial.mean("share_in_tolerance") * 100:.1f} %',
        f'{trial.in_tolerance} of {len(trial.results)}',
        f'{trial.mean("time"):.0f}',
        'taken' if trial is taken else '',
    ]


def best(trials: Sequence[Trial]) -> Trial:
    """The trial to take. The first one is the layout that was asked for.

    It stays unless another one has less RMS by MIN_GAIN within MAX_TIME. ValueError when no layout could be laid.
    """
    able = [t for t in trials if math.isfinite(t.mean('rms'))]
    if not able:
        said = next((r.message for t in trials for r in t.results if r.failed), 'no trial')
        raise ValueError(f'no layout could be laid: {said}')
    first = trials[0]
    if first not in able:
        return min(able, key=lambda t: t.mean('rms'))
    most = MAX_TIME * first.mean('time')
    least = min((t for t in able if t.mean('time') <= most), key=lambda t: t.mean('rms'))
    return least if least.mean('rms') <= (1 - MIN_GAIN) * first.mean('rms') else first


def options(job: LabJob, layout: Layout) -> list[str]:
    """What `waam job run` and `waam plan` want to hear for that layout."""
    goal = laid(job, layout).goal
    words = ['--bead-width', f'{goal.bead_width * 1e3:g}'] if goal.bead_width else []
    for text in goal.plan_settings:
        words += ['--set', text]
    return words
