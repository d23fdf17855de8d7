"""What the helpers of the core read and change: the machine as the host sees it. `core.Bridge` is one. Pure."""

from __future__ import annotations

from typing import Protocol

from waam_process.segment import Point

from .arming import Arming
from .link import Link
from .outbox import Outbox
from .params import BridgeParams
from .pending import Pending
from .program import Modal


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
    message: str
    offset: Point | None
    flags: int
    modal: Modal
    done: int
    generation: int
    broken: str
    dropping: str

    @property
    def connected(self) -> bool: ...

    @property
    def armed_job(self) -> str: ...

    @property
    def silent(self) -> list[str]: ...

    @property
    def queued(self) -> int: ...

    @property
    def position(self) -> Point | None: ...

    def say(self, message: str) -> None: ...

    def notice(self, severity: int, class_name: str, text: str, reaction: str = 'none') -> None: ...

    def forget(self) -> None: ...

    def moved(self) -> None: ...
