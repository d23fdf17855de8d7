"""A graph whose processes are children of this one: one that was killed is started again, the others go on."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

# of one graph: the ports of more dead nodes cannot be held (waam_bringup.shared_memory)
DEATHS = 14


class LiveGraph:
    """Start with `start`, end with `stop`. description: of graph.yaml, None = as it is; commands: by name of a node
    what is started in place of its program."""

    def __init__(
        self, settings, domain: int, timeout: float, description: dict | None = None,
        commands: Mapping[str, Sequence[str]] = {},
    ) -> None:  # fmt: skip
        self.settings, self.domain, self.timeout = settings, domain, timeout
        self._description, self._commands = description, commands
        self.deaths = 0
        self._supervisor = None
        self._lock, self._over = threading.Lock(), threading.Event()

    @property
    def worn_out(self) -> bool:
        """So many nodes died that it is better to start a new one."""
        return self.deaths >= DEATHS

    def start(self) -> None:
        """Starts all processes and watches them."""
        from waam_bringup import shared_memory
        from waam_bringup.supervisor import Supervisor

        shared_memory.clean()
        self.settings.run.mkdir(parents=True, exist_ok=True)
        self._supervisor = Supervisor(self.settings, self.domain, self._description)
        self._supervisor.specs = [
            replace(s, command=[*own, *s.command[1:]]) if (own := self._commands.get(s.name)) else s
            for s in self._supervisor.specs
        ]
        self._supervisor.start()
        self._supervisor.state.phase = 'up'
        self._supervisor.state.save(self.settings.run)
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def _watch(self) -> None:
        while not self._over.wait(0.1):
            with self._lock:
                self._supervisor.look()

    def stop(self) -> None:
        """Ends all processes."""
        self._over.set()
        self._watcher.join()
        self._supervisor.stop()

    def pid(self, name: str) -> int:
        """Of a process."""
        return self._supervisor.children[name].pid

    def ready(self, client) -> None:
        """Waits until every node answers. ClientError when one does not."""
        names = {spec.name for spec in self._supervisor.specs if spec.ros}
        client.wait_ready(names, self.timeout, dict, self.timeout)

    def kill(self, name: str) -> None:
        """kill -9. Its ports are held: a successor on the same ones would never hear."""
        from waam_bringup import shared_memory

        child = self._supervisor.children[name]
        ports = shared_memory.ports_of(child.pid)
        with suppress(ProcessLookupError):
            child.kill()
        self.deaths += 1
        self._supervisor.ports_of_dead.hold(ports)

    def revive(self, name: str) -> None:
        """Starts a process that was killed again."""
        from waam_bringup import shared_memory

        with self._lock:
            supervisor = self._supervisor
            try:
                supervisor.children[name].wait(5.0)
            except subprocess.TimeoutExpired:
                return  # the supervisor was faster
            supervisor.look()  # its death is in state.json
            shared_memory.clean()
            spec = next(s for s in supervisor.specs if s.name == name)
            state = supervisor.state.nodes[name]
            state.pid = supervisor._launch(spec, 'a').pid
            state.exit_code = state.ended_at = None
            supervisor.state.save(self.settings.run)
