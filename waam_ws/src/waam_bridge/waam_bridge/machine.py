"""The machine as the host sees it: what batches, faults, overrides and standoff read and change. Pure."""

from __future__ import annotations

from collections.abc import Callable

from waam_process.segment import Point

from .arming import Arming
from .frames import IDLE
from .link import Link
from .outbox import Notice, Outbox
from .params import CommonParams
from .pending import Pending
from .program import Mark, Modal, Pace, as_programmed


class Machine:
    """State, and what every part may do with it. `core.Bridge` is one."""

    def __init__(self, params: CommonParams, on_ready: Callable[[bool, bool, float], None]) -> None:
        self.params = params
        self.arming = Arming()
        self.link = Link(params, self.arming.lease_us, on_ready)
        self.outbox = Outbox(changed=True)
        self.state, self.fault, self.fault_text = IDLE, 0, ''
        # why this end holds the controller, '' = it does not, or an operator does
        self.held_because = ''
        self.message = 'not connected'
        self.pace: Pace = as_programmed  # what the machine makes of the speeds of segments
        self.offset: Point | None = None  # m, work zero in machine coordinates
        self.flags = 0
        self.modal = Modal()
        self.done = -1  # last executed index of modal.job
        self.generation = 0  # of the chain of segments: permits of an older one are void
        self.broken = ''  # why the program cannot go on
        self.dropping = ''  # why the queue is dropped once telemetry has shown what was executed
        self.overrides = (1.0, 1.0)  # speed, wire: the operator's factors
        self.process = (1.0, 1.0)  # the same of a process control, which multiply them
        self.process_heard = 0.0  # s, steady clock
        self.pending = Pending()

    @property
    def connected(self) -> bool:
        """The controller has identified itself and may be used."""
        return self.link.ready

    @property
    def armed_job(self) -> str:
        """The job that may use the arc, '' = none."""
        return self.arming.job

    @property
    def silent(self) -> list[str]:
        """Required nodes whose heartbeat is late."""
        return self.arming.silent

    @property
    def job(self) -> str:
        """The armed job, or else the one whose segments came last; '' = none."""
        return self.armed_job or self.modal.job

    @property
    def queued(self) -> int:
        """Segments that were not executed."""
        return self.link.sender.marks

    @property
    def running(self) -> Mark | None:
        """The oldest segment that was not executed."""
        return self.link.sender.oldest_mark

    @property
    def position(self) -> Point | None:
        """m, work frame."""
        t = self.link.telemetry
        return (t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6) if t else None

    def take_outbox(self) -> Outbox:
        """Hands over what is to be published and starts a new box."""
        box, self.outbox = self.outbox, Outbox()
        return box

    def notice(self, severity: int, class_name: str, text: str, reaction: str = 'none') -> None:
        """An anomaly to be published; severity: one of `outbox`, class_name and reaction as in Anomaly.msg."""
        self.outbox.notices.append(Notice(severity, class_name, text, reaction))

    def say(self, message: str) -> None:
        """What machine_state shows as its message."""
        if message != self.message:
            self.message = message
            self.outbox.changed = True

    def forget(self) -> None:
        """All lines that the controller has not executed; what comes next starts where the machine is."""
        self.dropping = ''
        self.link.sender.drop()
        self.link.resync()
        self.reopen()

    def reopen(self) -> None:
        """The next segment starts from where the machine is, and repeats all modal words: for the machine moved, or its
        zero did, outside the program."""
        self.modal = Modal(job=self.modal.job)
        self.generation += 1
