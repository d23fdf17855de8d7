"""The job that may use the arc, and the nodes that must be alive for it. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from . import frames
from .lease import Lease
from .lives import Lives

# us of controller time that a node is late; after the second the lease has ended the arc
LATE_US, LOST_US = 250_000, 500_000


class Arming:
    """`silent`: required nodes whose heartbeat is late, as last checked."""

    def __init__(self) -> None:
        self.lease = Lease()
        self.lives = Lives()
        self.job = ''
        self.silent: list[str] = []
        self._seen = False  # telemetry has shown it

    def arm(self, job: str, names: list[str], now_us: int, now: float) -> None:
        """The job may use the arc while the nodes `names` answer. now_us: controller time; now: s, steady clock."""
        self.job, self._seen = job, False
        self.lease.require(names, now_us, now)

    def disarm(self) -> None:
        """No job may use the arc, and no node is required any more."""
        self.job, self._seen, self.silent = '', False, []
        self.lease.require((), 0, 0.0)

    def restart(self, boot: int, known: bool) -> None:
        """A controller is connected (again). Unless it is the same one as before, it is not armed for our job."""
        self.lease.restart(boot)
        if not known:
            self.disarm()

    def flags(self, flags: int) -> bool:
        """Takes the flags of telemetry; True when the controller has disarmed by itself."""
        if flags & frames.ARMED:
            self._seen = True
        elif self._seen and self.job:
            self.disarm()
            return True
        return False

    def lease_us(self, t_us: int) -> int:
        """How far the arc lease may be renewed at controller time t_us, 0 = none."""
        return self.lease.seen_us(t_us) if self.job else 0

    def beat(
        self, node: str, tick_us: int, boot: int, t_us: int, now: float, source: str = ''
    ) -> bool:
        """Takes a heartbeat; True when it moves the lease of an armed job."""
        before = self.lease.seen_us(t_us)
        counts = self.lease.beat(node, tick_us, boot, t_us, now, source) and self.job
        return bool(counts) and self.lease.seen_us(t_us) > before

    def twice(self, names: Iterable[str], now: float, afresh: bool = False) -> str:
        """Which of these nodes live twice, and where; '' = none. Nobody can say which of the two answers. afresh: for a
        new job."""
        found = []
        for name in dict.fromkeys(names):
            places, publishers = self.lives.of(name, now), self.lease.twice(name, now, afresh)
            if len(places) > 1 or publishers:
                where = f'processes {", ".join(places)}; publishers {", ".join(publishers)}'
                found.append(f'two nodes called {name} ({where})')
        return '; '.join(found)

    def waits(self, t_us: int) -> bool:
        """A node that an armed job requires is late at controller time t_us, but not lost: simulated time should give
        it some of the wall clock's."""
        return bool(self.job) and LATE_US <= t_us - self.lease.seen_us(t_us) < LOST_US

    def check(self, t_us: int, now: float) -> list[str] | None:
        """Checks which nodes are silent: None when nothing changed, else the new names."""
        silent = self.lease.silent(t_us, now) if self.job else []
        return self._change(silent)

    def expired(self, t_us: int) -> None:
        """The controller ended the arc because of the lease: whoever is behind now has caused it."""
        self._change(self.lease.behind(t_us) if self.job else [])

    def _change(self, silent: list[str]) -> list[str] | None:
        if silent == self.silent:
            return None
        new = [n for n in silent if n not in self.silent]
        self.silent = silent
        return new
