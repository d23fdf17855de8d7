"""The picture of a training."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def draw(loss: list[float], checks: list[dict[str, float]], path: Path) -> None:
    """Loss of every step with its running mean, and what every validation said, as PNG."""
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
    right.plot(step, [c['ratio'] for c in checks], 'o-', ms=3, label='network / explicit law, RMS')
    right.plot(step, [c['worse'] for c in checks], 's-', ms=3, label='share of scenes > 10 % worse')
    right.plot(
        step, [c['doubt'] for c in checks], '^-', ms=3, label='rank correlation of the doubt'
    )
    right.axhline(1.0, color='0.5', lw=0.8)
    right.set(
        xlabel='step',
        title='held-out scenes',
        ylim=(min(0.0, *(c['doubt'] for c in checks), 0.0), 1.1),
    )
    right.legend(fontsize='small')
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=120)
