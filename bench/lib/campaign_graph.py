"""Disturbances of a whole running graph, one after the other: kills, suspensions, strangers on the bus, clocks that
jump, many participants. One JSON line per trial in a file that grows.

A trial is a job on a small part that something happens to at a random moment. It is `right` when the arc was off within
the lease (500 ms of controller time) where the lease ended, when the job ended by itself, and when it either ended as
if nothing had happened or named what had happened.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from .live_graph import LiveGraph
from .node import memory_mb
from .preset import preset

LEASE_MS = 500.0
RATE = 6.0  # simulated seconds per second: slow enough to hit the middle of a bead
UP_S, JOB_S = 150.0, 120.0  # longest wait for a graph, and for a job to end after a disturbance
VIEWERS = ('dashboard', 'panel', 'process_control')  # whose death stops no job
WORDS = {
    'cell': ('ALARM', 'cell', 'telemetry', 'scanner', 'process inputs'),
    'bridge': ('telemetry', 'bridge'),
}
DONE, FAILED = 'DONE', ('FAILED', 'INTERRUPTED', 'ABORTED')

SEED = 7
LENGTH, WIDTH, HEIGHT, DEPTH = 36.0, 30.0, 12.0, 4.0  # mm, of the part


def write_part(folder: Path) -> tuple[Path, Path]:
    """Nominal and worn mesh."""
    from waam_node.stl import write_worn_block

    x, y = np.linspace(0, LENGTH, 37), np.linspace(0, WIDTH, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(np.abs(gx - LENGTH / 2) / 15, np.abs(gy - WIDTH / 2) / 12)
    return write_worn_block(folder, x, y, HEIGHT, DEPTH * np.clip(1.5 - 1.5 * away, 0, 1))


def goal(part: Path, jobs: Path, **fields):
    """Of the action; k_gain as the correction server wants it."""
    from waam_msgs.action import RunJob

    values = {'name': 'bench', 'mode': 'restore', 'k_gain': float('nan'), 'fresh': True, **fields}
    return RunJob.Goal(part=str(part), jobs_dir=str(jobs), **values)


class Graph:
    """A graph that is kept from trial to trial as long as it lives. options: of waam_bringup.graph.Settings."""

    def __init__(self, scratch: Path, **options: Any) -> None:
        self.scratch, self.run = scratch, scratch / 'run'
        self.options = {'rate': RATE, 'preset': preset(), **options}
        self.part, self.worn = write_part(scratch / 'part')
        self._live: LiveGraph | None = None

    def live(self) -> LiveGraph:
        """The graph, started when none is up."""
        if self._live is None or self._live.worn_out:
            self.down()
            from waam_bringup.client import GraphClient
            from waam_bringup.graph import Settings
            from waam_node.testing import fresh_domain

            settings = Settings(run=self.run, seed=SEED, **self.options)
            self._live = LiveGraph(settings, fresh_domain(), UP_S)
            self._live.start()
            with GraphClient(self._live.domain) as client:
                self._live.ready(client)
        return self._live

    def down(self) -> None:
        """Ends it."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def pids(self) -> dict[str, int]:
        """Of all processes, by name."""
        from waam_bringup import run_state

        state = run_state.load(self.run)
        return {n: s.pid for n, s in state.nodes.items()} if state else {}

    def dead(self) -> list[str]:
        """Processes that have ended."""
        from waam_bringup import run_state

        state = run_state.load(self.run)
        return sorted(state.dead_nodes) if state else []

    def events(self) -> list[tuple[int, str]]:
        """What the controller wrote down by itself: (controller us, event)."""
        file = self.run / 'controller.events'
        rows = file.read_text().splitlines() if file.exists() else []
        return [(int(r.split(' ', 1)[0]), r.split(' ', 1)[1]) for r in rows if ' ' in r]

    def burns(self) -> int:
        """us of the strike of the arc that burns now; 0 = none does."""
        arcs = [(t, e) for t, e in self.events() if e.startswith('arc o')]
        return arcs[-1][0] if arcs and arcs[-1][1].startswith('arc on') else 0

    def off_ms(self, since: int) -> float:
        """ms of controller time from the tick up to which the lease had been renewed to the arc being off, for the
        first arc that ended after `since` (us); NaN = it still burns, or it ended without its lease."""
        events = self.events()
        for (t, event), (_, then) in zip(events, events[1:], strict=False):
            if t > since and event == 'arc off' and then.startswith('lease '):
                return (t - int(then.split()[1])) * 1e-3
        return float('nan')


class Job:
    """A job in a thread of its own, of the part of the graph or, with `resume`, of a folder that was left behind."""

    def __init__(self, graph: Graph, resume: Path | None = None, **fields) -> None:
        self.graph, self.resume, self.fields = graph, resume, fields
        self.result: Any = None
        self.error = ''
        self.status: Any = None
        self._thread = threading.Thread(target=self._go, daemon=True)
        self._thread.start()

    def _go(self) -> None:
        from waam_bringup.client import ClientError, GraphClient
        from waam_bringup.operate import graph_watch
        from waam_msgs.action import RunJob

        graph = self.graph
        try:
            with GraphClient(graph.live().domain) as client:
                if self.resume:
                    asked = RunJob.Goal(resume_dir=str(self.resume))
                else:
                    client.load_part(str(graph.worn), (0.0, 0.0, 0.0), SEED)
                    asked = goal(graph.part, graph.scratch / 'jobs', **self.fields)
                self.result = client.run_job(asked, self._on_status, graph_watch(graph.run))
        except ClientError as e:
            self.error = str(e)

    def _on_status(self, status: Any) -> None:
        self.status = status

    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def wait(self, seconds: float) -> bool:
        """Until it ends, at most so long. Whether it has ended."""
        self._thread.join(seconds)
        return not self.runs()

    def told(self) -> tuple[str, str]:
        """State and message in status.json of the newest job."""
        from waam_bringup import run_state

        found = run_state.job_status(self.graph.run)
        return (found[1].get('state', ''), found[1].get('message', '')) if found else ('', '')

    def rms_mm(self) -> float | None:
        """Of the result, when there is one."""
        rms = getattr(self.result, 'rms', None)
        return None if rms is None or rms != rms else round(rms * 1e3, 4)


def until(condition: Callable[[], Any], seconds: float) -> bool:
    """Whether it became true within that time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


class Trials:
    """`file` has the lines so far; what is in it is not done again. A trial that breaks down keeps its error there."""

    def __init__(self, scratch: Path, file: Path) -> None:
        self.file, self.graph = file, Graph(scratch)

    def lines(self, *beginnings: str) -> list[dict]:
        """Those whose `what` begins so."""
        text = self.file.read_text() if self.file.exists() else ''
        return [d for d in map(json.loads, text.splitlines()) if d['what'].startswith(beginnings)]

    def run(self, what: str, number: int, trial: Callable[[Graph, random.Random], dict]) -> dict:
        """One trial, whose line is appended whatever its end is."""
        for line in self.lines(what):
            if line['what'] == what and line['number'] == number:
                return line
        begun = time.monotonic()
        try:
            facts = trial(self.graph, random.Random(f'{what}:{number}'))
        except Exception as e:
            facts = {'right': False, 'error': f'{type(e).__name__}: {e}'}
            self.graph.down()
        took = round(time.monotonic() - begun, 1)
        line = {'what': what, 'number': number, **facts, 'wall_s': took}
        with open(self.file, 'a') as f:
            f.write(json.dumps(line) + '\n')
        print(line, file=sys.stderr, flush=True)
        return line


@contextmanager
def trials() -> Iterator[Trials]:
    """In a folder of their own, kept in the file of WAAM_BENCH_CAMPAIGN if there is one."""
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as folder:
        file = os.environ.get('WAAM_BENCH_CAMPAIGN', str(Path(folder) / 'campaign.jsonl'))
        made = Trials(Path(folder), Path(file).resolve())
        try:
            yield made
        finally:
            made.graph.down()


def stroke(node: str, way: str) -> Callable[[Graph, random.Random], dict]:
    """A trial in which `node` is killed (way 'kill'), or stopped for good ('suspend')."""

    def trial(graph: Graph, rng: random.Random) -> dict:
        live, job = graph.live(), Job(graph)
        if rng.random() < 0.75:
            for wait in (0.0, rng.uniform(0.0, 2.5)):  # into an arc, and then somewhere into one
                time.sleep(wait)
                if not until(lambda: graph.burns() or not job.runs(), 60.0):
                    raise RuntimeError('no arc')
            time.sleep(rng.uniform(0.0, 0.4))
        else:
            time.sleep(rng.uniform(0.0, 5.0))
        on, at = graph.burns(), getattr(job.status, 'state', -1)
        pid = graph.pids()[node]
        live.kill(node) if way == 'kill' else os.kill(pid, signal.SIGSTOP)
        facts = _after(graph, job, node, way, on)
        if way == 'suspend' and graph.pids()[node] == pid:
            live.kill(node)
            job.wait(JOB_S)
        _recover(graph, node, pid)
        return {'node': node, 'in_arc': bool(on), 'state': at, **facts}

    return trial


def _after(graph: Graph, job: Job, node: str, way: str, on: int) -> dict:
    """What came of it: arc, job, words."""
    viewer = node in VIEWERS
    silent = way == 'suspend' and node == 'job_sequencer'  # nobody can end its job
    off = float('nan')
    if on and not viewer:
        until(lambda: graph.off_ms(on) == graph.off_ms(on) or not graph.burns(), 25.0)
        off = graph.off_ms(on)
        out = not graph.burns()
    else:
        out = True
    ended = True if silent else job.wait(JOB_S)
    until(lambda: job.told()[0] in (DONE, *FAILED) or silent, 5.0)
    state, message = job.told()
    words = WORDS.get(node, (node,))
    named = state == DONE or silent or any(w in f'{message} {job.error}' for w in words)
    in_time = not off > LEASE_MS
    right = ended and out and named and in_time and (not viewer or state == DONE)
    return {
        'off_ms': None if off != off else round(off, 1), 'ended': state, 'message': message[:200], 'right': right,
    }  # fmt: skip


def _recover(graph: Graph, node: str, pid: int) -> None:
    """The next trial begins with a whole graph, whose controller was stopped and holds nothing any more. pid: of the
    node that was killed, which the supervisor may have started again."""
    if node in ('cell', 'bridge', 'virtual_controller'):  # the part or the link is gone
        graph.down()
        return
    from waam_bringup.client import GraphClient
    from waam_msgs.srv import Command

    live = graph.live()
    if graph.pids()[node] == pid:
        live.revive(node)
    with GraphClient(live.domain) as client:
        live.ready(client)
        client.call(Command, 'bridge/command', Command.Request(code=Command.Request.STOP))


def twenty_jobs(graph: Graph, jobs: int = 20) -> dict:
    """Jobs one after the other in one graph: all end, no process grows. Growth is from the sixth job to the last."""
    seen: list[dict[str, tuple[float, int, int]]] = []
    states = []
    for _ in range(jobs):
        job = Job(graph, layers=1)
        if not job.wait(300.0):
            raise RuntimeError('a job did not end')
        states.append(job.told()[0])
        seen.append({n: _size(pid) for n, pid in graph.pids().items()})
    early, late = seen[min(5, jobs - 2)], seen[-1]
    growth = {n: [round(b - a, 1) for a, b in zip(early[n], late[n], strict=True)] for n in late}
    fds = max(g[1] for g in growth.values())
    threads = max(g[2] for g in growth.values())
    megabytes = max(g[0] for g in growth.values())
    return {
        'jobs': jobs, 'done': states.count(DONE), 'grown_mb_most': megabytes, 'grown_descriptors_most': fds,
        'grown_threads_most': threads, 'growth': growth,
        'right': states.count(DONE) == jobs and fds <= 2 and threads <= 1 and megabytes < 20.0,
    }  # fmt: skip


def _size(pid: int) -> tuple[float, int, int]:
    """Resident MB, descriptors and threads of a process."""
    with suppress(OSError):
        return (
            memory_mb(pid),
            len(os.listdir(f'/proc/{pid}/fd')),
            len(os.listdir(f'/proc/{pid}/task')),
        )
    return 0.0, 0, 0
