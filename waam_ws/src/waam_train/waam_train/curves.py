"""The picture of a training."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

import numpy as np


def draw(
    loss: list[float], checks: list[dict[str, float]], names: Mapping[str, str], path: Path
) -> None:
    """Loss of every step with its running mean, and what every validation said, as PNG. names: figures of a validation
    that are shown, with their words."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout='constrained')
    left, right = figure.subplots(1, 2)
    left.plot(np.arange(1, len(loss) + 1), loss, color='0.8', lw=0.6, label='step')
    n = max(1, min(50, len(loss) // 4))
    if loss:
        mean = np.convolve(loss, np.ones(n) / n, mode='valid')
        left.plot(np.arange(n, len(loss) + 1), mean, color='tab:blue', label=f'mean of {n}')
    left.set(xlabel='step', ylabel='loss (mean ln of squared error)', title='training')
    left.legend()
    step = [c['step'] for c in checks]
    shown = [[c[name] for c in checks] for name in names]
    for (words, values), mark in zip(
        zip(names.values(), shown, strict=True), cycle('os^v'), strict=False
    ):
        right.plot(step, values, f'{mark}-', ms=3, label=words)
    right.axhline(1.0, color='0.5', lw=0.8)
    right.set(
        xlabel='step',
        title='held-out scenes',
        ylim=(min(0.0, *(v for values in shown for v in values), 0.0), 1.1),
    )
    right.legend(fontsize='small')
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=120)
