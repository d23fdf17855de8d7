"""Progress of many pieces of work on the screen. No ROS."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


class Advance:
    """On a terminal a bar: pieces done, and what was said of the last one. Plain lines elsewhere."""

    def __init__(self, total: int, title: str) -> None:
        self.console = Console(stderr=True, highlight=False)
        self.title, self.total, self.done = title, total, 0
        self._bar: Progress | None = None

    def __enter__(self) -> Self:
        if self.console.is_terminal:
            self._bar = Progress(
                TextColumn('[bold]{task.description}'),
                BarColumn(30),
                MofNCompleteColumn(),
                TextColumn('{task.fields[said]}'),
                TimeElapsedColumn(),
                console=self.console,
            )
            self._bar.start()
            self._task = self._bar.add_task(self.title, total=self.total, said='')
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def step(self, said: str) -> None:
        """One more is done."""
        self.done += 1
        if self._bar is not None:
            self._bar.update(self._task, completed=self.done, said=said)
        else:
            self.console.print(f'{self.done}/{self.total} {said}')
