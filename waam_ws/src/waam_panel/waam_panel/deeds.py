"""What a cell does, whoever asked for it, for the audit log: a job that another ROS program started is in it, too. No
ROS."""

from __future__ import annotations

from typing import Any

from waam_process.names import JOB_ENDED, JOB_RUNNING

from .state import UNKNOWN, PanelState

PAUSED = 'PAUSED'
Deed = tuple[str, dict[str, Any]]  # what, values


class Deeds:
    """Call `look` once a second. What was there at the first look is old."""

    def __init__(self) -> None:
        self._job: tuple[str, str] | None = None  # id, state
        self._armed: bool | None = None

    def look(self, state: PanelState) -> list[Deed]:
        """What is new: a job begins, pauses, goes on or ends; the cell is armed or disarmed."""
        job, machine = state.sections.get('job'), state.sections.get('machine')
        found: list[Deed] = []
        if state.lost_job:
            found = self._of_lost(state.lost_job)
        elif job:
            found = self._of_job(str(job.get('id') or ''), str(job['state']))
        if machine:
            found += self._of_arm(bool(machine.get('armed')))
        return found

    def _of_job(self, id: str, state: str) -> list[Deed]:
        before, self._job = self._job, (id, state)
        if before is None or before == self._job:
            return []
        ran = before[0] == id and before[1] in (*JOB_RUNNING, UNKNOWN)
        if state in JOB_ENDED:
            return [('job ends', {'job': id, 'state': state})]
        if state not in JOB_RUNNING:
            return []
        if not ran:
            return [('job begins', {'job': id})]
        changed = before[1] == UNKNOWN or (before[1] == PAUSED) != (state == PAUSED)
        return (
            [(f'job {"pauses" if state == PAUSED else "goes on"}', {'job': id})] if changed else []
        )

    def _of_lost(self, lost: dict[str, str]) -> list[Deed]:
        """A job whose node has died or hangs: told once."""
        before, self._job = self._job, (lost['id'], UNKNOWN)
        if before is None or before == self._job:
            return []
        return [('job ends', {'job': lost['id'], 'state': UNKNOWN, 'why': lost['why']})]

    def _of_arm(self, armed: bool) -> list[Deed]:
        before, self._armed = self._armed, armed
        if before is None or before == armed:
            return []
        return [('armed' if armed else 'disarmed', {})]
