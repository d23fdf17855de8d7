"""Hands work from callbacks to the drawing thread without ever blocking: maps are latest-wins, the
rest is bounded."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any


class Mailbox:
    """`put` keeps order and drops the oldest beyond `limit` (counted); `replace` keeps only the
    newest of each key."""

    def __init__(self, limit: int = 5000) -> None:
        self._items: deque[Any] = deque(maxlen=limit)
        self._newest: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._ready = threading.Event()
        self.dropped = 0
        self.replaced = 0

    def put(self, item: Any) -> None:
        """Thread-safe; never waits."""
        with self._lock:
            self.dropped += len(self._items) == self._items.maxlen
            self._items.append(item)
        self._ready.set()

    def replace(self, key: str, item: Any) -> None:
        """Thread-safe; never waits. What was there under `key` and was not taken is lost (counted)."""
        with self._lock:
            self.replaced += key in self._newest
            self._newest[key] = item
        self._ready.set()

    def take(self, timeout: float) -> tuple[list[Any], list[Any]]:
        """(items in order, newest of each key); waits at most `timeout` seconds for something."""
        self._ready.wait(timeout)
        with self._lock:
            self._ready.clear()
            items, newest = list(self._items), list(self._newest.values())
            self._items.clear()
            self._newest.clear()
        return items, newest
