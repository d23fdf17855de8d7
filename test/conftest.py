"""Graphs of real processes over real DDS and a real pseudo-terminal, each in its own folder and ROS domain."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from waam_bringup import run_state
from waam_bringup.client import ClientError, GraphClient
from waam_bringup.graph import Settings, load
from waam_bringup.jobs import make_goal
from waam_bringup.operate import graph, graph_watch
from waam_msgs.msg import JobStatus
from waam_node.stl import write_worn_block
from waam_node.testing import fresh_domain

sys.path.insert(0, str(Path(__file__).parent))  # for cores and purity
MAX_PAUSE_S = 120.0  # of a job that no test resumes
WITHOUT_ROS = {name for name, d in load().items() if not d.get('ros', True)}


@pytest.fixture(scope='session')
def part(tmp_path_factory) -> tuple[Path, Path]:
    """Nominal and worn block of 36 x 30 x 12 mm; the trough needs three layers."""
    return trough_block(tmp_path_factory.mktemp('part'), depth=3.6, steep=2.0)


def trough_block(folder: Path, depth: float, steep: float) -> tuple[Path, Path]:
    """Nominal and worn block of 36 x 30 x 12 mm. The trough is `depth` mm deep; its bottom takes 1 - 1 / `steep` of its
    length and width."""
    x, y = np.linspace(0, 36, 37), np.linspace(0, 30, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(np.abs(gx - 18) / 15, np.abs(gy - 15) / 12)
    return write_worn_block(folder, x, y, 12.0, depth * np.clip(steep * (1 - away), 0, 1))


@dataclass
class Bench:
    """A running graph with a client, and short ways to do what tests do."""

    run: Path
    jobs: Path
    domain: int
    client: GraphClient
    part: tuple[Path, Path]

    def goal(self, **changes):
        values = {
            'name': 'test', 'part': self.part[0], 'mode': 'restore', 'material': 'er70s-6', 'loop_mode': 'closed_loop',
            'layers': 0, 'layer_height': 0.0, 'bead_width': 0.0, 'k_gain': float('nan'), 'tolerance': 0.2,
            'scale': 1e-3, 'note': [], 'strategy': '', 'allowance': 0.0, 'passes': 1, 'wire_left': 0.0,
            'operator': 'test', 'fresh': True,
        }  # fmt: skip
        return make_goal(SimpleNamespace(**{**values, **changes}), self.jobs)

    def load(self) -> None:
        self.client.load_part(str(self.part[1]), (0.0, 0.0, 0.0), 3)

    def job(self, **changes):
        """Loads the worn part and runs a job to its end."""
        self.load()
        return self.run_job(self.goal(**changes))

    def run_job(self, goal, on_status=lambda _: None):
        """A job to its end. One that waits for a person is an error: nobody comes, and the test would wait for ever."""
        trouble, paused_at = graph_watch(self.run), None

        def alive() -> str:
            nonlocal paused_at
            job = self.client.job
            if job is None or job.state != JobStatus.PAUSED:
                paused_at = None
            elif paused_at is None:
                paused_at = time.monotonic()
            elif time.monotonic() - paused_at > MAX_PAUSE_S:
                self.client.trigger('job_sequencer/abort')
                return f'the job waits for a person: {job.message}'
            return trouble()

        return self.client.run_job(goal, on_status, alive)

    def state(self) -> run_state.RunState:
        return run_state.load(self.run)

    def kill(self, node: str) -> None:
        os.kill(self.state().nodes[node].pid, 9)

    def events(self) -> list[tuple[int, str]]:
        """What the controller wrote down by itself: (controller us, event)."""
        rows = (self.run / 'controller.events').read_text().splitlines()
        return [(int(r.split(' ', 1)[0]), r.split(' ', 1)[1]) for r in rows if ' ' in r]

    def count(self, event: str) -> int:
        return sum(e == event for _, e in self.events())

    def wait(self, condition, timeout: float, what: str) -> None:
        assert self.client.until(condition, timeout), f'{what} did not happen within {timeout} s'


@contextmanager
def running_graph(folder: Path, part, domain: int = 0, **settings) -> Iterator[Bench]:
    """On the cell that scatters least, unless `settings` name another preset: these tests ask what the graph does.
    domain: 0 = one of its own."""
    domain = domain or fresh_domain()
    run = folder / 'run'
    wanted = Settings(run=run, seed=3, **{'preset': 'gentle', **settings})
    try:
        with graph(wanted, domain, timeout=90.0) as (_, client):
            try:
                yield Bench(run, folder / 'jobs', domain, client, part)
            except BaseException:
                dump_stacks(run)
                raise
    except BaseException:
        print(last_logs(run))
        raise


def dump_stacks(run: Path) -> None:
    """Has every node that lives write into its log where its threads are. Others would die of the signal."""
    for name, node in run_state.load(run).nodes.items():
        if node.exit_code is None and name not in WITHOUT_ROS:
            with suppress(ProcessLookupError):
                os.kill(node.pid, signal.SIGUSR1)
    time.sleep(0.5)


def last_logs(run: Path, lines: int = 40) -> str:
    """The end of every log of a graph, for the report of a test that failed."""
    text = []
    for log in sorted([*run.glob('*.log'), *run.glob('logs/*.log')]):
        text += [
            f'--- {log.relative_to(run)}',
            *log.read_text(errors='replace').splitlines()[-lines:],
        ]
    return '\n'.join(text)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """A test that fails on a graph that outlives it: where the threads of its nodes are, and their logs."""
    report = yield
    if report.failed and call.when == 'call':
        for bench in (v for v in item.funcargs.values() if isinstance(v, Bench)):
            dump_stacks(bench.run)
            report.sections.append(('logs of the graph', last_logs(bench.run)))
    return report


@pytest.fixture
def make_graph(tmp_path, part):
    """make_graph(**settings) as a context manager -> Bench."""
    return lambda **settings: running_graph(tmp_path, part, **settings)


@pytest.fixture(scope='session')
def make_part():
    """make_part(folder, depth, steep): a worn block of one's own, as `trough_block`."""
    return trough_block


@pytest.fixture(scope='session')
def graph_in():
    """graph_in(folder, part, **settings) as a context manager -> Bench, for fixtures that outlive a test."""
    return running_graph


@pytest.fixture(scope='module')
def bench(tmp_path_factory, part) -> Iterator[Bench]:
    """One graph for a module."""
    with running_graph(tmp_path_factory.mktemp('graph'), part) as b:
        yield b


class Background:
    """A job in a thread with a client of its own, for tests that disturb it meanwhile."""

    def __init__(self, bench: Bench, **goal) -> None:
        self.result, self.error = None, None
        self._thread = threading.Thread(target=self._go, args=(bench, goal), daemon=True)
        self._thread.start()

    def _go(self, bench: Bench, goal: dict) -> None:
        try:
            with GraphClient(bench.domain) as client:
                self.result = client.run_job(
                    bench.goal(**goal), lambda _: None, graph_watch(bench.run)
                )
        except Exception as e:
            self.error = e

    def runs(self) -> bool:
        return self._thread.is_alive()

    def raise_error(self) -> bool:
        """For conditions that wait: an error of the job's thread ends the wait, and names the cause."""
        if self.error:
            raise self.error
        return False

    def join(self, timeout: float = 120.0):
        end = time.monotonic() + timeout
        while self.runs() and time.monotonic() < end:
            time.sleep(0.05)
        assert not self.runs(), 'the job did not end'
        return self.result


@pytest.fixture
def background():
    """background(bench, **goal) starts a job; one that a failed test leaves behind is ended, for the next test."""
    begun: list[tuple[Bench, Background]] = []

    def start(bench: Bench, **goal) -> Background:
        begun.append((bench, Background(bench, **goal)))
        return begun[-1][1]

    yield start
    for bench, job in begun:
        if job.runs():
            # the graph may have gone
            with suppress(ClientError), GraphClient(bench.domain) as client:
                client.trigger('job_sequencer/abort')
            job.join()


@pytest.fixture(scope='session')
def bench_class() -> type[Bench]:
    """For tests that start and end the graph themselves."""
    return Bench
