"""Jobs that are cut off at random moments and resumed, as trials of lib/campaign_graph.py. Trial k is the same in every
campaign: how it is cut, the node, and the moment (a share of the undisturbed job)."""

from __future__ import annotations

import json
import os
import random
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from .campaign_graph import DONE, Graph, Job, until

JOB_S = 300.0  # longest wait for a job
WAYS = ('everything', 'one node', 'torn checkpoint')
ACTIVE = range(2, 9)  # JobStatus states in which a job may be cut off


def undisturbed(graph: Graph, rng: random.Random) -> dict:
    """A whole job, for its RMS and its length: s on the wall from the first move to the end."""
    job = Job(graph)
    begun = _begun(job)
    if not job.wait(JOB_S) or job.told()[0] != DONE:
        raise RuntimeError(f'the undisturbed job failed: {job.told()[1] or job.error}')
    return {'rms_mm': job.rms_mm(), 'length_s': time.monotonic() - begun}


def cut(number: int, length_s: float) -> Callable[[Graph, random.Random], dict]:
    """A job, the cut, the resume, and what lies on the table in the end."""
    how = WAYS[number % 3]

    def trial(graph: Graph, rng: random.Random) -> dict:
        share, job = rng.random(), None
        for _ in range(4):  # a job that is over before its cut is none
            job = Job(graph)
            time.sleep(max(0.0, _begun(job) + share * length_s - time.monotonic()))
            if job.runs():
                break
            share *= 0.8
        at = job.status
        victims = graph.pids()
        if how == 'one node':
            victims = dict([list(victims.items())[number // 3 % len(victims)]])
        for pid in victims.values():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        job.wait(JOB_S)
        graph.down()
        folder = Path((graph.run / 'job').read_text())
        if how == 'torn checkpoint':
            _tear(folder, rng, both=number // 3 % 3 == 2)
        facts = {
            'how': how,
            'share': share,
            'killed': ', '.join(victims) if len(victims) == 1 else 'all',
        }
        facts |= {'state': int(at.state), 'layer': at.layer, 'bead': at.bead}
        return facts | _resumed(graph, folder)

    return trial


def _begun(job: Job) -> float:
    """Steady time at which the machine was taken into use."""
    if not until(lambda: (job.status and job.status.state in ACTIVE) or not job.runs(), 60.0):
        raise RuntimeError('the job does not begin')
    return time.monotonic()


def _resumed(graph: Graph, folder: Path) -> dict:
    """What the job came to; RuntimeError when it cannot be finished."""
    from waam_node import job_folder

    state = json.loads((folder / job_folder.STATUS).read_text())['state']
    if state != DONE:
        job = Job(graph, resume=folder)
        if not job.wait(JOB_S) or job.result is None or job.result.error_code:
            raise RuntimeError(f'not resumed: {job.error or job.told()[1]}')
    run = json.loads((folder / job_folder.REPORT).read_text())['closed_loop']
    layers = [r['layer'] for r in run['layers'] if not r['final']]
    if layers != sorted(set(layers)):
        raise RuntimeError(f'layers of the report: {layers}')
    facts = {'resumed': state != DONE, 'rms_mm': run['rms_mm'], 'right': True}
    return facts | _beads(folder)


def _tear(folder: Path, rng: random.Random, both: bool) -> None:
    """The newest checkpoint is cut short, and when `both` the generation before as well."""
    from waam_node import job_folder

    for name in (job_folder.CHECKPOINT, job_folder.CHECKPOINT_BEFORE)[: 1 + both]:
        file = folder / name
        if file.exists():
            whole = file.read_bytes()
            file.write_bytes(whole[: rng.randrange(len(whole))])


def _beads(folder: Path) -> dict:
    """How the metal found along each bead compares with what was asked for there: beads missing (less than half of
    it), doubled (more than 1.6 times), and all."""
    from waam_job.model.resume import metal_shares
    from waam_node import job_folder
    from waam_plan.gcode.store import load_plan
    from waam_process.grid import HeightGrid

    plan, means = load_plan(folder / job_folder.plan()), []
    for layer in plan.layers:
        numbers = (layer.number - 1, layer.number)
        maps = [dict(np.load(folder / job_folder.map_after(n))) for n in numbers]
        before, after = (HeightGrid(plan.spec, m['z'].astype(float)) for m in maps)
        asked = replace(layer, planned=maps[0]['asked'].astype(float))
        shares = metal_shares(asked, before, after)
        beads = np.array([s.bead for s in layer.deposits])
        lengths = np.array([s.length for s in layer.deposits])
        for bead in np.unique(beads):
            mine = (beads == bead) & np.isfinite(shares)
            means.append(np.average(shares[mine], weights=lengths[mine]) if mine.any() else 0.0)
    found = np.array(means)
    missing, doubled = int((found < 0.5).sum()), int((found > 1.6).sum())
    return {'beads': len(found), 'missing': missing, 'doubled': doubled}
