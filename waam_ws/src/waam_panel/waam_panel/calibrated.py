"""What the stored calibrations say against a job, and what of them the controller does not have: as `waam job run` and
`waam calibrate status` tell it. No ROS."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

from waam_calibrate import results, store

from .operations import Refused
from .state import PanelState

Ask = Callable[[], Awaitable[Mapping[str, float]]]  # the settings that the controller has; Refused

SLOT = 'calibration'  # of the condition, and its code
SETTLE_S = 3.0  # after a change: whoever stores a result tells the controller a moment later
AGAIN_S = 10.0  # while something is missing, or the controller did not say


async def check(folder: Path | None, ask: Ask) -> None:
    """Refused with every reason. Without a folder of results nothing is known of any."""
    if folder is None:
        return
    kept = await asyncio.to_thread(store.load_all, folder)
    told = await _told(ask) if any(r.settings for r in kept.results) else None
    if reasons := results.refusals(kept.results, kept.damaged, told):
        raise Refused(f'{"; ".join(reasons)} (waam calibrate status)')


async def _told(ask: Ask) -> Mapping[str, float] | None:
    """Settings that the controller has; None = it does not say."""
    try:
        return await ask()
    except Refused:
        return None


class Watch:
    """Asks the controller after each of its starts, and after each new result, whether it has what was found; what it
    has not is a condition in the list of alarms. Never beside a job."""

    def __init__(self) -> None:
        self._seen: tuple[int, int] | None = None  # start of the controller, change of the folder
        self._due = 0.0
        self._asking: asyncio.Task[None] | None = None

    def look(
        self, folder: Path | None, change: int, state: PanelState, ask: Ask, now: float, utc: float
    ) -> None:
        """Once a second, in the thread that serves; does not wait for an answer. change: of the folder, `changed`."""
        machine = state.sections.get('machine')
        if folder is None or not machine or not machine['connected']:
            return
        seen = machine['boot'], change
        if seen != self._seen:
            self._seen, self._due = seen, now + SETTLE_S
        busy = self._asking is not None and not self._asking.done()
        rests = machine['state'] in ('IDLE', 'ALARM') and not state.job_running
        if busy or not rests or now < self._due:
            return
        self._due = float('inf')
        self._asking = asyncio.create_task(self._compare(folder, state, ask, now, utc))

    async def _compare(
        self, folder: Path, state: PanelState, ask: Ask, now: float, utc: float
    ) -> None:
        kept = await asyncio.to_thread(store.load_all, folder)
        last = [r for r in results.newest(kept.results).values() if r.settings]
        told = await _told(ask) if last else {}
        lacks = results.missing(last, told or {})
        if lacks or told is None:
            self._due = min(self._due, now + AGAIN_S)
        alarms = state.alarms
        if lacks:
            severity = 2 if results.refusals(last, told=told) else 1
            alarms.set(SLOT, utc, 'condition', SLOT, severity, '; '.join(lacks))
        elif told is not None:
            alarms.clear(SLOT)


def changed(folder: Path) -> int:
    """When a result was added or removed; 0 without a folder."""
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return 0
