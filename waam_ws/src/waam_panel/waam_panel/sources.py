"""Where every section of the page comes from, and whether it can still be believed. Pure; times are of a steady clock.

A section is stale when its topic has been silent for longer than it may be, or when the node behind it gives no sign of
life: a topic that only tells news stays silent for hours and is true as long as its node answers. Nodes tell once a
second that they live (`/diagnostics`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

ALIVE_S = 2.2  # s without a sign of life after which a node does not answer
GONE_S = 10.0  # s after which it is told as an alarm, and as the end of its job; a busy computer is no alarm


@dataclass(frozen=True)
class Source:
    """node: that publishes `topic`, '' = one of several; within: s between two messages at most, None = it only
    tells news."""

    node: str
    topic: str
    within: float | None = None


SOURCES = {
    'telemetry': Source('bridge', 'telemetry', 1.5),
    'machine': Source('bridge', 'machine_state', 2.2),
    'link': Source('bridge', 'link_status', 2.2),
    'standoff': Source('bridge', 'standoff', 3.0),
    'temperature': Source('', 'temperature', 2.2),  # of the simulated cell, bridge or pyrometer
    'heat': Source('thermal_compensator', 'heat_factor', 2.2),
    'process': Source('process_control', 'process_control', 3.0),
    'job': Source('job_sequencer', 'job_status'),
    'plan': Source('job_sequencer', 'layer_plan'),
    'height': Source('scan_fusion', 'height_map'),
    'correction': Source('correction_server', 'correction_map'),
    'viewer': Source('dashboard', '/diagnostics'),
}
PROGRAMS = (  # nodes of a cell whose silence is an alarm
    *dict.fromkeys(s.node for s in SOURCES.values() if s.node), 'cell', 'pyrometer', 'feed_forward', 'recorder',
)  # fmt: skip


class Sources:
    """When every section and every node was heard last."""

    def __init__(self) -> None:
        self._sections: dict[str, float] = {}
        self._nodes: dict[str, float] = {}

    def heard(self, section: str, now: float) -> None:
        """A message of this section has arrived."""
        self._sections[section] = now

    def lives(self, node: str, now: float) -> None:
        """A sign of life of a node."""
        self._nodes[node] = now

    def ages(self, now: float) -> dict[str, float]:
        """s since the newest message, of every section that ever came."""
        return {n: round(now - t, 1) for n, t in self._sections.items() if n in SOURCES}

    def silent(self, now: float, patience: float = ALIVE_S) -> dict[str, float]:
        """Nodes that were heard and give no sign of life: s of silence."""
        quiet = {n: now - t for n, t in self._nodes.items()}
        return {n: s for n, s in quiet.items() if s > patience}

    def stale(self, now: float) -> dict[str, str]:
        """Sections that cannot be believed: why."""
        found = {name: self._why(name, source, now) for name, source in SOURCES.items()}
        return {name: why for name, why in found.items() if why}

    def _why(self, name: str, source: Source, now: float) -> str:
        silence = now - self._nodes.get(source.node, math.nan)
        if silence > ALIVE_S:
            return f'{source.node} does not answer since {duration(silence)}'
        age = now - self._sections.get(name, -math.inf)
        if math.isinf(age):
            return f'nothing on {source.topic} yet'
        limit = source.within
        if limit is None and source.node not in self._nodes:
            limit = ALIVE_S
        if limit is not None and age > limit:
            return f'nothing on {source.topic} for {duration(age)}'
        return ''


def duration(seconds: float) -> str:
    """'12 s', '4 min', '2 h': how long something has been silent."""
    if seconds < 120:
        return f'{seconds:.0f} s'
    return f'{seconds / 60:.0f} min' if seconds < 7200 else f'{seconds / 3600:.0f} h'
