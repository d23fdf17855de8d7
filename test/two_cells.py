"""Two cells of real processes in two namespaces of one ROS domain, for test_namespaces.py and bench_ros.py."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

from waam_bringup.client import GraphClient
from waam_bringup.graph import Settings
from waam_bringup.jobs import make_goal
from waam_bringup.supervisor import Supervisor
from waam_msgs.action import RunJob
from waam_record.bag_reader import info

LEFT_OUT = ('dashboard', 'panel')
MANY_TOPICS = 20
READY_S, TURN_S = 240.0, 0.1
RATE = 3.0  # simulated s per s: as fast as they can, two cells leave no time to answer
USUAL = {
    'name': 'short', 'mode': 'restore', 'material': 'er70s-6', 'loop_mode': 'closed_loop', 'layers': 1,
    'layer_height': 0.0, 'bead_width': 0.0, 'k_gain': float('nan'), 'tolerance': 0.2, 'scale': 1e-3, 'note': [],
    'strategy': '', 'allowance': 0.0, 'passes': 1, 'wire_left': 0.0, 'operator': 'test', 'fresh': True,
}  # fmt: skip


@dataclass
class Cell:
    """A graph below its namespace. values: of its parameter file, by node."""

    folder: Path
    namespace: str
    domain: int
    values: dict[str, dict[str, object]]
    results: list[RunJob.Result] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.jobs = self.folder / self.namespace / 'jobs'
        self.jobs.mkdir(parents=True)
        file = self.folder / f'{self.namespace}.yaml'
        file.write_text(
            ''.join(
                f'/{self.namespace}/{node}: {{ros__parameters: {values}}}\n'
                for node, values in self.values.items()
            )
        )
        settings = Settings(
            self.folder / self.namespace / 'run', seed=3, rate=RATE, preset='gentle', namespace=self.namespace,
            params_files=(file,), without=LEFT_OUT,
        )  # fmt: skip
        with patch.dict(os.environ, WAAM_JOBS=str(self.jobs)):
            self.supervisor = Supervisor(settings, self.domain)
            self.supervisor.start()
        self.names = {p.name for p in self.supervisor.specs if p.ros}

    def dead(self) -> dict[str, str]:
        """Processes that have ended."""
        self.supervisor.look()
        return {n: f'exit code {s.exit_code}' for n, s in self.supervisor.state.dead_nodes.items()}

    def job(self, part: tuple[Path, Path]) -> None:
        """Lays one layer in the worn part of (nominal, worn)."""
        with GraphClient(self.domain, self.namespace) as client:
            client.wait_ready(self.names, READY_S, self.dead)
            client.load_part(str(part[1]), (0.0, 0.0, 0.0), 3)
            goal = make_goal(SimpleNamespace(**USUAL, part=part[0]), self.jobs)
            self.results.append(client.run_job(goal, lambda _: None, lambda: ''))

    def strangers(self) -> list[str]:
        """Topics in the record of its job that are not of this cell. ValueError where it holds hardly any."""
        topics = info(Path(self.results[0].job_dir) / 'record').topics
        if len(topics) < MANY_TOPICS:
            raise ValueError(f'the record of {self.namespace} has {len(topics)} topics')
        return [t for t in topics if not t.startswith(f'/{self.namespace}/')]


@contextmanager
def two_cells(
    folder: Path, domain: int, values: dict[str, dict[str, dict[str, object]]]
) -> Iterator[list[Cell]]:
    """values: of the parameter file of each, by namespace and node."""
    cells: list[Cell] = []
    try:
        for namespace, own in values.items():
            cells.append(Cell(folder, namespace, domain, own))
        yield cells
    finally:
        for cell in cells:
            cell.supervisor.stop()


def lay_both(cells: list[Cell], part: tuple[Path, Path], timeout: float) -> None:
    """Both jobs at once; AssertionError when one has not ended within `timeout` seconds."""
    threads = [threading.Thread(target=c.job, args=(part,), daemon=True) for c in cells]
    for thread in threads:
        thread.start()
    end = time.monotonic() + timeout
    while any(t.is_alive() for t in threads):
        assert time.monotonic() < end, 'a job has not ended'
        time.sleep(TURN_S)
