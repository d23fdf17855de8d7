"""Wrong tokens cost time: of the address that they came from, and of nobody else. Pure: time is an argument (s)."""

from __future__ import annotations

from collections import OrderedDict

LONGEST_S = 3.0  # that an address waits at most, so that the right token always gets in soon
SOURCES = 1024  # addresses that are remembered


class Throttle:
    """cost: s for each wrong token. Nothing is held for a try: who hangs up while waiting leaves nothing behind."""

    def __init__(self, cost: float) -> None:
        self._cost = cost
        self._free: OrderedDict[str, float] = OrderedDict()  # address -> when it may try

    def wait(self, source: str, now: float) -> float:
        """s until a try that comes now is looked at."""
        return min(max(self._free.get(source, now) - now, 0.0), LONGEST_S)

    def wrong(self, source: str, now: float) -> None:
        """It was a wrong token."""
        self._free[source] = min(
            max(self._free.get(source, now), now) + self._cost, now + LONGEST_S
        )
        self._free.move_to_end(source)
        while len(self._free) > SOURCES:
            self._free.popitem(last=False)

    def right(self, source: str) -> None:
        """It was the right one: nothing is held against the address."""
        self._free.pop(source, None)
