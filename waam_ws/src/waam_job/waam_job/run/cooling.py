"""The interpass wait: no layer begins on metal that is too hot, or whose temperature nobody knows."""

from __future__ import annotations

import math

from ..model.cell import Heat
from ..model.goal import Code, JobError
from .context import JobContext


class Cooling:
    """Waits before every layer. Notes once when the layers do not change the temperature."""

    def __init__(self, context: JobContext) -> None:
        self.cell, self.watch = context.cell, context.watch
        self.journal, self.settings = context.journal, context.settings
        self._doubt_noted = False

    def wait(self, layer: int) -> tuple[float, float]:
        """Waits for the interpass limit before `layer`. Returns the seconds waited and the temperature (degC).

        JobError when the pyrometer gives nothing plausible for `pyrometer_patience`, when it stays too hot for
        `cooling_timeout`, or when the temperature does not answer to the layers and the cell is a real one.
        """
        waited, heat = self._until_ready()
        if layer > 1 and not heat.believed:
            self._doubt(layer, heat)
        return waited, heat.temperature

    def _until_ready(self) -> tuple[float, Heat]:
        started, held = self.cell.now(), self.watch.held
        doubtful_since: float | None = None
        while True:
            self.watch.tick()
            heat, now = self.cell.heat(), self.cell.now()
            if heat.plausible:
                doubtful_since = None
                if heat.ready:
                    return now - started, heat
                wait = f'{heat.wait:.0f} s to go' if math.isfinite(heat.wait) else 'waiting'
                self.journal.say(
                    f'cooling: {heat.temperature:.0f} C, limit {heat.limit:.0f} C, {wait}'
                )
            else:
                doubtful_since = doubtful_since or now
                if now - doubtful_since > self.settings.pyrometer_patience:
                    raise self._ended(
                        f'temperature is not believed: {"; ".join(heat.reasons) or "no reason given"}',
                        Code.MACHINE_NOT_READY,
                    )
            if now - started - (self.watch.held - held) > self.settings.cooling_timeout:
                raise self._ended(
                    f'not below {heat.limit:.0f} C after {now - started:.0f} s', Code.TIMEOUT
                )

    def _doubt(self, layer: int, heat: Heat) -> None:
        """The temperature does not answer to what is laid: the pyrometer probably looks beside the part."""
        text = (
            f'before layer {layer}: temperature is not believed: {heat.doubt or "no reason given"}'
        )
        if not (self.settings.simulated or self.settings.allow_unbelieved_temperature):
            told = 'aim the pyrometer at the part, or set allow_unbelieved_temperature'
            raise self._ended(f'{text} ({told})', Code.MACHINE_NOT_READY)
        if not self._doubt_noted:
            self._doubt_noted = True
            self.journal.note('WARNING', 'temperature', text, 'interpass waits may be too short')

    def _ended(self, text: str, code: Code) -> JobError:
        self.journal.note('FAULT', 'temperature', text, 'job ended before the layer')
        return JobError(code, text)
