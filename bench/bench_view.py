"""What watching costs: the same job on the simulated cell in real time, with recorder, dashboard and panel and without.

Loop latency: from a lease tick (10 per second) to the answer of each node that the arc lease needs, on the steady clock
of one observer; it contains the scheduling of every node of the loop, and decides whether the arc stays on. The nodes
of the loop ask for real-time priority, as on a real cell; so does the observer, for its own delay is not part of the
loop. The runs alternate (off, on, off, on); a small part is scanned, planned and laid meanwhile.
"On": the recorder writes, the dashboard serves and keeps its file, the panel has an open page that takes every frame
and map. "Off": this process answers for the recorder, for a job does not start without one.

view.loop_p99_growth_pct: growth of the 99th percentile (baseline: the limit, 10 %);
view.loop_p99_ms: the 99th percentile with everything on (baseline: with everything off).

WAAM_VIEW_BENCH_S: seconds measured per run (default 40); WAAM_VIEW_BENCH_RUNS: runs of each kind (default 2):
6 minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from lib.campaign_graph import DONE, Graph, Job, until
from lib.emit import emit
from lib.limit import within

from waam_node import priority

WATCHERS = ('recorder', 'dashboard', 'panel')
SECONDS = float(os.environ.get('WAAM_VIEW_BENCH_S', '40'))
RUNS = int(os.environ.get('WAAM_VIEW_BENCH_RUNS', '2'))
START_S = 240.0  # a graph's start, a job's way to its first scan, and the graph's end: at most
SCANNING = 4  # JobStatus
PAGE = """
import asyncio, sys, aiohttp
async def main(url):
    async with aiohttp.ClientSession() as s, s.ws_connect(url + 'stream', headers={'Origin': url.rstrip('/')}) as ws:
        seen = {}
        async for message in ws:
            for name, version in message.json()['maps'].items():
                if seen.get(name) != version:
                    seen[name] = version
                    async with s.get(f'{url}api/map/{name}') as answer:
                        await answer.read()
asyncio.run(main(sys.argv[1]))
"""


@contextmanager
def urgent():
    """Threads that are started here run before those of the loop, where the account may have that."""
    print(f'# observer: {priority.request(priority.LEVEL + 1)}', file=sys.stderr, flush=True)
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class Observer:
    """Takes ticks and answers in a thread of its own; `delays` in s by node. Plays the recorder when asked to."""

    def __init__(self, domain: int, recorder: bool) -> None:
        import rclpy
        from rclpy.experimental import EventsExecutor

        from waam_msgs.msg import Heartbeat, LeaseTick
        from waam_msgs.srv import Record
        from waam_node.qos import BEAT

        self.context = rclpy.context.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('observer', context=self.context)
        self.delays: dict[str, list[float]] = {}
        self._ticks: dict[int, float] = {}
        self.node.create_subscription(LeaseTick, 'lease_tick', self._on_tick, BEAT)
        self.node.create_subscription(Heartbeat, 'heartbeat', self._on_beat, 100)
        if recorder:
            self.node.create_service(Record, 'recorder/control', self._on_record)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=0.1)

    def _on_tick(self, tick) -> None:
        self._ticks[tick.controller_us] = time.monotonic()

    def _on_beat(self, beat) -> None:
        sent = self._ticks.get(beat.controller_us)
        if sent is not None:
            self.delays.setdefault(beat.node, []).append(time.monotonic() - sent)

    def _on_record(self, request, response):
        response.success = True
        return response

    def close(self) -> None:
        import rclpy

        self._over.set()
        self._thread.join(5.0)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def measure(folder: Path, watched: bool) -> np.ndarray:
    """Delays (s) of all nodes that both kinds of run have, in SECONDS of jobs."""
    from waam_bringup import run_state

    graph = Graph(folder, 1.0, () if watched else WATCHERS)
    try:
        domain = graph.live().domain
        with urgent():
            observer = Observer(domain, recorder=not watched)
        words = [sys.executable, '-c', PAGE, run_state.load(graph.run).panel_url]
        page = subprocess.Popen(words) if watched else None
        try:
            end = None
            while end is None or time.monotonic() < end:
                job = Job(graph)
                if not until(lambda job=job: job.status and job.status.state >= SCANNING, 120.0):
                    raise RuntimeError(f'the job does not scan: {job.error or job.told()[1]}')
                if end is None:
                    observer.delays.clear()
                    end = time.monotonic() + SECONDS
                if job.wait(max(0.0, end - time.monotonic())) and job.told()[0] != DONE:
                    raise RuntimeError(f'the job failed: {job.error or job.told()[1]}')
            delays = {n: d for n, d in observer.delays.items() if n not in WATCHERS}
        finally:
            if page is not None:
                page.kill()
                page.wait()
            observer.close()
    finally:
        graph.down()
    return np.concatenate([np.array(d) for d in delays.values()])


def watching() -> None:
    """Alternating runs, pooled by kind."""
    pooled: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for number in range(RUNS):
        for watched in (False, True):
            with tempfile.TemporaryDirectory(prefix='waam_view_bench_') as scratch:
                with within(START_S + SECONDS, 'a run of the watched loop'):
                    pooled[watched].append(measure(Path(scratch), watched))
                shown = np.percentile(pooled[watched][-1] * 1e3, [50, 99])
                kind = 'on' if watched else 'off'
                print(f'# run {number + 1} {kind}: p50 {shown[0]:.2f} ms, p99 {shown[1]:.2f} ms',
                      file=sys.stderr, flush=True)  # fmt: skip
    off, on = (float(np.percentile(np.concatenate(pooled[k]) * 1e3, 99)) for k in (False, True))
    emit('view.loop_p99_growth_pct', 100 * (on / off - 1), '%', 'limit', 10.0)
    emit('view.loop_p99_ms', on, 'ms', 'recorder, dashboard and panel off, same run', off)


FIGURES = {'view.loop_p99_growth_pct': watching, 'view.loop_p99_ms': watching}
