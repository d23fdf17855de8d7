"""The plain supervisor: starts the processes of the graph, watches them, says what died, stops them in reverse order.

A node that died is not restarted by itself: a job in the middle of a layer must not continue with one that has lost its
state. Only what holds none (`restart: always`) is. One that hangs while no job runs is killed and restarted, since the
next job would fail on it. A person restarts both on the page (*Restart programs*, `waam_node.restart`).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from waam_node import alive, priority, restart
from waam_node.files import write_state

from . import run_state, shared_memory
from .graph import Process, Settings, environment, processes
from .run_state import ENDED, NodeState, RunState, describe_exit, job_runs, job_status
from .urgency import Urgency
from .watchdog import Watchdog

DEAD_S, MAX_DEAD_S = 1.0, 60.0  # until a process that must not be missing is started again
MAX_RESTARTS = 3  # restarts of one node per graph; a node that hangs repeatedly needs a person
HANGS_S = 3.0  # of silence after which a node is restarted by a person who asks for it
DUMP_S = 0.3  # for a hanging node to write where its threads are


class Supervisor:
    """Owns the processes of one graph. Call `start`, then `watch`, which returns on a signal, then `stop`."""

    def __init__(
        self, settings: Settings, domain: int, description: dict[str, Any] | None = None
    ) -> None:
        self.settings = settings
        self.specs: list[Process] = processes(settings, description)
        self.watchdog = Watchdog(settings.hang_timeout)
        self.children: dict[str, subprocess.Popen] = {}
        self.urgency = Urgency()
        self.ports_of_dead = shared_memory.HeldPorts()
        port = settings.port or str(settings.run / 'controller')
        self.state = RunState(os.getpid(), 'starting', domain, settings.simulated, port)
        self.state.preset = settings.preset if settings.simulated else ''
        if settings.web_port:
            stream = f'rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{settings.grpc_port}%2Fproxy'
            self.state.web_url = f'http://127.0.0.1:{settings.web_port}/?url={stream}'
        if settings.panel_port and any(p.name == 'panel' for p in self.specs):
            self.state.panel_url = f'http://127.0.0.1:{settings.panel_port}/'
        self._asked_to_stop = False
        self._ports: dict[str, list[Path]] = {}  # of each node, as long as it lives
        self._died: dict[str, float] = {}  # s of the steady clock
        self._turn = 0

    def start(self) -> None:
        """Starts everything, the virtual controller first (the others wait for its port themselves)."""
        run = self.settings.run
        (run / 'logs').mkdir(parents=True, exist_ok=True)
        for spec in self.specs:
            self.state.nodes[spec.name] = NodeState(self._launch(spec, 'w').pid)
        self.state.save(run)

    def _launch(self, spec: Process, mode: str, **more: str) -> subprocess.Popen:
        """Starts one process; mode: of opening its log; more: of its environment."""
        run = self.settings.run
        base = dict(os.environ, ROS_DOMAIN_ID=str(self.state.domain))
        base |= environment(base)
        base |= {'ROS_LOG_DIR': str(run / 'logs' / 'ros'), alive.ADDRESS: self.watchdog.address}
        with open(run / 'logs' / f'{spec.name}.log', mode) as log:
            child = subprocess.Popen(
                spec.command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=base | spec.environment | more,
                start_new_session=True,  # Ctrl-C in the terminal reaches the supervisor, which stops them in order
            )
        self.children[spec.name] = child
        if spec.ros:
            self.watchdog.watch(child.pid)
        return child

    def watch(self, poll: float = 0.1) -> None:
        """Returns when asked to stop (SIGINT, SIGTERM). Every death is recorded at once."""
        for sig in (signal.SIGINT, signal.SIGTERM):
            signal.signal(sig, self._on_signal)
        self.state.phase = 'up'
        self._save()
        while not self._asked_to_stop:
            self.look()
            time.sleep(poll)

    def _save(self) -> None:
        """What the disk refuses is told: processes that nobody ends would be worse."""
        try:
            self.state.save(self.settings.run)
        except OSError as e:
            print(f'[waam] {self.settings.run}/state.json: {e.strerror}', file=sys.stderr)

    def look(self) -> None:
        """One look at all processes."""
        self._note_ports()
        self._reap()
        self._restart_asked()
        self._restart_dead()
        self._restart_hanging()
        asking = [s.name for s in self.specs if priority.VARIABLE in s.environment]
        running = [self.children[n].pid for n in asking if self.children[n].poll() is None]
        self.urgency.look(running, job_runs(self.settings.run), time.monotonic())

    def _on_signal(self, *_: object) -> None:
        self._asked_to_stop = True

    def _reap(self) -> None:
        changed = False
        for name, child in self.children.items():
            state = self.state.nodes[name]
            if state.exit_code is None and child.poll() is not None:
                state.exit_code, state.ended_at = child.returncode, time.time()
                self._died[name] = time.monotonic()
                changed = True
                self.watchdog.forget(child.pid)
                self.ports_of_dead.hold(self._ports.pop(name, []))
                self._report_death(name, child.returncode)
        if changed:
            self._save()

    def _restart_hanging(self) -> None:
        """Restarts the process that has been silent longest, unless a job runs. Others may be silent because it holds
        what they wait for (a lock in shared memory): they get their time again."""
        silent = self.watchdog.silent(time.monotonic())
        if not silent or job_runs(self.settings.run):
            return
        hanging = [spec for spec in self.specs if self._may_restart(spec, silent)]
        if hanging:
            longest = max(hanging, key=lambda spec: silent[self.children[spec.name].pid])
            self._restart(longest, silent[self.children[longest.name].pid])
            self.watchdog.forgive(time.monotonic())

    def _may_restart(self, spec: Process, silent: dict[int, float]) -> bool:
        state = self.state.nodes[spec.name]
        hangs = self.children[spec.name].pid in silent and state.exit_code is None
        return spec.restart and hangs and state.restarts < MAX_RESTARTS

    def _restart_dead(self) -> None:
        """A process that holds no state and must not be missing, beside a job too: after 1 s, the next times later."""
        for spec in self.specs:
            state = self.state.nodes[spec.name]
            if not spec.restart_always or state.exit_code is None:
                continue
            dead = time.monotonic() - self._died[spec.name]
            if dead > min(DEAD_S * 2**state.restarts, MAX_DEAD_S):
                self._start_again(spec, f'{spec.name} {describe_exit(state.exit_code)}')

    def _restart_asked(self) -> None:
        """What a person asks for: everything that has died or hangs, whether a job is under way or not."""
        word = restart.take(self.settings.run)
        if word is None:
            return
        silent = self.watchdog.silent(time.monotonic(), HANGS_S)
        started = []
        for spec in self.specs:
            state, pid = self.state.nodes[spec.name], self.children[spec.name].pid
            if state.exit_code is not None:
                how = describe_exit(state.exit_code)
            elif pid in silent:
                how = f'gave no sign of life for {silent[pid]:.0f} s'
            else:
                continue
            self._start_again(spec, f'{spec.name} {how}; a person had it started again')
            started.append(f'{spec.name} ({how})')
        if started:
            self.watchdog.forgive(time.monotonic())
        try:
            restart.answer(self.settings.run, word, started)
        except OSError as e:
            print(f'[waam] {self.settings.run}/{restart.ANSWER}: {e.strerror}', file=sys.stderr)

    def _restart(self, spec: Process, seconds: float) -> None:
        how = f'gave no sign of life for {seconds:.0f} s while no job ran; it was ended and started again'
        self._start_again(spec, f'{spec.name} {how}')

    def _start_again(self, spec: Process, why: str) -> None:
        child, state = self.children[spec.name], self.state.nodes[spec.name]
        state.reason = f'{why} at {time.strftime("%H:%M:%S")}'
        print(f'[waam] {state.reason}', file=sys.stderr)
        if state.exit_code is None:
            ports = shared_memory.ports_of(child.pid)
            self._end_hanging(child)
            self.ports_of_dead.hold(ports)
            if spec.name == 'job_sequencer':
                mark_interrupted(self.settings.run, why)
        if spec.ros:
            shared_memory.clean()
        state.pid = self._launch(spec, 'a', **{alive.RESTARTED: state.reason}).pid
        state.exit_code = state.ended_at = None
        state.restarts += 1
        self.state.message = state.reason
        self._save()

    def _end_hanging(self, child: subprocess.Popen) -> None:
        child.send_signal(signal.SIGUSR1)
        # one that was stopped (SIGSTOP) can write that, too, and lets go of locks that would outlive it
        child.send_signal(signal.SIGCONT)
        time.sleep(DUMP_S)
        child.kill()
        child.wait()
        self.watchdog.forget(child.pid)

    def _note_ports(self) -> None:
        """One node a look: of a dead one nobody can tell any more on which ports it listened."""
        names = list(self.children)
        if names:
            self._turn = (self._turn + 1) % len(names)
            name = names[self._turn]
            if ports := shared_memory.ports_of(self.children[name].pid):
                self._ports[name] = ports

    def _report_death(self, name: str, code: int) -> None:
        text = f'{name} {describe_exit(code)}'
        print(f'[waam] {text}; its log: {self.settings.run}/logs/{name}.log', file=sys.stderr)
        self.state.message = text
        if name == 'job_sequencer':
            mark_interrupted(self.settings.run, text)

    def stop(self, patience: float = 8.0) -> None:
        """Ends the processes in reverse order; what does not leave within `patience` seconds is killed."""
        self.state.phase = 'stopping'
        self._save()
        for name in reversed(list(self.children)):
            child = self.children[name]
            if child.poll() is None:
                child.send_signal(signal.SIGTERM)
        end = time.monotonic() + patience
        for name, child in self.children.items():
            try:
                child.wait(max(0.1, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                print(f'[waam] {name} did not stop and is killed', file=sys.stderr)
                child.kill()
                child.wait()
            self.state.nodes[name].exit_code = child.returncode
        mark_interrupted(self.settings.run, 'the graph was stopped')
        self.watchdog.close()
        self.ports_of_dead.close()
        self.state.phase = 'down'
        self._save()


def mark_interrupted(run: Path, reason: str) -> None:
    """Marks the newest job as interrupted in its status.json when it was still running."""
    found = job_status(run)
    if found is None or found[1].get('state') in ENDED:
        return
    file, data = found
    data.update(
        state='INTERRUPTED',
        message=f'{reason}; the arc lease ended with it. {data.get("message", "")}',
    )
    write_state(file, json.dumps(data, indent=1))


def run(settings: Settings, domain: int) -> int:
    """Runs a graph in this process from start to stop: the body of `waam up --foreground`. RunInUse when one is up in
    the folder already."""
    with run_state.held(settings.run):
        (settings.run / 'state.json').unlink(missing_ok=True)
        supervisor = Supervisor(settings, domain)
        try:
            supervisor.start()
            supervisor.watch()
        finally:
            supervisor.stop()
    return 0
