"""Which nodes are alive: the arc lease is renewed up to the smallest tick that all required nodes repeated. Pure.

A tick counts for a node only from the publisher that is bound to its name. Of two publishers by one name none counts.
"""

from __future__ import annotations

# A node is named after so long without a heartbeat on both clocks, for simulated time may run fast:
SILENT_US = 300_000  # us of controller time
SILENT_WALL = 0.15  # s of wall time
SECOND_S = 2.0  # s of wall time that a second publisher by a name is remembered


class Lease:
    """Ticks of the nodes. Every node that answers is remembered, so it counts as soon as it is required."""

    def __init__(self) -> None:
        self.required: tuple[str, ...] = ()
        self._boot = 0
        self._ticks: dict[str, int] = {}
        self._heard: dict[str, float] = {}  # s, steady clock
        self._since = (0, 0.0)  # us, s: when they were required
        self._bound: dict[str, str] = {}  # publisher of each required node since it was required
        self._sources: dict[
            str, dict[str, float]
        ] = {}  # publishers by name, and when they were heard

    def restart(self, boot: int) -> None:
        """Another boot of the controller: its clock restarts, old ticks are void."""
        if boot != self._boot:
            self._ticks.clear()
            self._heard.clear()
            self._boot = boot

    def require(self, names: list[str] | tuple[str, ...], now_us: int, now: float) -> None:
        """The nodes that must answer from now on (us of controller time, s of the steady clock); none = the bridge
        alone."""
        self.required = tuple(dict.fromkeys(names))
        self._since = (now_us, now)
        self._bound.clear()

    def beat(
        self, node: str, tick_us: int, boot: int, now_us: int, now: float, source: str = ''
    ) -> bool:
        """A heartbeat; True when it may move the lease. Ticks of another boot or from the future are not believed, nor
        are those of a name that two publishers use. source: of the publisher, the same as long as it lives."""
        if boot != self._boot or tick_us > now_us or not self._believed(node, source, now):
            return False
        if tick_us > self._ticks.get(node, 0):
            self._ticks[node] = tick_us
            self._heard[node] = now
            return node in self.required
        return False

    def _believed(self, node: str, source: str, now: float) -> bool:
        self._sources.setdefault(node, {})[source] = now
        if node in self.required and self._bound.setdefault(node, source) != source:
            return False
        return not self.twice(node, now)

    def twice(self, node: str, now: float, afresh: bool = False) -> list[str]:
        """The publishers that call themselves `node`, when there are two or more. now: s, steady clock; afresh: for a
        new job, to which the publisher of the one before means nothing: it died, and its successor has its name."""
        heard = self._sources.get(node, {})
        here = {s for s, at in heard.items() if now - at <= SECOND_S}
        bound = None if afresh else self._bound.get(node)  # it may be the one that is dead
        if bound is not None and here - {bound}:
            here.add(bound)
        self._sources[node] = {s: heard[s] for s in here if s in heard}
        return sorted(here) if len(here) > 1 else []

    def seen_us(self, now_us: int) -> int:
        """The smallest tick among the required nodes; with none required, the bridge's own time."""
        return min((self._ticks.get(n, 0) for n in self.required), default=now_us)

    def behind(self, now_us: int) -> list[str]:
        """Required nodes whose last tick is older than 300 ms of controller time, in the order of ARM."""
        return [n for n in self.required if now_us - self._ticks.get(n, 0) > SILENT_US]

    def silent(self, now_us: int, now: float) -> list[str]:
        """Those behind that also had the time to answer since they were required, on both clocks."""
        since_us, since = self._since
        if now_us - since_us <= SILENT_US:
            return []
        heard = self._heard
        behind = self.behind(now_us)
        return [n for n in behind if now - max(heard.get(n, 0.0), since) > SILENT_WALL]
