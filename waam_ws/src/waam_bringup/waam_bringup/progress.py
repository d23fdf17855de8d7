"""The progress bar of a job: layer, height error, time left. Plain lines when the output is no terminal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from waam_job.model.records import State
from waam_msgs.msg import JobStatus

NAMES = [State(i).name.lower() for i in range(12)]


def describe(s: JobStatus) -> str:
    """layer 3/5 depositing bead 4/9, height error 0.21 mm RMS; a pause with its reason"""
    paused = s.state == JobStatus.PAUSED and s.message
    state = f'paused: {s.message.removeprefix("paused: ")}' if paused else NAMES[s.state]
    parts = [f'layer {s.layer}/{s.layers}' if s.layers else '', state]
    if s.state == JobStatus.DEPOSITING and s.beads:
        parts.append(f'bead {s.bead}/{s.beads}')
    text = ' '.join(p for p in parts if p)
    if math.isfinite(s.height_error_rms):
        text += f', height error {s.height_error_rms * 1e3:.2f} mm RMS'
    return text


def clock(seconds: float) -> str:
    """mm:ss of machine time, or -- when unknown"""
    return (
        f'{int(seconds) // 60:02d}:{int(seconds) % 60:02d}' if math.isfinite(seconds) else '--:--'
    )


@contextmanager
def bar(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar; call what it gives with how much is done. Nothing is drawn when the output is no terminal."""
    console = Console(stderr=True)
    columns = (
        TextColumn('{task.description}'),
        BarColumn(30),
        TextColumn('{task.percentage:3.0f} %'),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done: progress.update(task, completed=done)


class JobProgress:
    """Context manager; call it with every JobStatus."""

    def __init__(self, title: str, console: Console | None = None) -> None:
        self.title, self.console = title, console or Console(stderr=True)
        self._bar: Progress | None = None
        self._last_line, self._last_time = '', 0.0

    def __enter__(self) -> JobProgress:
        if self.console.is_terminal:
            self._bar = Progress(
                TextColumn('[bold]{task.fields[title]}'),
                BarColumn(30),
                TextColumn('{task.percentage:3.0f} %'),
                TextColumn('{task.fields[text]}'),
                TextColumn('left {task.fields[left]}'),
                TimeElapsedColumn(),
                console=self.console,
            )
            self._bar.start()
            self._task = self._bar.add_task('', total=1.0, title=self.title, text='', left='--:--')
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar:
            self._bar.stop()

    def __call__(self, s: JobStatus) -> None:
        if self._bar:
            self._bar.update(
                self._task, completed=s.progress, text=describe(s), left=clock(s.time_left)
            )
            return
        line = f'{self.title}: {describe(s)}'
        if line != self._last_line and time.monotonic() - self._last_time > 1.0:
            left = clock(s.time_left)
            self.console.print(
                f'{line}, {s.progress * 100:.0f} %, machine time left {left}',
                highlight=False,
                soft_wrap=True,
            )
            self._last_line, self._last_time = line, time.monotonic()
