"""Which processes live by which node's name, as they say once a second in /diagnostics. Pure."""

from __future__ import annotations

ALIVE_S = 2.5  # s of steady time that a process counts after its last word


class Lives:
    """`process` is that of `waam_node.node.WaamNode`: `<name>@<host>:<pid>:<random>`."""

    def __init__(self) -> None:
        self._heard: dict[str, float] = {}

    def heard(self, process: str, now: float) -> None:
        """A word of a process. now: s, steady clock."""
        self._heard[process] = now

    def of(self, node: str, now: float) -> list[str]:
        """Processes that live by this name: `host:pid`."""
        self._heard = {p: at for p, at in self._heard.items() if now - at <= ALIVE_S}
        places = [p.partition('@')[2] for p in self._heard if p.partition('@')[0] == node]
        return sorted(place.rpartition(':')[0] for place in places)
