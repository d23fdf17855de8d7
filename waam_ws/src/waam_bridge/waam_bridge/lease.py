"""Who still lives: the arc lease is renewed up to the smallest tick that all required nodes have repeated. Pure."""

from __future__ import annotations

SILENT_US = 300_000  # us of controller time without a heartbeat after which a node is named


class Lease:
    """Ticks of the nodes. All that answer are remembered, so one that lives already counts once it is required."""

    def __init__(self) -> None:
        self.required: tuple[str, ...] = ()
        self._boot = 0
        self._ticks: dict[str, int] = {}

    def restart(self, boot: int) -> None:
        """Another boot of the controller: its clock starts anew, old ticks mean nothing."""
        if boot != self._boot:
            self._ticks.clear()
            self._boot = boot

    def require(self, names: list[str] | tuple[str, ...]) -> None:
        self.required = tuple(dict.fromkeys(names))

    def beat(self, node: str, tick_us: int, boot: int, now_us: int) -> bool:
        """A heartbeat; True when it may move the lease. Ticks of another boot or from the future are not believed."""
        if boot != self._boot or tick_us > now_us:
            return False
        if tick_us > self._ticks.get(node, 0):
            self._ticks[node] = tick_us
            return node in self.required
        return False

    def seen_us(self, now_us: int) -> int:
        """The smallest tick among the required nodes; with none required, the bridge's own time."""
        return min((self._ticks.get(n, 0) for n in self.required), default=now_us)

    def silent(self, now_us: int) -> list[str]:
        """Required nodes without a heartbeat in the last 300 ms of controller time, in the order of ARM."""
        return [n for n in self.required if now_us - self._ticks.get(n, 0) > SILENT_US]
