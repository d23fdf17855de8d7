"""One job from beginning to end in this process: the simulated cell, the controller, and the job's own logic."""

from __future__ import annotations

import gc
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from waam_job.model.goal import Checked, check
from waam_job.model.records import State
from waam_job.ros.job_params import settings_of
from waam_job.run.runner import JobRunner
from waam_job.store.folder import JobFolder
from waam_job.store.program import keep_program
from waam_node import job_folder
from waam_plan.mesh.placed import Table
from waam_process.grid import HeightGrid
from waam_process.operating import CHUCK_STEPS, MACHINES, build_plate
from waam_process.unrolled import LONGEST_AXIS
from waam_process.verdicts import FAILED
from waam_sim import part as parts
from waam_sim.config import GROUPS, plant_params
from waam_sim.faults import Faults
from waam_sim.plant import Plant, PlantParams
from waam_sim.shaft_plant import Chuck, ShaftPlant

from . import params, results
from .cell import LabCell
from .job import LabJob, LabResult
from .operator import Operator
from .watch import LayerWatch

MEMORY = Path('/dev/shm')  # job folders that are not kept need no disk


def run(job: LabJob, watch: LayerWatch | None = None) -> LabResult:
    """Runs a job. JobError: the goal is refused; ValueError: a parameter, fault or part is; both say what is wrong.

    watch: notes what the correction was asked and what grew, for `waam_lab.training_data`.
    A job that fails on the way (a fault of the cell, a map that cannot be believed) is a result with verdict 'failed'.
    """
    known = params.make(job.overrides, preset=job.preset)
    _check_cell(job)
    chuck = job.chuck or known.job_sequencer.chuck_steps_per_turn > 0
    checked = check(replace(job.goal, learned_dir=job.learned), chuck)
    known = _with_chuck(job, checked, known)
    physics = physics_of(job, known)
    plant = _plant(on_table(job, checked, known, physics).heights, checked, physics, job.seed)
    cell = LabCell(known, plant, job.faults, watch, job.machine)
    try:
        with _folder(job, checked, known) as folder, _few_objects():
            began, cpu = cell.now(), time.process_time()
            settings = settings_of(known.job_sequencer, True)
            settings = replace(settings, keep_learned=job.keep_learned)
            runner = JobRunner(cell, checked, folder, Operator(cell.device), settings)
            runner.run()
            spent = time.process_time() - cpu
            first = runner.context.program.whole
            found = results.read(folder, job, first, cell.now() - began, spent)
            seen = cell.contact
            return replace(
                found,
                contact_rms=seen.rms,
                contact_worst=seen.worst,
                contact_least=seen.least,
                arcs_lost=seen.lost,
                process_variance=cell.process.variance(),
                bead_widths=cell.process.widths,
                scan_time=cell.spent.get(State.SCANNING, 0.0),
            )
    finally:
        cell.close()


def _with_chuck(job: LabJob, checked: Checked, known: params.LabParams) -> params.LabParams:
    """With a chuck in place of the X axis for a shaft: it has no end, the controller's longest axis has."""
    if checked.shaft is None:
        return known
    own = {
        'bridge': {'envelope_x': LONGEST_AXIS},
        'job_sequencer': {'chuck_steps_per_turn': CHUCK_STEPS},
    }
    return params.make(own, job.overrides, preset=job.preset)


def _plant(lies: HeightGrid, checked: Checked, physics: PlantParams, seed: int) -> Plant:
    """The cell with a part on its table, or with a shaft in its chuck."""
    shaft = checked.shaft
    if shaft is None:
        return Plant(lies, physics, seed)
    chuck = Chuck.around(lies.spec, shaft.diameter, shaft.level, physics.heat.cell)
    return ShaftPlant(lies, chuck, physics, seed)


def _check_cell(job: LabJob) -> None:
    """Raises ValueError for faults that would otherwise show only in the middle of a job, or never."""
    if job.machine not in MACHINES:
        raise ValueError(f"machine is '{job.machine}', known are {', '.join(MACHINES)}")
    if job.seed < 0:
        raise ValueError(f'seed is {job.seed}, must not be negative')
    bridge = params.BRIDGES[job.machine]
    if other := [n for n in params.BRIDGES.values() if n != bridge and n in job.overrides]:
        text = f"overrides of '{other[0]}' do not act: on machine '{job.machine}' the node is '{bridge}'"
        raise ValueError(text)
    own = [f'{group}_' for group in GROUPS]
    changed = [n for n in job.overrides.get('cell', {}) if n.startswith(tuple(own))]
    if job.plant is not None and changed:
        text = f"plant replaces the physics, so the override 'cell.{changed[0]}' would not act"
        raise ValueError(text)
    for fault in job.faults:
        Faults().inject(fault.name, fault.value, 0.0)


def physics_of(job: LabJob, known: params.LabParams) -> PlantParams:
    """The physics of the job itself when it has some, else those of the parameters of `cell`."""
    return job.plant or plant_params(known.cell)


def on_table(job: LabJob, checked: Checked, known: params.LabParams, physics: PlantParams) -> Table:
    """What lies in the cell; for a build a plate that is large enough. ValueError when it cannot be read, is too large
    or does not lie on the nominal part."""
    metal = physics.metal
    if job.as_found is not None:
        lies = checked.on_table(job.as_found, metal.cell, metal.margin)
        return replace(lies, heights=parts.placed(lies.heights, metal.cell))
    if job.goal.mode == 'restore':
        raise ValueError("as_found (--as-found): a restoration needs the mesh of the worn part")
    wanted = build_plate(checked.bounds[1], known.job_sequencer.plate_zero)
    return Table(parts.plate(*wanted, metal.cell, metal.margin))


@contextmanager
def _few_objects() -> Iterator[None]:
    """The collector of garbage looks at what the job makes, not at all that the process has."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def _folder(job: LabJob, checked: Checked, known: params.LabParams) -> Iterator[JobFolder]:
    """The job's folder with its job.yaml; gone afterwards unless it is to be kept."""
    if job.keep:
        yield _begin(job.goal.jobs_dir.resolve(), job, checked, known)
        return
    memory = MEMORY if os.access(MEMORY, os.W_OK) else None
    scratch = Path(tempfile.mkdtemp(prefix='waam_lab_', dir=memory))
    try:
        yield replace(_begin(scratch, job, checked, known), passing=True)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _begin(jobs: Path, job: LabJob, checked: Checked, known: params.LabParams) -> JobFolder:
    folder = JobFolder.create(jobs, job.goal.name or f'{job.goal.title}_seed_{job.seed}')
    nodes = known.by_node(job.machine)
    asked = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(job.goal).items()}
    facts = {'job_id': folder.job_id, 'goal': asked, 'material': asdict(checked.material)}
    own = {'parameters': nodes.pop('job_sequencer'), 'nodes': nodes}
    made = {
        'part_sha256': checked.part_sha256,
        'program_sha256': keep_program(job.goal, folder),
        'laboratory': True,
        'seed': job.seed,
        'preset': job.preset if job.plant is None else '',
        'machine': job.machine,
    }
    folder.write_yaml(job_folder.JOB, {**facts, **own, **made})
    return folder


def failed(job: LabJob, error: Exception) -> LabResult:
    """The result of a job that was refused, or that a fault of this software ended."""
    code = int(getattr(error, 'code', 100))
    known = type(error).__module__.startswith('waam') or isinstance(error, ValueError)
    text = str(error) if known else f'{type(error).__name__}: {error}'
    return LabResult(seed=job.seed, verdict=FAILED, error_code=code, message=text)


def over_seeds(job: LabJob, seeds: range | list[int]) -> list[LabJob]:
    """The same job on as many cells."""
    return [replace(job, seed=seed) for seed in seeds]
