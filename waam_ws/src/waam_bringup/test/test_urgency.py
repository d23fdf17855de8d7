"""Priority of the loop: real time while a job runs, ordinary while the cell is idle."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from waam_bringup import urgency
from waam_bringup.urgency import AGAIN_S, Urgency
from waam_node import priority

PROGRAM = """
import threading, time
threading.Thread(target=lambda: time.sleep(60), daemon=True).start()
print('up', flush=True)
time.sleep(60)
"""


@pytest.fixture
def process():
    """With two threads."""
    with subprocess.Popen([sys.executable, '-c', PROGRAM], stdout=subprocess.PIPE) as made:
        assert made.stdout and made.stdout.readline()
        yield made.pid
        made.kill()


def policies(pid: int) -> set[int]:
    return {os.sched_getscheduler(int(t.name)) for t in Path(f'/proc/{pid}/task').iterdir()}


def test_all_threads_are_urgent_while_a_job_runs(process):
    if priority.give(process, True):
        pytest.skip('this account may not use real-time priority')
    found = Urgency()
    found.look([process], False, 0.0)  # as its own start has left it
    assert policies(process) == {os.SCHED_OTHER}
    found.look([process], True, 0.1)
    assert policies(process) == {os.SCHED_RR}
    found.look([process], False, 0.2)
    assert policies(process) == {os.SCHED_OTHER}
    priority.give(process, True)  # it has been started again
    found.look([process], False, 0.2 + AGAIN_S)
    assert policies(process) == {os.SCHED_OTHER}


def test_a_process_that_has_ended_is_nothing_and_a_refusal_is_asked_for_once(monkeypatch):
    assert priority.give(2**22 + 1, True) == ''
    asked = []
    monkeypatch.setattr(urgency.priority, 'give', lambda *a: asked.append(a) or 'not permitted')
    found = Urgency()
    for n in range(3):
        found.look([7, 8], True, 10.0 * n)
    assert asked == [(7, True)] and found.refused == 'not permitted'
