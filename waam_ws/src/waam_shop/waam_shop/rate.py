"""How many messages people get: each only once in a while, and no more than so many an hour. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """per_hour: messages at most; repeat_s: the same event of the same thing at most once in so many seconds."""

    per_hour: int = 20
    repeat_s: float = 600.0


class RateLimit:
    """`allow` says whether a message goes out now; `held` counts those that did not since the last one that did."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._sent: deque[float] = deque()
        self._last: dict[tuple[str, str], float] = {}
        self.held = 0

    def allow(self, kind: str, about: str, now: float) -> bool:
        """now: s of a steady clock."""
        while self._sent and now - self._sent[0] >= 3600.0:
            self._sent.popleft()
        self._last = {k: t for k, t in self._last.items() if now - t < self._limits.repeat_s}
        if len(self._sent) >= self._limits.per_hour or (kind, about) in self._last:
            self.held += 1
            return False
        self._sent.append(now)
        self._last[kind, about] = now
        return True

    def take_held(self) -> int:
        """How many were held back; counting starts again."""
        held, self.held = self.held, 0
        return held
