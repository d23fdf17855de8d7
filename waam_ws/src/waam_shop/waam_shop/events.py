"""What people want to be told of: found in what a panel sees. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from waam_process.verdicts import DOES_NOT_CLEAN_UP, REJECTED

DONE, PAUSED, ALARM = 'done', 'paused', 'alarm'
OUT_OF_TOLERANCE, LOW_WIRE, TEST = 'out_of_tolerance', 'low_wire', 'test'
KINDS = (DONE, PAUSED, ALARM, OUT_OF_TOLERANCE, LOW_WIRE)
SEVERE = 2  # alarms from this severity on: fault, alarm
ENDED = {'DONE': 'done', 'FAILED': 'failed', 'ABORTED': 'aborted'}


@dataclass(frozen=True)
class Event:
    """kind: one of KINDS; about: what it repeats for (a job, an alarm); text: for a person."""

    kind: str
    about: str
    text: str


class Watch:
    """Call the methods with what arrives; each returns the events that are new. What was there at the start is old."""

    def __init__(self) -> None:
        self._job: tuple[str, str] | None = None
        self._alarms: dict[int, int] | None = None
        self._judged: set[str] = set()
        self._low: set[str] = set()

    def job(self, id: str, state: str, message: str) -> list[Event]:
        """A job_status: tells of the end of a job and of a pause."""
        before, self._job = self._job, (id, state)
        if before is None or before == self._job:
            return []
        if state == 'PAUSED':
            return [Event(PAUSED, id, f'{id} is paused. {message}'.strip())]
        if state in ENDED and (before[0] == id or not before[0]):
            return [Event(DONE, id, f'{id}: {ENDED[state]}. {message}'.strip())]
        return []

    def alarms(self, listing: Iterable[Mapping[str, Any]]) -> list[Event]:
        """The list of alarms: tells of new ones from SEVERE on."""
        now = {a['id']: a for a in listing if a['severity'] >= SEVERE and not a['acknowledged']}
        before, self._alarms = self._alarms, {n: a['count'] for n, a in now.items()}
        if before is None:
            return []
        new = [a for n, a in now.items() if before.get(n, 0) < a['count']]
        return [Event(ALARM, f'{a["kind"]} {a["code"]}', _alarm_text(a)) for a in new]

    def verdict(self, job: str, verdict: str) -> list[Event]:
        """The verdict of a job that has ended: tells of each once."""
        if not verdict or job in self._judged:
            return []
        self._judged.add(job)
        if verdict not in REJECTED:
            return []
        said = verdict if verdict == DOES_NOT_CLEAN_UP else f'is {verdict}'
        return [Event(OUT_OF_TOLERANCE, job, f'{job} {said}.')]

    def wire(self, spool: str, left: float, warn_below: float) -> list[Event]:
        """left, warn_below: m of wire; tells once for each spool (job) that runs low."""
        if not left < warn_below or spool in self._low:
            return []
        self._low.add(spool)
        return [Event(LOW_WIRE, spool, f'{left:.0f} m of wire are left on the spool.')]


def _alarm_text(alarm: Mapping[str, Any]) -> str:
    title = str(alarm.get('title') or f'{alarm["kind"]} {alarm["code"]}')
    return f'{title}. {alarm["text"]}'.strip()
