"""The graph while nothing happens.

graph.idle_cores: processor cores that a simulated graph keeps busy while it waits for a job (baseline: its virtual
controller without `--rest`, as fast as the nodes keep up).
"""

from __future__ import annotations

import copy
import sys
import tempfile
import time
from pathlib import Path

from lib.emit import emit
from lib.node import cpu_seconds

SETTLE_S = 5.0  # after every node has been heard
SECONDS = 20.0


def idle_cores(description: dict) -> float:
    """Cores that all processes of a graph take together while it waits."""
    from waam_bringup.graph import Settings
    from waam_bringup.supervisor import Supervisor
    from waam_node.testing import fresh_domain

    def turn(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            supervisor.look()
            time.sleep(0.1)

    with tempfile.TemporaryDirectory() as run:
        supervisor = Supervisor(Settings(run=Path(run)), fresh_domain(), description)
        supervisor.start()
        try:
            pids = {n: c.pid for n, c in supervisor.children.items()}
            watched = [pids[spec.name] for spec in supervisor.specs if spec.restart]
            while any(supervisor.watchdog.last_heard(pid) is None for pid in watched):
                turn(0.2)
            turn(SETTLE_S)
            before = {n: cpu_seconds(pid) for n, pid in pids.items()}
            turn(SECONDS)
            cores = {n: (cpu_seconds(pid) - before[n]) / SECONDS for n, pid in pids.items()}
        finally:
            supervisor.stop()
    print({n: round(c, 3) for n, c in cores.items()}, file=sys.stderr)
    return sum(cores.values())


def idle() -> None:
    """With the whole table of processes as it is, and without that option."""
    from waam_bringup.graph import load

    restless = copy.deepcopy(load())
    restless['virtual_controller']['arguments'].remove('--rest')
    emit('graph.idle_cores', idle_cores(load()), 'cores', 'without --rest', idle_cores(restless))


FIGURES = {'graph.idle_cores': idle}
