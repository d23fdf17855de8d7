"""What is known about a running graph: <run>/state.json, written by the supervisor, read by everyone."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from waam_node import job_folder
from waam_node.files import write_atomically
from waam_process.names import INTERRUPTED, JOB_ENDED
from waam_process.safe_files import FileError, read_mapping, read_text


@dataclass
class NodeState:
    """State of one process."""

    pid: int
    exit_code: int | None = None  # None while it runs; negative = ended by that signal
    ended_at: float | None = None
    restarts: int = 0  # how often it was started again because it hung
    reason: str = ''  # why, the last time


@dataclass
class RunState:
    """State of a graph, as the supervisor writes it."""

    supervisor: int  # its pid
    phase: str  # starting, up, stopping, down
    domain: int  # ROS_DOMAIN_ID
    simulated: bool
    port: str
    web_url: str = ''
    panel_url: str = ''
    message: str = ''
    preset: str = ''  # of the simulated cell
    nodes: dict[str, NodeState] = field(default_factory=dict)  # by name

    def save(self, run: Path) -> None:
        """Replaces state.json in the folder `run`; a reader never sees half of it."""
        write_atomically(run / 'state.json', json.dumps(asdict(self), indent=1))

    @property
    def alive(self) -> bool:
        """True while the supervisor's process exists and the graph is not down."""
        return self.phase != 'down' and process_exists(self.supervisor)

    @property
    def dead_nodes(self) -> dict[str, NodeState]:
        """Nodes that have ended, by name."""
        return {n: s for n, s in self.nodes.items() if s.exit_code is not None}


def load(run: Path) -> RunState | None:
    """The state of the graph in this folder, or None when none was ever started there."""
    try:
        data = read_mapping(run / 'state.json')
    except FileError:
        return None
    nodes = {n: NodeState(**s) for n, s in data.pop('nodes').items()}
    return RunState(nodes=nodes, **data)


class RunInUse(ValueError):
    """Another graph is up in the folder; the text names its supervisor."""


@contextmanager
def held(run: Path) -> Iterator[None]:
    """The folder belongs to this process for the length of the block, or RunInUse. The lock ends with the process."""
    run.mkdir(parents=True, exist_ok=True)
    with open(run / 'supervisor.lock', 'a') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            state = load(run)
            who = f' (supervisor: pid {state.supervisor})' if state else ''
            text = f'a graph is up already in {run}{who}: waam status, waam stop'
            raise RunInUse(text) from None
        yield


ENDED = (*JOB_ENDED, INTERRUPTED)  # states in a job's status.json


def job_status(run: Path) -> tuple[Path, dict[str, Any]] | None:
    """status.json of the newest job of the graph in this folder, and what it says; None when there is none."""
    try:
        file = Path(read_text(run / 'job')) / job_folder.STATUS
        return file, read_mapping(file)
    except FileError:
        return None


def job_runs(run: Path) -> bool:
    """Whether a job is under way."""
    found = job_status(run)
    return found is not None and found[1].get('state') not in ENDED


def process_exists(pid: int) -> bool:
    """Whether the process runs; one that has ended but was not waited for (a zombie) does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except OSError:
        return True


def describe_exit(code: int | None) -> str:
    """'exited with 2' or 'killed by SIGKILL'; None: 'is running'."""
    import signal

    if code is None:
        return 'is running'
    if code < 0:
        return f'killed by {signal.Signals(-code).name}'
    return f'exited with {code}'
