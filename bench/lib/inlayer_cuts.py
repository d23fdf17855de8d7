"""Jobs of real processes that are killed again and again while a layer is corrected within, and resumed until they end.

One node is killed with -9 while an arc burns in a layer that was corrected at least once, it is started again, and the
job resumed. Where the cell was killed, and after some deaths, the whole graph is started anew: most of a kill's time is
the start of a graph. One JSON line per kill and per job in a file that grows (kinds `kill` and `job`).
"""

from __future__ import annotations

import json
import os
import random
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

from .inlayer_kills import CHANGED, NODES, long_part
from .job_cuts import beads_of
from .job_part import SEED
from .live_graph import LiveGraph

DOMAIN = int(os.environ.get('WAAM_BENCH_DOMAIN', 217))
VICTIMS = (*NODES, 'bridge', 'cell')
JOB_S, UP_S = 300.0, 150.0  # longest wait for a job and for a graph, s
LATE = 12.0  # s on the wall after a correction, at most, until something is killed
TRIES = 4  # kills of one job; it is left alone then
STARTS = 3  # of a graph until a job can be begun or resumed in it: on a busy machine the first may be too slow
NO_GRAPH = 'no graph'  # how the error of an attempt begins whose job was never asked for


class Campaign:
    """`file` has the lines so far."""

    def __init__(self, scratch: Path, file: Path) -> None:
        import yaml

        self.scratch, self.file, self.run = scratch, file, scratch / 'run'
        self.part, self.worn = long_part(scratch / 'part', 3.6)
        self.params = scratch / 'in_layer.yaml'
        text = yaml.safe_dump({n: {'ros__parameters': p} for n, p in CHANGED.items()})
        self.params.write_text(text)
        self.graph: LiveGraph | None = None
        self.done = len(self.lines('kill'))
        self._jobs = len(self.lines('job'))

    def lines(self, kind: str = '') -> list[dict]:
        text = self.file.read_text() if self.file.exists() else ''
        return [d for d in map(json.loads, text.splitlines()) if kind in ('', d['kind'])]

    def append(self, kind: str, **data) -> None:
        with open(self.file, 'a') as f:
            f.write(json.dumps({'kind': kind, **data}) + '\n')
        print(f'{kind}: {data}', file=sys.stderr, flush=True)

    def job(self) -> None:
        """One job, killed up to TRIES times, from its begin to its end."""
        folder, kills, error = None, 0, ''
        for attempt in range(TRIES + 1):
            for _ in range(STARTS):
                killed, error = self._attempt(folder, last=attempt == TRIES)
                if not error.startswith(NO_GRAPH):
                    break
            found = (self.run / 'job').read_text().strip() if (self.run / 'job').exists() else ''
            folder = Path(found) if found else folder
            kills += killed
            if not killed:
                break
        self._jobs += 1
        if error:  # the job may still run
            self.down()
        self.append('job', kills=kills, error=error, **self._facts(folder, error))

    def _attempt(self, folder: Path | None, last: bool) -> tuple[bool, str]:
        """Begins or resumes the job, kills something, and mends it. (something was killed, error)."""
        from waam_bringup.client import ClientError, GraphClient

        began = time.monotonic()
        try:
            graph = self._up()
            with GraphClient(DOMAIN) as client:
                graph.ready(client)
                at_work = time.monotonic()
                facts, error = self._run(client, folder, last)
        except ClientError as e:
            self.down()
            return False, f'{NO_GRAPH}: {e}'
        if facts:
            self.done += 1
            spent = {'up_s': at_work - began, 'job_s': time.monotonic() - at_work}
            self.append('kill', **facts, **{n: round(v, 1) for n, v in spent.items()})
            self._mend(facts['node'])
        return bool(facts), '' if facts else error

    def _run(self, client, folder: Path | None, last: bool) -> tuple[dict, str]:
        """What was killed ({} = nothing), and how the job ended."""
        from waam_bringup.client import ClientError
        from waam_bringup.operate import graph_trouble
        from waam_msgs.action import RunJob
        from waam_msgs.srv import Command

        client.call(Command, 'bridge/command', Command.Request(code=Command.Request.STOP))
        if folder is None:
            client.load_part(str(self.worn), (0.0, 0.0, 0.0), SEED)
            goal = self._goal()
        else:
            goal = RunJob.Goal(resume_dir=str(folder))
        end = time.monotonic() + JOB_S

        def alive() -> str:
            return graph_trouble(self.run) or ('late' if time.monotonic() > end else '')

        killer = Killer(self, None if last else VICTIMS[self.done % len(VICTIMS)], folder)
        try:
            result = client.run_job(goal, lambda _: None, alive)
            error = result.message if result.error_code else ''
        except ClientError as e:
            error = str(e)
        finally:
            facts = killer.join()
        return facts, error

    def _up(self) -> LiveGraph:
        from waam_bringup.graph import Settings

        if self.graph is None:
            settings = Settings(
                run=self.run, seed=SEED, params_files=(self.params,), without=('dashboard', 'panel')
            )
            self.graph = LiveGraph(settings, DOMAIN, UP_S)
            self.graph.start()
        return self.graph

    def _mend(self, node: str) -> None:
        """What died is there again. The part on the table of a dead cell comes with a new graph; a recorder whose job
        lost its sequencer still records it."""
        if node in ('cell', 'job_sequencer') or self.graph.worn_out:
            self.down()
        else:
            self.graph.revive(node)

    def down(self) -> None:
        """Ends the graph, if there is one."""
        if self.graph is not None:
            self.graph.stop()
            self.graph = None

    def _goal(self):
        from waam_bringup.jobs import make_goal

        values = {
            'name': 'kills', 'part': self.part, 'mode': 'restore', 'material': 'er70s-6',
            'loop_mode': 'closed_loop', 'layers': 0, 'layer_height': 0.0, 'bead_width': 0.0, 'k_gain': float('nan'),
            'tolerance': 0.2, 'scale': 1e-3, 'note': [], 'strategy': 'zigzag', 'allowance': 0.0, 'passes': 1,
            'wire_left': 0.0, 'operator': 'bench', 'fresh': True,
        }  # fmt: skip
        return make_goal(SimpleNamespace(**values), self.scratch / 'jobs')

    def _facts(self, folder: Path | None, error: str) -> dict:
        """RMS, beads, and the corrections that runs after the first one made in the rest of a layer."""
        from waam_node import job_folder

        if folder is None or error:
            return {'rms_mm': None, 'resumed_corrections': 0, 'corrections': 0}
        run = json.loads((folder / job_folder.REPORT).read_text())['closed_loop']
        file = folder / job_folder.IN_LAYER
        rows = [json.loads(x) for x in file.read_text().splitlines()] if file.exists() else []
        first = {}  # layer -> run in which it was first corrected
        for row in rows:
            first.setdefault(row['layer'], row['run'])
        again = sum(row['run'] > first[row['layer']] for row in rows)
        found = beads_of(folder)
        wrong = {'beads': found['beads'], 'wrong': found['missing'] + found['doubled']}
        return {
            'rms_mm': run['rms_mm'], 'corrections': len(rows), 'resumed_corrections': again, **wrong,
        }  # fmt: skip


class Killer:
    """Kills one node in a thread of its own, at a random moment after a correction, while the arc burns."""

    def __init__(self, campaign: Campaign, victim: str | None, folder: Path | None) -> None:
        """folder: of the job that is resumed; None = a new one, whose folder is not that of the job before."""
        self.campaign, self.victim = campaign, victim
        self._old = None if folder else self._folder()
        self.rng = random.Random(f'{SEED}:{campaign.done}')
        self.facts: dict = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._go, daemon=True)
        self._thread.start()

    def join(self) -> dict:
        self._stop.set()
        self._thread.join(30.0)
        return self.facts

    def _rows(self) -> int:
        """Corrections in force in this job so far."""
        from waam_node import job_folder

        folder = self._folder()
        if folder == self._old:  # the job that is asked for has not begun
            return 0
        with suppress(OSError):
            return len((Path(folder) / job_folder.IN_LAYER).read_text().splitlines())
        return 0

    def _folder(self) -> str:
        """Of the newest job, '' = none."""
        with suppress(OSError):
            return (self.campaign.run / 'job').read_text().strip()
        return ''

    def _events(self) -> list[tuple[int, str]]:
        file = self.campaign.run / 'controller.events'
        rows = file.read_text().splitlines() if file.exists() else []
        return [(int(r.split(' ', 1)[0]), r.split(' ', 1)[1]) for r in rows if ' ' in r]

    def _burns(self) -> int:
        """us of the strike of the arc that burns now; 0 = none does."""
        arcs = [(t, e) for t, e in self._events() if e.startswith('arc o')]
        return arcs[-1][0] if arcs and arcs[-1][1].startswith('arc on') else 0

    def _go(self) -> None:
        if self.victim is None:
            return
        before, close = self._rows(), self.campaign.done % 2 == 0
        if not self._until(lambda: self._rows() > before):
            return
        due = time.monotonic() + self.rng.uniform(0, 0.2 if close else LATE)
        if not self._until(lambda: time.monotonic() >= due and self._burns()):
            return
        on, rows = self._burns(), self._rows()
        self.campaign.graph.kill(self.victim)
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            if found := self._off(on):
                self.facts = {'node': self.victim, 'off_ms': found, 'corrections': rows}
                return
            time.sleep(0.02)
        self.facts = {'node': self.victim, 'off_ms': 20000.0, 'corrections': rows}

    def _off(self, on: int) -> float:
        """ms from the tick up to which the lease had been renewed to the arc being off; no heartbeat that the dead node
        sent is younger than its death, so this bounds the time since then. 0 = the arc still burns."""
        events = self._events()
        for (t, event), (_, then) in zip(events, events[1:], strict=False):
            if t > on and event == 'arc off' and then.startswith('lease '):
                return (t - int(then.split()[1])) * 1e-3
        return 0.0

    def _until(self, condition) -> bool:
        while not condition():
            if self._stop.wait(0.02):
                return False
        return True


def run_campaign(scratch: Path, file: Path, kills: int) -> list[dict]:
    """Jobs until there are that many kills in the file. All lines of it."""
    scratch.mkdir(parents=True, exist_ok=True)
    campaign = Campaign(scratch, file)
    try:
        while campaign.done < kills:
            before = campaign.done
            campaign.job()
            if campaign.done == before:
                raise RuntimeError('a job ran to its end and nothing could be killed in it')
    finally:
        campaign.down()
    return campaign.lines()
