"""The interpass wait: no layer begins on metal that is too hot, or whose temperature nobody knows."""

from __future__ import annotations

import math

from ..model.cell import Cell, Heat
from ..model.goal import Code, JobError
from ..store.journal import Journal
from .settings import Settings
from .watch import Watch


def wait_for_interpass(
    cell: Cell, watch: Watch, journal: Journal, settings: Settings
) -> tuple[float, float]:
    """Waits for the interpass limit. Returns the seconds waited and the temperature (degrees Celsius).

    JobError when the pyrometer is not believed for `pyrometer_patience` or it stays too hot for `cooling_timeout`.
    """
    started, held = cell.now(), watch.held
    doubtful_since: float | None = None
    while True:
        watch.tick()
        heat, now = cell.heat(), cell.now()
        if heat.plausible:
            doubtful_since = None
            if heat.ready:
                return now - started, heat.temperature
            wait = f'{heat.wait:.0f} s to go' if math.isfinite(heat.wait) else 'waiting'
            journal.say(f'cooling: {heat.temperature:.0f} C, limit {heat.limit:.0f} C, {wait}')
        else:
            doubtful_since = doubtful_since or now
            if now - doubtful_since > settings.pyrometer_patience:
                raise _not_believed(journal, heat)
        if now - started - (watch.held - held) > settings.cooling_timeout:
            text = f'not below {heat.limit:.0f} C after {now - started:.0f} s'
            journal.note('FAULT', 'temperature', text, 'job ended before the layer')
            raise JobError(Code.TIMEOUT, text)


def _not_believed(journal: Journal, heat: Heat) -> JobError:
    text = f'temperature is not believed: {"; ".join(heat.reasons) or "no reason given"}'
    journal.note('FAULT', 'temperature', text, 'job ended before the layer')
    return JobError(Code.MACHINE_NOT_READY, text)
