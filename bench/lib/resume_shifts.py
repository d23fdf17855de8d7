"""Jobs of the laboratory that are cut off and go on while their part lies elsewhere: which of them are refused?

A job is cut off once; its folder and the true surface are kept. A trial lays the surface on a fresh cell, shifted,
turned or otherwise changed, and lets the job go on up to its first arc.
"""

from __future__ import annotations

import copy
import math
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.ndimage import map_coordinates

from waam_job.model.goal import check
from waam_job.model.records import State
from waam_job.ros.job_params import settings_of
from waam_job.run.control import Control
from waam_job.run.runner import JobRunner
from waam_job.store.folder import JobFolder
from waam_lab import build, params, parts, restore
from waam_lab.cell import LabCell
from waam_lab.job import LabJob
from waam_lab.laboratory import on_table, physics_of
from waam_node import job_folder
from waam_node.stl import write_worn_block
from waam_process.grid import HeightGrid
from waam_sim.plant import Plant

from .preset import preset

OVER = 0.5e-3  # m, of a shift that must be refused
LARGEST = 5e-3  # m
JOBS = 25  # that are cut off; each goes on in eight trials, half of them with the part in its place


class PowerCut(BaseException):
    """Nothing in the job may catch this, as nothing can catch a power cut."""


@dataclass(frozen=True)
class Pose:
    """Where the part lies on the table, seen from where it lay: m, and rad about its middle."""

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True)
class CutJob:
    """A job of the laboratory as the power cut left it; surface: the true one."""

    job: LabJob
    folder: Path
    surface: HeightGrid
    name: str

    def go_on(
        self, pose: Pose, scratch: Path, noise: float, seed: int
    ) -> tuple[int, str, list[str]]:
        """Goes on with a copy of the folder, on a part that lies at `pose`. noise: times that of the scanner. Code of
        the job (0 = it went on up to the arc), its message, and what it noted."""
        target = scratch / self.folder.name
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(self.folder, target)
        settings, checked, cell = _cell(self.job, noise, seed)
        try:
            cell.device.plant.metal.z[:] = moved(self.surface, pose)
            cell.enqueue = _until_the_arc(cell.enqueue)
            folder = JobFolder.open(target)
            number = folder.next_run()
            folder.write_yaml(job_folder.resume(number), {})
            runner = JobRunner(cell, checked, folder, Control(), settings, number)
            runner._release = lambda: None
            try:
                status = runner.run()
                code, text = int(status.error_code), status.message
            except PowerCut:
                code, text = 0, ''
            return code, text, [a.text for a in cell.anomalies]
        finally:
            cell.close()
            shutil.rmtree(target, ignore_errors=True)


def _until_the_arc(inner: Callable[..., None]) -> Callable[..., None]:
    def enqueue(job_id: str, segments: list, last: bool) -> None:
        if any(s.arc for s in segments):
            raise PowerCut
        inner(job_id, segments, last)

    return enqueue


def _cell(job: Any, noise: float, seed: int) -> tuple[Any, Any, Any]:
    """Settings, the checked goal and a cell with the part as it was before the job."""
    known = params.make(job.overrides, preset=job.preset)
    checked = check(job.goal)
    physics = physics_of(job, known)
    table = on_table(job, checked, known, physics).heights
    scanner = replace(physics.scanner, noise=noise * physics.scanner.noise)
    plant = Plant(table, replace(physics, scanner=scanner), seed)
    settings = replace(settings_of(known.job_sequencer, True), keep_learned=False)
    return settings, checked, LabCell(known, plant)


def cut_off(job: Any, layer: int, share: float, scratch: Path, name: str) -> CutJob:
    """Runs `job` until `share` of the arc time of layer `layer` has passed; then the power fails."""
    settings, checked, cell = _cell(job, 1.0, job.seed)
    folder = JobFolder.create(scratch, name)
    runner = JobRunner(cell, checked, folder, Control(), settings)
    runner._release = lambda: None
    spent, inner = [0.0], cell.wait

    def wait(seconds: float) -> None:
        before = cell.now()
        inner(seconds)
        status = runner.status
        if status.state == State.DEPOSITING and status.layer == layer and cell.machine().arc_on:
            spent[0] += cell.now() - before
            if spent[0] >= share * runner.context.program.layer(layer).arc_time:
                raise PowerCut

    cell.wait = wait
    try:
        runner.run()
    except PowerCut:
        surface = copy.deepcopy(cell.device.plant.metal.grid())
    else:
        raise RuntimeError(f'{name} was not cut off: {runner.status.message}')
    finally:
        cell.close()
    return CutJob(job, folder.path, surface, name)


def moved(grid: Any, pose: Pose) -> np.ndarray:
    """(rows, cols) m: all that stands on the table is shifted and turned about the middle of the metal."""
    spec = grid.spec
    x, y = np.meshgrid(spec.x, spec.y)
    metal = grid.z > 1e-4
    middle = np.array([x[metal].mean(), y[metal].mean()])
    c, s = math.cos(pose.turn), math.sin(pose.turn)
    u, v = x - pose.x - middle[0], y - pose.y - middle[1]
    from_x, from_y = c * u + s * v + middle[0], -s * u + c * v + middle[1]
    at = [(from_y - spec.y[0]) / spec.resolution, (from_x - spec.x[0]) / spec.resolution]
    return map_coordinates(grid.z, at, order=1, mode='constant', cval=0.0)


def bases(scratch: Path) -> Iterator[CutJob]:
    """Blocks with a worn trough, plates, walls and discs, cut off at random places of their first three layers."""
    scratch.mkdir(parents=True, exist_ok=True)
    x, y = np.linspace(0, 40, 21), np.linspace(0, 30, 16)
    gx, gy = np.meshgrid(x, y)
    dip = 3.5 * np.clip(1.4 - np.hypot((gx - 20) / 14, (gy - 15) / 10), 0, 0.9) / 0.9
    block = write_worn_block(scratch, x, y, 10.0, dip)
    built = [scratch / 'wall.stl', scratch / 'plate.stl', parts.write(scratch, 'cylinder')[0]]
    trimesh.creation.box((45, 6, 8)).export(built[0])
    trimesh.creation.box((36, 30, 6)).export(built[1])
    rng = np.random.default_rng(41)
    for k in range(JOBS):
        share = float(rng.uniform(0.05, 0.95))
        worn = k % 4 == 3
        layer = int(rng.integers(1, 3 if worn else 4))
        if worn:
            job = restore(*block, seed=k, preset=preset())
        else:
            job = build(built[k % 4], seed=k, layers=3, preset=preset())
        yield cut_off(job, layer, share, scratch / 'jobs', f'{job.goal.part.stem}_{k}_{layer}')


def trial(base: CutJob, number: int, scratch: Path) -> dict[str, Any]:
    """What came of trial `number`: in its place for even numbers, else shifted by up to LARGEST; every other one is
    seen with three times the scatter."""
    rng, noise = np.random.default_rng(1000 + number), 1.0 if number % 4 < 2 else 3.0
    size, angle = rng.uniform(0.0, LARGEST), rng.uniform(0.0, 2 * math.pi)
    turn = math.radians(rng.uniform(-2, 2)) if number % 8 == 7 else 0.0
    pose = Pose()
    if number % 2:
        pose = Pose(size * math.cos(angle), size * math.sin(angle), turn)
    code, text, notes = base.go_on(pose, scratch / 'trial', noise, seed=500 + number)
    told = [float(v) for t in notes for v in re.findall(r'from x: \+- ([0-9.]+) mm', t)]
    shift = 1e3 * math.hypot(pose.x, pose.y)
    return {
        'base': base.name, 'shift_mm': shift, 'noise': noise, 'code': code, 'text': text,
        'told_mm': max(told, default=0.0),
    }  # fmt: skip


def run_shifts(scratch: Path, trials: int) -> list[dict[str, Any]]:
    """Eight trials of every job that was cut off."""
    found: list[dict[str, Any]] = []
    for base in bases(scratch):
        for _ in range(8):
            if len(found) < trials:
                found.append(trial(base, len(found), scratch))
    return found
