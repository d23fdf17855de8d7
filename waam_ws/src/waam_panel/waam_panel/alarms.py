"""Alarms: what each code means and what to do (alarms.yaml), and the list that operators acknowledge. No ROS."""

from __future__ import annotations

import itertools
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from waam_process.names import POWER_UP

KINDS = ('controller', 'job', 'anomaly', 'condition')
ENDED_BY_HAND = {('controller', str(POWER_UP))}  # nothing but a reset ends it
RUNNING, PAUSED, ENDED = 'running', 'paused', 'ended'  # what the job of an alarm does
GENERIC = ('105', '108', '109', '110')  # job codes that say less than what has led to them
CAUSES = ('controller', 'condition')  # kinds that may be over
KEPT = 200  # alarms in the list; the oldest acknowledged ones go first


@dataclass(frozen=True)
class Advice:
    """One line of the table: code -> cause -> action."""

    title: str
    cause: str
    action: str


@cache
def _data() -> dict[str, dict[str, dict[Any, Any]]]:
    return yaml.safe_load((Path(__file__).parent / 'alarms.yaml').read_text(encoding='utf-8'))


@cache
def table() -> dict[str, dict[str, Advice]]:
    """{kind: {code: Advice}} for `KINDS`; codes are text."""
    return {k: {str(code): Advice(**row) for code, row in _data()[k].items()} for k in KINDS}


@cache
def otherwise() -> dict[str, dict[str, dict[str, str]]]:
    """{paused, ended: {kind: {code: action}}}: what to do instead while the job waits, and when none runs."""
    return {
        state: {k: {str(c): text for c, text in rows.items()} for k, rows in _data()[state].items()}
        for state in (PAUSED, ENDED)
    }


def advice(kind: str, code: str | int) -> Advice:
    """Never fails: a code without a line says so."""
    unknown = Advice(
        f'Code {code}', 'This code is not in the table.', 'Note it for the maintainers.'
    )
    return table()[kind].get(str(code), unknown)


def markdown() -> str:
    """The whole table for doc/alarms.md."""
    rows = ['| code | what | cause | what to do |', '|---|---|---|---|']
    for kind in KINDS:
        rows += [
            f'| {kind} {code} | {a.title} | {a.cause} | {_actions(kind, code)} |'
            for code, a in table()[kind].items()
        ]
    return '\n'.join(rows)


def _actions(kind: str, code: str) -> str:
    said = [advice(kind, code).action]
    for state, words in ((PAUSED, 'While the job waits:'), (ENDED, 'When no job runs:')):
        if other := otherwise()[state].get(kind, {}).get(code):
            said.append(f'{words} {other}')
    return ' '.join(said)


@dataclass
class Alarm:
    """One entry of the list."""

    id: int
    time: float  # UTC, s
    kind: str
    code: str
    severity: int  # 1 warning, 2 fault, 3 alarm
    text: str
    active: bool  # its condition still holds
    acknowledged: bool = False
    count: int = 1
    job: int = 0  # number of the newest job when it came
    version: int = 0  # of the list, when it changed


class AlarmLog:
    """Conditions (`set`, `clear`) and events (`event`). `version` changes with every change.

    Alarms belong to the job that was the newest when they came. What is over and belongs to an earlier one is history:
    it stays in the list and in no banner.
    """

    def __init__(self, kept: int = KEPT) -> None:
        self._alarms: deque[Alarm] = deque()
        self._conditions: dict[str, Alarm] = {}
        self._numbers = itertools.count(1)
        self._kept = kept
        self._job, self._doing = 0, ENDED
        self.version = 0

    def __iter__(self) -> Iterator[Alarm]:
        """Newest first."""
        return reversed(self._alarms)

    def job(self, doing: str, begins: bool = True) -> None:
        """What the job does now: RUNNING, PAUSED, ENDED. What to do about its alarms may be another thing now. begins:
        False = one that was not ENDED may have begun long ago."""
        if doing == self._doing:
            return
        before = self._job
        self._job += begins and self._doing == ENDED
        self._doing = doing
        self.version += 1
        for alarm in self:  # what is said of these is another thing now
            if alarm.job == before:
                alarm.version = self.version

    def event(self, now: float, kind: str, code: str | int, severity: int, text: str) -> Alarm:
        """Something that happened. Repeated while not acknowledged, it is counted instead of listed again; a controller
        code that is in the list as a condition already is not listed twice."""
        alarm = self._find(kind, str(code), None if kind == 'controller' else text)
        if alarm is None:
            return self._add(now, kind, str(code), severity, text)
        if not alarm.active:
            alarm.count, alarm.time, alarm.text = alarm.count + 1, now, text
            alarm.job = self._job
        self._changed(alarm)
        return alarm

    def set(
        self, slot: str, now: float, kind: str, code: str | int, severity: int, text: str
    ) -> None:
        """The condition in this slot holds; another code in the same slot ends the one before."""
        present = self._conditions.get(slot)
        if present and (present.kind, present.code) == (kind, str(code)):
            if text and text != present.text:
                present.text, present.severity = text, max(present.severity, severity)
                self._changed(present)
            return
        self.clear(slot)
        alarm = self._find(kind, str(code), None)
        if alarm is None:
            alarm = self._add(now, kind, str(code), severity, text)
        elif not alarm.active and alarm.job != self._job:
            alarm.time, alarm.text = now, text
        alarm.active, alarm.severity = True, max(alarm.severity, severity)
        alarm.job = self._job
        self._changed(alarm)
        self._conditions[slot] = alarm

    def _changed(self, alarm: Alarm) -> None:
        self.version += 1
        alarm.version = self.version

    def _add(self, now: float, kind: str, code: str, severity: int, text: str) -> Alarm:
        alarm = Alarm(next(self._numbers), now, kind, code, severity, text, False, job=self._job)
        self._alarms.append(alarm)
        self._changed(alarm)
        self._forget()
        return alarm

    def _find(self, kind: str, code: str, text: str | None) -> Alarm | None:
        """One that is not acknowledged yet; text None = any."""
        for alarm in self:
            same = (alarm.kind, alarm.code) == (kind, code) and text in (None, alarm.text)
            if same and not alarm.acknowledged:
                return alarm
        return None

    def clear(self, slot: str) -> None:
        """The condition is over; its alarm stays in the list until it is acknowledged. An alarm that only a deliberate
        action ends is acknowledged by that action."""
        alarm = self._conditions.pop(slot, None)
        if alarm:
            alarm.active = False
            alarm.acknowledged |= (alarm.kind, alarm.code) in ENDED_BY_HAND
            self._changed(alarm)

    def acknowledge(self, number: int | None = None) -> int:
        """One alarm with the end of the job that it has caused, or all (None). Returns how many are new."""
        waiting = [a for a in self._alarms if not a.acknowledged]
        found = [a for a in waiting if number in (None, a.id, (c := self._cause(a)) and c.id)]
        for alarm in found:
            alarm.acknowledged = True
            self._changed(alarm)
        return len(found)

    def _forget(self) -> None:
        while len(self._alarms) > self._kept:
            done = next((a for a in self._alarms if a.acknowledged and not a.active), None)
            self._alarms.remove(done or self._alarms[0])

    # ---- what is shown

    def listing(self) -> list[dict[str, Any]]:
        """Newest first."""
        return [self.as_dict(a) for a in self]

    def changed(self, seen: dict[int, int], most: int) -> list[dict[str, Any]]:
        """At most `most` of those that a page does not have as they are: that of the banner, then the newest. seen:
        what it has, id -> version; brought up to date."""
        top = self.top()
        order = [*([top] if top else []), *(a for a in self if a is not top)]
        new = [a for a in order if seen.get(a.id) != a.version][:most]
        seen |= {a.id: a.version for a in new}
        for gone in seen.keys() - {a.id for a in order}:
            del seen[gone]
        return [self.as_dict(a) for a in new]

    def as_dict(self, alarm: Alarm) -> dict[str, Any]:
        """For the page: with title, cause, what to do now, and whether it is history."""
        doing = self._doing if alarm.job == self._job else ENDED
        said = asdict(advice(alarm.kind, alarm.code))
        said['action'] = (
            otherwise().get(doing, {}).get(alarm.kind, {}).get(alarm.code, said['action'])
        )
        return asdict(alarm) | said | {'history': not self._stands(alarm)}

    def _stands(self, alarm: Alarm) -> bool:
        return alarm.active or alarm.job == self._job

    def _cause(self, alarm: Alarm) -> Alarm | None:
        """Of the end of a job: the fault that has led to it, while it is not acknowledged."""
        if alarm.kind != 'job':
            return None
        named = re.findall(r'\bE([1-3]\d\d)\b', alarm.text)
        for other in self:
            same = other.job == alarm.job and not other.acknowledged
            if same and other.kind == 'controller' and other.code in named:
                return other
            if same and not named and alarm.code in GENERIC and other.kind in CAUSES:
                return other
        return None

    def top(self) -> Alarm | None:
        """For the banner: what holds before what is over, the most severe, the newest; a cause in place of its end of
        the job. None: nothing waits."""
        waiting = [a for a in self if not a.acknowledged and self._stands(a)]
        ends = {id(c): a for a in waiting if (c := self._cause(a))}

        def rank(a: Alarm) -> tuple[bool, int, float, int]:
            over = not a.active and a.kind in CAUSES and id(a) not in ends
            return (
                a.active,
                1 if over else a.severity,
                max(a.time, getattr(ends.get(id(a)), 'time', 0)),
                a.id,
            )

        return max((a for a in waiting if not self._cause(a)), key=rank, default=None)

    def worst(self) -> dict[str, Any] | None:
        """That of the banner, for other pages. None: there is none."""
        top = self.top()
        return self.as_dict(top) if top else None
