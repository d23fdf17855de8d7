"""Real-time priority for the nodes of the loop while a job runs, and none while the cell is idle, so that it holds up
no other cell of this computer."""

from __future__ import annotations

from collections.abc import Iterable

from waam_node import priority

AGAIN_S = 1.0  # a process takes its priority when it has started, and its threads theirs from it


class Urgency:
    """Call `look` some times a second. What the account may not do is tried once."""

    def __init__(self) -> None:
        self.refused = ''
        self._now = False
        self._since = float('-inf')

    def look(self, pids: Iterable[int], job_runs: bool, now: float) -> None:
        """pids: processes that still run; now: s of a steady clock."""
        if self.refused or (job_runs == self._now and now - self._since < AGAIN_S):
            return
        self._now, self._since = job_runs, now
        for pid in pids:
            self.refused = self.refused or priority.give(pid, job_runs)
