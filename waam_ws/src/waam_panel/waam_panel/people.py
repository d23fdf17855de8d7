"""Whom a panel tells of what: looks at the state once a second, reads what a job has written. No ROS."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from waam_node import job_folder
from waam_process.names import JOB_RUNNING
from waam_shop.events import DONE, Event, Watch
from waam_shop.notifier import Notifier

from .history import facts_of
from .state import PanelState

REPORT_S = 600.0  # how long the report of an ended job is waited for


class People:
    """Call `look` once a second; it blocks for the length of some small reads."""

    def __init__(self, notifier: Notifier) -> None:
        self._notifier = notifier
        self._watch = Watch()
        self._unjudged: dict[str, tuple[Path, float]] = {}  # ended jobs: folder, until when

    def look(self, state: PanelState) -> list[Event]:
        """What is new; people are told."""
        events = self._watch.alarms(state.alarms.listing())
        job = state.sections.get('job')
        if job:
            events += self._job(job)
        events += self._verdicts()
        for event in events:
            self._notifier.tell(event)
        return events

    def _job(self, job: dict[str, Any]) -> list[Event]:
        id, state, folder = str(job.get('id') or ''), job['state'], Path(job.get('dir') or '.')
        events = self._watch.job(id, state, str(job.get('message') or ''))
        if any(e.kind == DONE for e in events):
            self._unjudged[id] = (folder, time.monotonic() + REPORT_S)
        if id and state in JOB_RUNNING:
            events += self._wire(id, folder)
        return events

    def _verdicts(self) -> list[Event]:
        """Of jobs that have just ended, as soon as their report is there."""
        events: list[Event] = []
        for job, (folder, until) in list(self._unjudged.items()):
            verdict = str(facts_of(folder / job_folder.REPORT).get('verdict') or '')
            events += self._watch.verdict(job, verdict)
            if verdict or time.monotonic() > until:
                del self._unjudged[job]
        return events

    def _wire(self, job: str, folder: Path) -> list[Event]:
        """By what the job has written after its last layer; nothing when the length on the spool is not known."""
        left = facts_of(folder / job_folder.RECORDS).get('spool')
        if not isinstance(left, int | float) or isinstance(left, bool):
            return []
        return self._watch.wire(job, float(left), self._notifier.settings.wire_m)
