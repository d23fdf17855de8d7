"""Start and stop a graph, or have one for the length of a with-block: shared by the command line, tests, benchmarks."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from waam_process.operating import ROBOT

from . import run_state, shared_memory
from .client import NO_CONTROLLER_S, ClientError, GraphClient
from .graph import Settings, processes
from .run_state import RunState, describe_exit


def free_port() -> int:
    """A TCP port that nobody listens on right now (127.0.0.1)."""
    with socket.socket() as s:
        s.bind(('127.0.0.1', 0))
        return s.getsockname()[1]


PANEL_PORT = 8600


def panel_port() -> int:
    """The usual port of the operator's page, or any free one when it is taken."""
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind(('127.0.0.1', PANEL_PORT))
        except OSError:
            return free_port()
    return PANEL_PORT


def stop_port(panel: int, bind: str = '127.0.0.1') -> int:
    """The one after that of the page, or any free one when it is taken."""
    with socket.socket(socket.AF_INET6 if ':' in bind else socket.AF_INET) as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind((bind, panel + 1))
        except (OSError, OverflowError):
            return free_port()
    return panel + 1


def default_domain(run: Path) -> int:
    """ROS_DOMAIN_ID when set, else one of 1..99 made from the folder, so that two graphs do not meet."""
    if os.environ.get('ROS_DOMAIN_ID'):
        return int(os.environ['ROS_DOMAIN_ID'])
    return 1 + sum(str(run).encode()) % 99


def up(settings: Settings, domain: int, timeout: float = 60.0) -> RunState:
    """Starts a graph in the background; returns when every node answers, else stops it and raises ClientError."""
    state = run_state.load(settings.run)
    if state and state.alive:
        raise ClientError(f'a graph is up already in {settings.run} (waam status, waam stop)')
    names = {p.name for p in processes(settings) if p.ros}
    shared_memory.clean()  # of nodes that were killed
    log_file = settings.run / 'supervisor.log'
    with run_state.held(settings.run):  # nobody else has begun in this moment
        log_file.write_text('')
    with open(log_file, 'a') as log:
        command = [sys.executable, '-m', 'waam_bringup.cli', 'up', '--foreground']
        supervisor = subprocess.Popen(
            [*command, *arguments(settings, domain)],
            stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
        )  # fmt: skip
    try:
        with GraphClient(domain) as client:
            # a robot's driver begins after its bridge
            patience = timeout if settings.machine == ROBOT else NO_CONTROLLER_S
            client.wait_ready(names, timeout, lambda: _dead(settings.run, supervisor), patience)
    except BaseException as e:
        if _begun_by(settings.run, supervisor):
            stop(settings.run)
        elif supervisor.poll() is None:
            supervisor.terminate()
        if isinstance(e, ClientError):
            raise ClientError(f'{e}\nlogs: {settings.run}/logs') from None
        raise
    return require_up(settings.run)


def _begun_by(run: Path, supervisor: subprocess.Popen) -> RunState | None:
    """The state that this supervisor has written, None = not yet."""
    state = run_state.load(run)
    return state if state and state.supervisor == supervisor.pid else None


def _dead(run: Path, supervisor: subprocess.Popen) -> dict[str, str]:
    """Processes that ended, with how and the last line that they printed."""
    if supervisor.poll() is not None:
        return {
            'supervisor': f'{describe_exit(supervisor.returncode)}: {last_line(run / "supervisor.log")}'
        }
    state = _begun_by(run, supervisor)
    if state is None:
        return {}
    return {
        name: f'{describe_exit(s.exit_code)}: {last_line(run / "logs" / f"{name}.log")}'
        for name, s in state.dead_nodes.items()
    }


def ended(run: Path) -> list[str]:
    """Processes of the graph that ended by themselves, and how: 'cell killed by SIGKILL'."""
    state = run_state.load(run)
    dead = state.dead_nodes if state else {}
    return [f'{name} {describe_exit(s.exit_code)}' for name, s in dead.items()]


def last_line(path: Path) -> str:
    """Of a log: the last line that is not blank, '' when there is none or no file."""
    try:
        lines = [line for line in path.read_text(errors='replace').splitlines() if line.strip()]
    except OSError:
        return ''
    return lines[-1] if lines else ''


def stop(run: Path, timeout: float = 20.0) -> bool:
    """Stops the graph in this folder; False when none was up."""
    state = run_state.load(run)
    if state is None or not state.alive:
        return False
    os.kill(state.supervisor, signal.SIGTERM)
    end = time.monotonic() + timeout
    while run_state.process_exists(state.supervisor) and time.monotonic() < end:
        time.sleep(0.05)
        with suppress(ChildProcessError):
            os.waitpid(state.supervisor, os.WNOHANG)
    if run_state.process_exists(state.supervisor):
        raise ClientError(
            f'the supervisor (pid {state.supervisor}) did not stop within {timeout:.0f} s'
        )
    return True


def require_up(run: Path) -> RunState:
    """The state of the running graph. ClientError when none is up."""
    state = run_state.load(run)
    if state is None or not state.alive:
        raise ClientError("no graph is up; start one with 'waam up'")
    return state


def graph_trouble(run: Path) -> str:
    """Why the graph cannot finish a job any more: '' while all is well, else which process ended and how."""
    state = run_state.load(run)
    if state is None or not state.alive:
        return 'the graph was stopped'
    if 'job_sequencer' in state.dead_nodes:
        how = describe_exit(state.dead_nodes['job_sequencer'].exit_code)
        return f'job_sequencer {how}; the job is interrupted, the arc lease ended with it'
    return ''


def graph_watch(run: Path) -> Callable[[], str]:
    """`graph_trouble` of a job that begins now: a job_sequencer that hung and was started again has forgotten it."""
    state = run_state.load(run)
    restarts = state.nodes['job_sequencer'].restarts if state else 0

    def trouble() -> str:
        if text := graph_trouble(run):
            return text
        now = run_state.load(run)
        sequencer = now.nodes['job_sequencer'] if now else None
        if sequencer and sequencer.restarts > restarts:
            return f'{sequencer.reason}; the job is interrupted'
        return ''

    return trouble


def arguments(settings: Settings, domain: int) -> list[str]:
    """Of `waam up`, for a graph with these settings."""
    same = ('seed', 'rate', 'grpc_port', 'web_port', 'hang_timeout', 'machine', 'port', 'preset')
    args = ['--settings-are-whole', '--run', str(settings.run), '--domain', str(domain)]
    for name in same:
        args += [f'--{name.replace("_", "-")}', str(getattr(settings, name))]
    args += ['--panel-port', str(settings.panel_port or free_port())]
    args += ['--stop-port', str(settings.stop_port)] if settings.stop_port else []
    args += ['--machine-steps', *(f'{v:.10g}' for v in settings.machine_steps)]
    args += ['--pyrometer', settings.pyrometer] if settings.pyrometer else []
    for name in settings.without:
        args += ['--without', name]
    for file in settings.params_files:
        args += ['--params-file', str(file)]
    return args


@contextmanager
def graph(
    settings: Settings, domain: int, timeout: float = 60.0
) -> Iterator[tuple[RunState, GraphClient]]:
    """A graph for the length of the block."""
    state = up(settings, domain, timeout)
    try:
        with GraphClient(domain) as client:
            yield state, client
    finally:
        stop(settings.run)
