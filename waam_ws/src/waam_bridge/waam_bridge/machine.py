"""What batches, faults and standoff read and change: the machine as the host sees it. `core.Bridge` is one. Pure."""

from __future__ import annotations

from typing import Protocol

from waam_process.segment import Point

from .arming import Arming
from .link import Link
from .outbox import Outbox
from .params import BridgeParams
from .pending import Pending
from .program import Modal, Pace


class Machine(Protocol):
    """Attributes as in `core.Bridge`."""

    params: BridgeParams
    arming: Arming
    link: Link
    outbox: Outbox
    pending: Pending
    state: int
    fault: int
    fault_text: str
    held_because: str
    message: str
    pace: Pace
    offset: Point | None
    flags: int
    modal: Modal
    done: int
    generation: int
    broken: str
    dropping: str
    overrides: tuple[float, float]
    process: tuple[float, float]
    process_heard: float

    @property
    def connected(self) -> bool:
        """The controller may be used."""

    @property
    def armed_job(self) -> str:
        """The job that may use the arc, '' = none."""

    @property
    def silent(self) -> list[str]:
        """Required nodes whose heartbeat is late."""

    @property
    def queued(self) -> int:
        """Segments that were not executed."""

    @property
    def position(self) -> Point | None:
        """m, work frame; None before the first telemetry."""

    def say(self, message: str) -> None:
        """What machine_state shows as its message."""

    def notice(self, severity: int, class_name: str, text: str, reaction: str = 'none') -> None:
        """An anomaly to be published."""

    def forget(self) -> None:
        """Drops all lines that the controller has not executed."""

    def moved(self) -> None:
        """The machine moved, or its zero did, outside the program."""
