"""Means with confidence intervals over seeds, and tables on stderr (stdout belongs to the JSON lines)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence

import numpy as np


def interval(values: Sequence[float], of: Callable = np.mean) -> tuple[float, float, float]:
    """Figure over the seeds and its 95 % bootstrap interval (2000 resamplings, fixed seed)."""
    v = np.asarray(values, float)
    picks = np.random.default_rng(0).integers(0, len(v), (2000, len(v)))
    many = np.array([of(v[p]) for p in picks])
    return float(of(v)), float(np.quantile(many, 0.025)), float(np.quantile(many, 0.975))


def text(values: Sequence[float], scale: float = 1e3) -> str:
    """'0.213 [0.201 .. 0.226]'"""
    m, low, high = interval(values)
    return f'{m * scale:.3f} [{low * scale:.3f} .. {high * scale:.3f}]'


def table(title: str, head: Sequence[str], rows: Iterable[Sequence]) -> None:
    rows = [[str(c) for c in r] for r in rows]
    widths = [max(len(r[i]) for r in [list(head), *rows]) for i in range(len(head))]
    print(f'\n{title}', file=sys.stderr)
    for r in (head, ['-' * w for w in widths], *rows):
        print('  '.join(str(c).ljust(w) for c, w in zip(r, widths, strict=True)), file=sys.stderr)


def progress(items: Sequence, what: str) -> Iterable:
    """The items, with a bar on stderr."""
    from rich.console import Console
    from rich.progress import track

    return track(items, what, console=Console(stderr=True), transient=True)
