"""Alarms: what each code means and what to do (alarms.yaml), and the list that operators acknowledge. No ROS."""

from __future__ import annotations

import itertools
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
KEPT = 200  # alarms in the list; the oldest acknowledged ones go first


@dataclass(frozen=True)
class Advice:
    """One line of the table: code -> cause -> action."""

    title: str
    cause: str
    action: str


@cache
def table() -> dict[str, dict[str, Advice]]:
    """{kind: {code: Advice}} for `KINDS`; codes are text."""
    data = yaml.safe_load((Path(__file__).parent / 'alarms.yaml').read_text(encoding='utf-8'))
    return {k: {str(code): Advice(**row) for code, row in data[k].items()} for k in KINDS}


def advice(kind: str, code: str | int) -> Advice:
    """Never fails: a code without a line says so."""
    unknown = Advice(
        f'Code {code}', 'This code is not in the table.', 'Note it for the maintainers.'
    )
    return table()[kind].get(str(code), unknown)


def markdown() -> str:
    """The whole table for docs/panel.md."""
    rows = ['| code | what | cause | what to do |', '|---|---|---|---|']
    for kind in KINDS:
        rows += [
            f'| {kind} {code} | {a.title} | {a.cause} | {a.action} |'
            for code, a in table()[kind].items()
        ]
    return '\n'.join(rows)


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

    def as_dict(self) -> dict[str, Any]:
        """For the page: with title, cause and action."""
        return {**asdict(self), **asdict(advice(self.kind, self.code))}


class AlarmLog:
    """Conditions (`set`, `clear`) and events (`event`). `version` changes with every change."""

    def __init__(self, kept: int = KEPT) -> None:
        self._alarms: deque[Alarm] = deque()
        self._conditions: dict[str, Alarm] = {}
        self._numbers = itertools.count(1)
        self._kept = kept
        self.version = 0

    def __iter__(self) -> Iterator[Alarm]:
        """Newest first."""
        return reversed(self._alarms)

    def event(self, now: float, kind: str, code: str | int, severity: int, text: str) -> Alarm:
        """Something that happened. Repeated while not acknowledged, it is counted instead of listed again; a controller
        code that is in the list as a condition already is not listed twice."""
        self.version += 1
        alarm = self._find(kind, str(code), None if kind == 'controller' else text)
        if alarm:
            if not alarm.active:
                alarm.count, alarm.time = alarm.count + 1, now
            return alarm
        return self._add(now, kind, str(code), severity, text)

    def set(
        self, slot: str, now: float, kind: str, code: str | int, severity: int, text: str
    ) -> None:
        """The condition in this slot holds; another code in the same slot ends the one before."""
        present = self._conditions.get(slot)
        if present and (present.kind, present.code) == (kind, str(code)):
            if text and text != present.text:
                present.text, self.version = text, self.version + 1
            return
        self.clear(slot)
        self.version += 1
        alarm = self._find(kind, str(code), None)
        if alarm is None:
            alarm = self._add(now, kind, str(code), severity, text)
        alarm.active, alarm.severity = True, max(alarm.severity, severity)
        self._conditions[slot] = alarm

    def _add(self, now: float, kind: str, code: str, severity: int, text: str) -> Alarm:
        alarm = Alarm(next(self._numbers), now, kind, code, severity, text, active=False)
        self._alarms.append(alarm)
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
            self.version += 1

    def acknowledge(self, number: int | None = None) -> int:
        """One alarm, or all (None). Returns how many were newly acknowledged."""
        found = [a for a in self._alarms if number in (None, a.id) and not a.acknowledged]
        for alarm in found:
            alarm.acknowledged = True
        self.version += bool(found)
        return len(found)

    def _forget(self) -> None:
        while len(self._alarms) > self._kept:
            done = next((a for a in self._alarms if a.acknowledged and not a.active), None)
            self._alarms.remove(done or self._alarms[0])

    def listing(self) -> list[dict[str, Any]]:
        """Newest first."""
        return [a.as_dict() for a in self]

    def worst(self) -> dict[str, Any] | None:
        """Of those that nobody has acknowledged: the most severe, the newest of several. None: there is none."""
        waiting = [a for a in self if not a.acknowledged]
        return max(waiting, key=lambda a: a.severity).as_dict() if waiting else None
