"""Progress of many jobs on the screen."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from .job import LabResult


class Advance:
    """Progress of a campaign on a terminal: jobs done, and the result of the last one. Plain lines elsewhere."""

    def __init__(self, total: int, title: str) -> None:
        self.console = Console(stderr=True, highlight=False)
        self.title, self.total, self.done = title, total, 0
        self._bar: Progress | None = None

    def __enter__(self) -> Advance:
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

    def __call__(self, result: LabResult) -> None:
        self.done += 1
        said = f'seed {result.seed}: {result.message if result.failed else outcome(result)}'
        if self._bar is not None:
            self._bar.update(self._task, completed=self.done, said=said)
        else:
            self.console.print(f'{self.done}/{self.total} {said}')


def outcome(r: LabResult) -> str:
    """One line for the screen: error (mm), share in tolerance (%) and verdict, without and with the rim."""
    rim = f'with the rim {r.share_edges * 100:.1f} %, {r.verdict_edges}'
    return f'RMS {r.rms * 1e3:.3f} mm, {r.share_in_tolerance * 100:.1f} %, {r.verdict}; {rim}'
