"""What the core has to publish, and how faults are classed. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from waam_process.names import CLASS_OF_FAULT, CONTROLLER_STATES, POWER_UP

from .frames import ALARM, PartTemperature, Standoff
from .program import Mark
from .stream import Sender

INFO, WARNING, FAULT, ALARM_SEVERITY = range(4)  # waam_msgs/Anomaly
HOLD_BY_HOST, LEASE_EXPIRED = 200, 202
CLASS_OF = {
    **CLASS_OF_FAULT,
    HOLD_BY_HOST: 'operator',
    LEASE_EXPIRED: 'node',
    POWER_UP: 'operator',
}  # all others: 'link'
RESEND_WINDOW = 10.0  # s
RESEND_SHARE = 0.05  # of the lines, that is worth a warning
RESEND_LEAST = 5  # lines sent again in the window below which no rate is judged


@dataclass(frozen=True)
class Notice:
    """Goes out as waam_msgs/Anomaly."""

    severity: int
    class_name: str
    text: str
    reaction: str = 'none'


@dataclass(frozen=True)
class Batch:
    """values (n, 3) m/s^2 along the axes of the machine, t_us: controller time of the first; sequence: a gap is a loss;
    rate: samples per second of the controller's clock."""

    sequence: int
    t_us: int
    rate: float
    values: np.ndarray


@dataclass
class Outbox:
    """What the owner has to publish, in this order."""

    standoff: list[Standoff] = field(default_factory=list)
    temperatures: list[PartTemperature] = field(default_factory=list)
    accelerations: list[Batch] = field(default_factory=list)
    done: list[Mark] = field(default_factory=list)
    changed: bool = False  # machine state
    notices: list[Notice] = field(default_factory=list)
    tick_us: int | None = None
    replies: list[Callable[[], None]] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(
            self.changed
            or self.standoff
            or self.temperatures
            or self.accelerations
            or self.done
            or self.notices
            or self.replies
            or self.tick_us is not None
        )


def of_fault(state: int, code: int, text: str, silent: list[str]) -> Notice:
    """The notice of a controller that went to HOLD or ALARM. `silent`: nodes without heartbeat."""
    said = f'{CONTROLLER_STATES[state]} E{code} {text}'.rstrip()
    if code == LEASE_EXPIRED and silent:
        said += f' (silent: {", ".join(silent)})'
    class_name = CLASS_OF.get(code, 'link')
    if code == POWER_UP:
        return Notice(INFO, class_name, said)
    if state == ALARM:
        return Notice(ALARM_SEVERITY, class_name, said, 'abort')
    return Notice(INFO if code == HOLD_BY_HOST else FAULT, class_name, said, 'hold')


class ResendWatch:
    """Warns when too large a share of the lines had to be sent again within 10 s."""

    def __init__(self) -> None:
        self._since, self._sent, self._again = 0.0, 0, 0

    def poll(self, sender: Sender, now: float) -> Notice | None:
        """A warning at the end of a window in which too many lines were repeated, else None. now: s, steady clock."""
        if now - self._since < RESEND_WINDOW:
            return None
        sent, again = sender.lines_sent - self._sent, sender.resends - self._again
        self._since, self._sent, self._again = now, sender.lines_sent, sender.resends
        if again < RESEND_LEAST or again <= RESEND_SHARE * sent:
            return None
        text = f'{again} of {sent} lines were sent again within {RESEND_WINDOW:g} s'
        return Notice(WARNING, 'link', text, 'retry')
