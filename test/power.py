"""Power cuts on a simulated cell: the whole graph is killed and started again."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from waam_bringup import run_state
from waam_bringup.client import GraphClient
from waam_bringup.graph import Settings
from waam_bringup.operate import stop, up


@contextmanager
def power_on(
    settings: Settings, domain: int, timeout: float = 90.0
) -> Iterator[tuple[GraphClient, list[int]]]:
    """A graph that may be killed inside the block. Yields a client and the pids, the supervisor's first."""
    state = up(settings, domain, timeout)
    try:
        with GraphClient(domain) as client:
            yield client, [state.supervisor, *(n.pid for n in state.nodes.values())]
    finally:
        if run_state.process_exists(state.supervisor):
            stop(settings.run)


def power_cut(pids: list[int], timeout: float = 20.0) -> None:
    """kill -9 of all, in this order (a supervisor killed first cannot clean up), until they are gone."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    end = time.monotonic() + timeout
    while any(map(run_state.process_exists, pids)) and time.monotonic() < end:
        time.sleep(0.05)
        for pid in pids:
            with suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
