"""How much of the last layer nobody could have foreseen: jobs that are one and the same up to it, and then meet other
random numbers.
"""

from __future__ import annotations

import math

import numpy as np

from waam_job.model.records import State
from waam_lab import laboratory
from waam_lab.cell import LabCell
from waam_lab.job import LabJob, LabResult
from waam_process.segment import Kind
from waam_sim.compiled import random_state
from waam_sim.disturbance import AREA_LAYER, WIDTH, lattice


class Forked(LabCell):
    """From the last layer on the random numbers are those of another seed: arc, wire, metal of the layer, noise of the
    scans. What is fixed to a place over all layers stays, and so does all that has happened."""

    layer, seed = 0, 0  # of the fork; seed 0: none
    kept = False  # what the scatter of the last layer has in common with those below stays, too

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self._highest = -math.inf  # m, torch while it laid a layer below the last one

    def enqueue(self, job_id, segments, last):
        """Looks how high the torch goes."""
        below = [s.end[2] for s in segments if s.kind == Kind.DEPOSIT and s.layer < self.layer]
        self._highest = max([self._highest, *below])
        super().enqueue(job_id, segments, last)

    def status(self, status):
        """Forks when the last layer begins."""
        if self.seed and status.state == State.DEPOSITING and status.layer == self.layer:
            self._fork()
        super().status(status)

    def _fork(self) -> None:
        plant, new = self.device.plant, lattice(self.seed)
        plant.arc.rng[:] = random_state(self.seed, 1)
        plant.variation.key[:] = random_state(self.seed, 8)
        plant.scanner._seed = self.seed
        planes = np.arange(new.shape[1])
        if self.kept:  # the scatter at a height is between the two planes beside it
            known = math.floor(self._highest / plant.params.metal.noise_height) + 1
            planes = np.arange(known + 1, known + len(planes) // 2) % len(planes)
        for channel in (AREA_LAYER, WIDTH):
            plant._lattice[channel, planes] = new[channel, planes]
        Forked.seed = 0  # once


def run_forked(job: LabJob, layer: int = 0, seed: int = 0, kept: bool = False) -> LabResult:
    """A job that forks when `layer` begins; seed 0: not at all."""
    Forked.layer, Forked.seed, Forked.kept = layer, seed, kept
    before, laboratory.LabCell = laboratory.LabCell, Forked
    try:
        return laboratory.run(job)
    finally:
        laboratory.LabCell = before


def foreseen(job: LabJob, copies: int, kept: bool) -> tuple[float, float]:
    """m, RMS of the judged cells: of what `copies` jobs with other random numbers in the last layer differ by, and of
    the error of the job itself."""
    plain = run_forked(job)
    found = [run_forked(job, plain.layers, 1000 * job.seed + k + 1, kept) for k in range(copies)]
    assert plain.maps is not None
    errors = np.array([f.maps.error[plain.maps.interior] for f in found if f.maps is not None])
    return float(np.sqrt(np.nanmean(np.nanvar(errors, axis=0, ddof=1)))), plain.rms
