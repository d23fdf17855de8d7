"""A campaign of jobs that are cut off at random moments and resumed; one JSON line per trial in a file that grows.

Trial k is the same in every campaign: how it is cut, the node, and the moment (a share of the undisturbed job).
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from .job_part import SEED, goal, write_part
from .preset import preset

DOMAIN = int(os.environ.get('WAAM_BENCH_DOMAIN', 216))
JOB_S, UP_S = 300.0, 120.0  # longest wait for a job and for a graph, s
WAYS = ('everything', 'one node', 'torn checkpoint')
WHOLE = 3  # undisturbed jobs at least: they differ, too
ACTIVE = range(2, 9)  # JobStatus states in which a job may be cut off


class Trouble(RuntimeError):
    """What a trial ended with instead of a finished job."""


class NoGraph(RuntimeError):
    """The graph does not come up."""


class Campaign:
    """A graph that is kept from trial to trial as long as it lives. `file` holds the trials so far."""

    def __init__(self, scratch: Path, file: Path) -> None:
        from waam_job.store.provenance import software_revision

        self.scratch, self.file = scratch, file
        self.part, self.worn = write_part(scratch / 'part')
        self.run = scratch / 'run'
        self.length = 0.0  # s on the wall, from the first move to the end of an undisturbed job
        self._graph = None
        self._without_graph = self.failed_starts = 0
        self.software = software_revision()

    # ---- the file ------------------------------------------------------------------------------

    def lines(self, kind: str) -> list[dict]:
        text = self.file.read_text() if self.file.exists() else ''
        return [d for d in map(json.loads, text.splitlines()) if d['kind'] == kind]

    def _append(self, kind: str, **data) -> dict:
        with open(self.file, 'a') as f:
            f.write(json.dumps({'kind': kind, 'software': self.software, **data}) + '\n')
        return data

    # ---- the graph -----------------------------------------------------------------------------

    def client(self):
        """A client of the graph, which is started when none is up or a process of it died."""
        from waam_bringup import run_state
        from waam_bringup.client import ClientError
        from waam_bringup.graph import Settings
        from waam_bringup.test_support import power_on

        state = run_state.load(self.run)
        if self._graph and state and state.alive and not state.dead_nodes:
            return self._client
        self.down()
        for attempt in (1, 2):  # an operator would try again, too; the line of the trial says so
            graph = power_on(Settings(run=self.run, seed=SEED, preset=preset()), DOMAIN, UP_S)
            try:
                self._client, self.pids = graph.__enter__()
                break
            except ClientError as e:
                self.failed_starts += 1
                if attempt == 2:
                    raise NoGraph(str(e)) from None
        self._graph = graph
        return self._client

    def down(self) -> None:
        if self._graph:
            self._graph.__exit__(None, None, None)
            self._graph = None

    def job(self, request, on_status=lambda _: None):
        """Result of a job; Trouble when the graph is gone or it takes too long."""
        from waam_bringup.client import ClientError
        from waam_bringup.operate import graph_trouble

        client, end = self.client(), time.monotonic() + JOB_S

        def alive() -> str:
            late = time.monotonic() > end
            return graph_trouble(self.run) or (f'not done after {JOB_S:.0f} s' if late else '')

        try:
            return client.run_job(request, on_status, alive)
        except ClientError as e:
            raise Trouble(str(e)) from None

    def load(self) -> None:
        self.client().load_part(str(self.worn), (0.0, 0.0, 0.0), SEED)

    # ---- what is done with it ------------------------------------------------------------------

    def undisturbed(self) -> dict:
        """A whole job, for its RMS and its length."""
        self.load()
        clock = StartClock()
        result = self.job(goal(self.part, self.scratch / 'jobs'), clock)
        if result.error_code:
            raise Trouble(f'the undisturbed job failed: {result.message}')
        self.length = time.monotonic() - clock.start
        folder = Path(result.job_dir)
        return self._append(
            'undisturbed', rms_mm=result.rms * 1e3, wall_s=self.length, **beads_of(folder)
        )

    def trial(self, number: int) -> dict:
        """Cut `number` of the campaign, appended to the file whatever its end is."""
        start, cut, before = time.monotonic(), Cut(self, number), self.failed_starts
        try:
            facts = cut.run()
            self._without_graph = 0
        except Exception as e:
            self._without_graph += isinstance(e, NoGraph)
            if self._without_graph > 1:  # no cut of ours: the software as it is does not start
                raise
            facts = {'error': f'{type(e).__name__}: {e}'}
            self._keep(cut.folder, number)
            self.down()
        shutil.rmtree(self.scratch / 'jobs', ignore_errors=True)
        facts |= {'wall_s': round(time.monotonic() - start, 1)}
        facts |= {'failed_starts': self.failed_starts - before}
        return self._append('cut', number=number, **cut.about, **facts)

    def _keep(self, folder: Path | None, number: int) -> None:
        """The job and the logs of a trial that failed, beside the file."""
        kept = self.file.with_suffix('') / f'cut_{number:03d}'
        for source in (folder, self.run / 'logs', self.run / 'controller.events'):
            if source and source.is_dir():
                shutil.copytree(source, kept / source.name, dirs_exist_ok=True)
            elif source and source.exists():
                shutil.copy(source, kept)


class StartClock:
    """Callback of a job; `start` is the steady time at which the machine was taken into use."""

    def __init__(self, then=lambda: None) -> None:
        self.start, self._then = 0.0, then

    def __call__(self, status) -> None:
        if not self.start and status.state in ACTIVE:
            self.start = time.monotonic()
            self._then()


class Cut:
    """One trial: a job, the cut, the resume, and what lies on the table in the end."""

    def __init__(self, campaign: Campaign, number: int) -> None:
        self.campaign = campaign
        self.rng = random.Random(f'{SEED}:{number}')
        self.how, self.share = WAYS[number % 3], self.rng.random()
        self.about = {'how': self.how, 'share': round(self.share, 3)}
        self.number, self.folder = number, None

    def run(self) -> dict:
        """Raises Trouble when the job cannot be finished."""
        from waam_msgs.action import RunJob
        from waam_node import job_folder

        campaign, end = self.campaign, None
        for _ in range(4):  # a job that is over before its cut is none
            campaign.load()
            end = self._cut_off()
            if self.about.get('state') is not None:
                break
            self.share *= 0.8
        self.folder = Path((campaign.run / 'job').read_text())
        self._tear()
        state = json.loads((self.folder / job_folder.STATUS).read_text())['state']
        self.about |= {'ended': end, 'resumed': state != 'DONE'}
        if state != 'DONE':
            result = campaign.job(RunJob.Goal(resume_dir=str(self.folder)))
            if result.error_code:
                raise Trouble(f'not resumed: {result.message} (error {result.error_code})')
        run = json.loads((self.folder / job_folder.REPORT).read_text())['closed_loop']
        layers = [r['layer'] for r in run['layers'] if not r['final']]
        if layers != sorted(set(layers)):
            raise Trouble(f'layers of the report: {layers}')
        return {'rms_mm': run['rms_mm'], 'runs': run['runs'], **beads_of(self.folder)}

    def _cut_off(self) -> str:
        """Runs the job into the cut. How it ended, in words; graph and job are at rest then."""
        campaign, client = self.campaign, self.campaign.client()
        victims = campaign.pids
        if self.how == 'one node':
            name, pid = self._victim()
            self.about['node'], victims = name, [pid]

        def cut() -> None:
            status = client.job
            if status is not None and status.state in ACTIVE:
                here = {'state': int(status.state), 'layer': status.layer, 'bead': status.bead}
                self.about.update(here)
                for pid in victims:
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)

        timer = threading.Timer(self.share * campaign.length, cut)
        try:
            result = campaign.job(
                goal(campaign.part, campaign.scratch / 'jobs'), StartClock(timer.start)
            )
            return result.message
        except Trouble as e:
            return str(e)
        finally:
            timer.cancel()
            timer.join()

    def _victim(self) -> tuple[str, int]:
        from waam_bringup import run_state

        nodes = run_state.load(self.campaign.run).nodes
        name = list(nodes)[self.number // 3 % len(nodes)]
        return name, nodes[name].pid

    def _tear(self) -> None:
        """The newest checkpoint is cut short; in every third such trial the generation before as well."""
        from waam_node import job_folder

        if self.how != 'torn checkpoint':
            return
        names = [job_folder.CHECKPOINT, job_folder.CHECKPOINT_BEFORE][
            : 1 + (self.number // 3 % 3 == 2)
        ]
        for name in names:
            file = self.folder / name
            if file.exists():
                whole = file.read_bytes()
                file.write_bytes(whole[: self.rng.randrange(len(whole))])


def beads_of(folder: Path) -> dict:
    """How the metal found along each bead compares with what was asked for there: beads missing (less than half of
    it), doubled (more than 1.6 times), all, and the smallest and largest share of a bead."""
    from waam_job.model.resume import metal_shares
    from waam_node import job_folder
    from waam_plan.gcode.store import load_plan
    from waam_process.grid import HeightGrid

    plan, means = load_plan(folder / job_folder.plan()), []
    for layer in plan.layers:
        maps = [
            dict(np.load(folder / job_folder.map_after(n)))
            for n in (layer.number - 1, layer.number)
        ]
        before, after = (HeightGrid(plan.spec, m['z'].astype(float)) for m in maps)
        asked = replace(layer, planned=maps[0]['asked'].astype(float))
        shares = metal_shares(asked, before, after)
        numbers = np.array([s.bead for s in layer.deposits])
        lengths = np.array([s.length for s in layer.deposits])
        for bead in np.unique(numbers):
            mine = (numbers == bead) & np.isfinite(shares)
            means.append(np.average(shares[mine], weights=lengths[mine]) if mine.any() else 0.0)
    found = np.array(means)
    return {
        'beads': len(found),
        'missing': int((found < 0.5).sum()),
        'doubled': int((found > 1.6).sum()),
        'share_min': round(float(found.min()), 3),
        'share_max': round(float(found.max()), 3),
    }


def run_campaign(scratch: Path, file: Path, trials: int) -> Campaign:
    """Trials 0 .. trials - 1 that are not in the file yet, after an undisturbed job per call, WHOLE in the first."""
    campaign = Campaign(scratch, file)
    done = {d['number'] for d in campaign.lines('cut')}
    missing = [n for n in range(trials) if n not in done]
    try:
        for _ in range(max(1, WHOLE - len(campaign.lines('undisturbed'))) if missing else 0):
            campaign.undisturbed()
        for number in missing:
            facts = campaign.trial(number)
            text = ', '.join(f'{k} {v}' for k, v in facts.items())
            print(f'cut {number + 1}/{trials}: {text}', file=sys.stderr, flush=True)
    finally:
        campaign.down()
    return campaign
