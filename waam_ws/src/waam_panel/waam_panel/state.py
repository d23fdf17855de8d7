"""Everything the page shows, in the one thread that serves it. Arrays and plain values in, JSON-ready values out."""

from __future__ import annotations

import math
import re
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from waam_process.names import JOB_ENDED, JOB_RUNNING
from waam_process.unrolled import Unrolled

from . import alarms
from .sources import GONE_S, PROGRAMS, SOURCES, Sources, duration

SILENT_S = 1.5  # a node that is late for a moment is no alarm
JOB_NODE = SOURCES['job'].node
UNKNOWN = 'UNKNOWN'  # how a job ended whose node died
MINOR = ('dashboard', 'process_control')  # without them a job goes on
PAUSED = 200  # controller code of a hold that was asked for: a state, no alarm


@dataclass(frozen=True)
class Sample:
    """One telemetry frame; t in s of ROS time, the rest SI. wire_feed: what the wheel on it says, '' = nothing."""

    t: float
    position: tuple[float, float, float]
    current: float
    voltage: float
    feed_commanded: float
    feed: float
    speed: float
    state: str
    arc: bool
    arc_enabled: bool
    gas: bool
    speed_override: float
    wire_override: float
    lease_left: float
    wire_feed: str = ''


def rounded(value: float, digits: int) -> float | None:
    """None for NaN and infinity: JSON has neither."""
    return round(value, digits) if math.isfinite(value) else None


class PanelState:
    """`apply` what arrives; `frame` is what goes to a page. Times `now` are of the steady clock, `utc` of the day."""

    def __init__(self, kept: int) -> None:
        self.sections: dict[str, Any] = {'setup': None, 'programs': {}}
        self.alarms = alarms.AlarmLog()
        self.samples: deque[list[Any]] = deque(maxlen=kept)
        self.taken = 0  # samples since the start
        self.maps: dict[str, tuple[int, dict[str, Any]]] = {}
        self.scan: dict[str, Any] | None = None  # the newest height map
        self.shaft: Unrolled | None = None  # of the job, which turns; maps show it unrolled
        self.sources = Sources()
        self.lost_job: dict[str, str] | None = None  # id and why: its node gave up on it
        self._plan: dict[str, Any] | None = None
        self._silent_since = math.inf
        self.job_ends = 0

    # ---- what arrives

    def apply(self, name: str, value: Any, now: float, utc: float) -> None:
        """One converted message; see conversions.CONVERT for the names."""
        self.sources.heard(name, now)
        if name in ('diagnostics', 'telemetry'):  # these want the steady time
            getattr(self, f'_on_{name}')(value, now, utc)
            return
        handler = getattr(self, f'_on_{name}', None)
        if handler:
            handler(value, utc)
        else:
            self.sections[name] = value

    def _on_telemetry(self, s: Sample, now: float, _utc: float) -> None:
        s, machine = self._shown(s), [rounded(v * 1e3, 3) for v in s.position]
        mm = [rounded(v * 1e3, 3) for v in s.position]
        stale = self.stale(now)
        heat, temperature = (
            None if name in stale else self.sections.get(name) for name in ('heat', 'temperature')
        )
        commanded = self._commanded_speed(s)
        self.taken += 1
        self.samples.append([
            rounded(s.t, 3), rounded(s.current, 1), rounded(s.voltage, 2), rounded(s.feed_commanded * 60, 3),
            rounded(s.feed * 60, 3), commanded, rounded(s.speed * 1e3, 2), temperature and temperature['value'],
            heat and heat['limit'], *mm, int(s.arc),
        ])  # fmt: skip
        self.sections['telemetry'] = {
            't': rounded(s.t, 3), 'position': machine, 'place': mm, 'state': s.state,
            'arc': s.arc, 'arc_enabled': s.arc_enabled,
            'gas': s.gas, 'current': rounded(s.current, 1), 'voltage': rounded(s.voltage, 2),
            'feed': rounded(s.feed * 60, 2), 'feed_commanded': rounded(s.feed_commanded * 60, 2),
            'speed': rounded(s.speed * 1e3, 2), 'speed_commanded': commanded, 'lease_left': rounded(s.lease_left, 2),
            'speed_override': rounded(s.speed_override, 3), 'wire_override': rounded(s.wire_override, 3),
            'wire_feed': s.wire_feed,
        }  # fmt: skip

    def _shown(self, s: Sample) -> Sample:
        """Where the maps show the torch: over a shaft in its first turn."""
        if self.shaft is None:
            return s
        x, y, z = s.position
        return replace(s, position=(float(self.shaft.folded(x)), y, z))

    def _commanded_speed(self, s: Sample) -> float | None:
        """mm/s of the planned segment nearest to the torch, times the override; None without arc."""
        plan = self._plan
        if not s.arc or plan is None or not len(plan['speed']):
            return None
        at = np.array(s.position[:2])
        along = plan['end'] - plan['start']
        share = ((at - plan['start']) * along).sum(1) / np.maximum((along**2).sum(1), 1e-18)
        nearest = plan['start'] + np.clip(share, 0, 1)[:, None] * along - at
        speed = float(plan['speed'][int((nearest**2).sum(1).argmin())])
        return rounded(speed * 1e3 * (s.speed_override or 1.0), 2)

    def _on_machine(self, m: dict[str, Any], utc: float) -> None:
        self.sections['machine'] = m
        log = self.alarms
        if not m['connected']:
            log.set('link', utc, 'condition', 'disconnected', 3, m['message'])
        else:
            log.clear('link')
        self._silent_since = min(self._silent_since, utc) if m['silent'] else math.inf
        if m['silent'] and utc - self._silent_since >= SILENT_S:
            text = f'silent: {", ".join(m["silent"])}'
            log.set('silent', utc, 'condition', 'silent', 3, text)
        elif not m['silent']:
            log.clear('silent')
        self._machine_fault(m, utc)

    def _machine_fault(self, m: dict[str, Any], utc: float) -> None:
        severity = 3 if m['state'] == 'ALARM' else 2
        stopped = m['connected'] and m['state'] in ('HOLD', 'ALARM') and m['fault'] != PAUSED
        if stopped and m['fault']:
            self.alarms.set('fault', utc, 'controller', m['fault'], severity, m['fault_text'])
        elif stopped:
            code = m['state'].lower()
            self.alarms.set('fault', utc, 'condition', code, severity, m['message'])
        else:
            self.alarms.clear('fault')

    def _on_job(self, j: dict[str, Any], utc: float) -> None:
        before = self.sections.get('job')
        self.sections['job'] = j
        runs = j['state'] in JOB_RUNNING
        if runs or (self.lost_job and self.lost_job['id'] == j.get('id')):
            self.lost_job = None
        if before and before['state'] in JOB_RUNNING and j['state'] == 'IDLE':
            self._lose(before)  # a job_sequencer that was started again knows nothing of it
        doing = alarms.PAUSED if j['state'] == 'PAUSED' else alarms.RUNNING
        self.alarms.job(doing if runs else alarms.ENDED, begins=before is not None)
        ended = j['state'] in JOB_ENDED
        if ended and before and before['state'] != j['state']:
            self.job_ends += 1
            if j['error_code']:
                severity = 1 if j['error_code'] == 111 else 2
                self.alarms.event(utc, 'job', j['error_code'], severity, j['message'])

    def _on_anomaly(self, a: dict[str, Any], utc: float) -> None:
        # the controller's words: its line says more
        code = re.search(r'\bE([1-3]\d\d)\b', a['text'])
        if code and int(code[1]) != PAUSED:
            self.alarms.event(utc, 'controller', code[1], min(a['severity'], 2), a['text'])
        elif a['severity'] >= 1 and not code:
            self.alarms.event(utc, 'anomaly', a['class'], a['severity'], a['text'])

    def _on_diagnostics(self, rows: list[dict[str, Any]], now: float, utc: float) -> None:
        for row in rows:
            self.sources.lives(row['node'], now)
            before = self.sections['programs'].get(row['node'], {})
            if row['restarted'] and row['restarted'] != before.get('restarted'):
                self.alarms.event(utc, 'condition', 'restarted', 1, row['restarted'])
            self.sections['programs'][row['node']] = row
            if row['node'] == 'dashboard':
                self.sources.heard('viewer', now)
                self.sections['viewer'] = row['viewer'] if row['viewer'].startswith('http') else ''

    def _on_plan(self, p: dict[str, Any], _utc: float) -> None:
        self.put_map('path', p['path'])
        if len(p['speed']):
            self._plan = p

    def _on_height(self, h: dict[str, Any], _utc: float) -> None:
        self.scan = h
        if h['width']:
            self.sections['width'] = h['width']
        self.put_map('height', h['picture'])

    def _on_correction(self, c: dict[str, Any], _utc: float) -> None:
        self.sections['width_ratio'] = c['width_ratio']
        self.put_map('psi', c['psi'])

    def put_map(self, name: str, picture: dict[str, Any]) -> None:
        """A new picture under a name; pages fetch it when its version has changed."""
        self.maps[name] = (self.maps.get(name, (0, {}))[0] + 1, picture)

    # ---- what is shown

    @property
    def job_running(self) -> bool:
        """By the state of the newest job_status."""
        return (self.sections.get('job') or {}).get('state') in JOB_RUNNING

    def stale(self, now: float) -> dict[str, str]:
        """Sections that cannot be believed: why."""
        return self.sources.stale(now)

    def look(self, now: float, utc: float) -> None:
        """Call some times a second: silent nodes become an alarm; a job whose node is gone has ended unknown."""
        silent = self.sources.silent(now, GONE_S)
        gone = [n for n in PROGRAMS if n in silent]
        if gone:
            severity = 1 if all(n in MINOR for n in gone) else 3
            text = f'no answer from {", ".join(gone)}'
            self.alarms.set('gone', utc, 'condition', 'gone', severity, text)
        else:
            self.alarms.clear('gone')
        if JOB_NODE in gone and self.job_running and self.lost_job is None:
            self._lose(self.sections['job'])

    def _lose(self, job: dict[str, Any]) -> None:
        """Nobody can say any more how this job ended."""
        why = f'ended unknown: {JOB_NODE} died or hangs'
        self.lost_job = {'id': str(job.get('id') or ''), 'why': why}

    def _programs(self, now: float) -> dict[str, dict[str, Any]]:
        """What the nodes say of themselves; one that is silent says nothing any more."""
        rows: dict[str, dict[str, Any]] = dict(self.sections['programs'])
        for node, seconds in self.sources.silent(now).items():
            gone = f'gone: does not answer since {duration(seconds)}'
            rows[node] = rows[node] | {'level': 2, 'message': gone, 'gone': True}
        return rows

    def frame(self, now: float, since: int) -> dict[str, Any]:
        """Sections, why some are not to be believed, ages, samples after number `since`. running: None = not known."""
        new = min(self.taken - since, len(self.samples))
        stale = self.stale(now)
        return {
            'sections': self.sections
            | {'programs': self._programs(now), 'lost_job': self.lost_job},
            'running': None if 'job' in stale and self.job_running else self.job_running,
            'stale': stale,
            'ages': self.sources.ages(now),
            'samples': [self.samples[i] for i in range(len(self.samples) - new, len(self.samples))],
            'maps': {n: v for n, (v, _) in self.maps.items()},
            'job_ends': self.job_ends,
        }

    def history(self, before: int, most: int) -> tuple[int, list[list[Any]]]:
        """At most `most` samples before number `before`, the oldest first, and the number of the first of them."""
        first = max(before - most, self.taken - len(self.samples))
        offset = len(self.samples) - self.taken
        return first, [self.samples[i] for i in range(first + offset, before + offset)]
