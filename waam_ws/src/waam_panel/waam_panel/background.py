"""What the panel does in the background: each in a task and a thread of its own, so that none waits for another one.

A disk or a lock that hangs holds up what needs it, and nothing else; `late` says what hangs, and for how long.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

AUDIT = 'audit'  # name of the thread of the audit log
LATE_S = 3.0  # something that takes longer is told
Answer = TypeVar('Answer')


class BackgroundTasks:
    """`start` runs what is due unless the last one of its name still runs; `thread` is where it may block."""

    def __init__(self) -> None:
        self._pools: dict[str, ThreadPoolExecutor] = {}
        self._tasks: dict[str, tuple[asyncio.Task[None], float]] = {}
        self.failed: dict[str, str] = {}  # why the last one of a name failed

    def start(self, name: str, make: Callable[[], Awaitable[None]]) -> None:
        """Waits for nothing."""
        last = self._tasks.get(name)
        if last is None or last[0].done():
            task = asyncio.ensure_future(self._run(name, make))
            self._tasks[name] = task, time.monotonic()

    async def _run(self, name: str, make: Callable[[], Awaitable[None]]) -> None:
        try:
            await make()
            self.failed.pop(name, None)
        except Exception as e:  # of one of many duties: told, and tried again
            self.failed[name] = f'{name}: {getattr(e, "strerror", None) or e or type(e).__name__}'

    async def thread(
        self, name: str, operation: Callable[..., Answer], *arguments: object
    ) -> Answer:
        """In the one thread of this name."""
        pool = self._pools.get(name)
        if pool is None:
            pool = self._pools[name] = ThreadPoolExecutor(1, name)
        return await asyncio.get_running_loop().run_in_executor(pool, operation, *arguments)

    def problem(self) -> str:
        """What hangs and what has failed; '' while all is well."""
        now = time.monotonic()
        late = [
            f'{name}: no end for {now - since:.0f} s'
            for name, (task, since) in self._tasks.items()
            if not task.done() and now - since > LATE_S
        ]
        return '; '.join([*late, *self.failed.values()])

    def close(self) -> None:
        """Ends the tasks; threads are left to what they wait for."""
        for task, _ in self._tasks.values():
            task.cancel()
        for pool in self._pools.values():
            pool.shutdown(wait=False, cancel_futures=True)
