"""Pictures of the report of a fit. Each function returns a PNG as bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from waam_view.canvas import BLUE, INK, new_figure, png, style

from .compare import Comparison
from .fit import Fitted

MAX_LAYERS = 3  # layers shown of a job


def intervals(found: Fitted) -> bytes:
    """Every parameter in spreads of what was believed before: belief as a band, interval as a bar."""
    rows = found.estimates[::-1]
    figure = new_figure(9.4, 0.26 * len(rows) + 0.9)
    axes = figure.add_subplot()
    axes.axvspan(-1.6449, 1.6449, color='#e4e7eb')
    for y, e in enumerate(rows):
        low, mid, high = (e.unknown.standard(max(v, 1e-12)) for v in (e.low, e.value, e.high))
        colour = BLUE if e.told else '#9aa3ad'
        axes.plot([low, high], [y, y], color=colour, linewidth=3, solid_capstyle='butt')
        axes.plot(mid, y, 'o', color=colour, markersize=5)
    axes.axvline(0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(rows)), [e.unknown.name for e in rows], fontsize=7)
    style(axes, 'spreads from what is usual (band: 90 % before the records; grey: not told)', '')
    return png(figure)


def maps(found: Fitted, job: int) -> bytes:
    """Measured less laid, before and after, for some layers of one job; mm."""
    replay = found.replays[job]
    comparison = Comparison(replay)
    numbers = list(comparison.masks)
    chosen = [numbers[i] for i in sorted({0, len(numbers) // 2, len(numbers) - 1})][:MAX_LAYERS]
    x0, x1, y0, y1 = (v * 1e3 for v in replay.record.spec.extent)
    figure = new_figure(9.4, 2 * 3.0 * (y1 - y0) / (x1 - x0) + 0.8)
    axes = np.atleast_2d(figure.subplots(2, len(chosen), sharex=True, sharey=True)).reshape(2, -1)
    image: Any = None
    for row, (word, laid) in enumerate(
        (('before', found.before[job]), ('after', found.after[job]))
    ):
        off = comparison.off(laid)
        for one, number in zip(axes[row], chosen, strict=True):
            shown = np.where(comparison.masks[number], off[number] * 1e3, np.nan)
            image = one.imshow(
                shown, origin='lower', extent=(x0, x1, y0, y1), cmap='RdBu_r', vmin=-0.5, vmax=0.5
            )
            one.set_title(f'layer {number}, {word}', fontsize=8)
            one.tick_params(labelsize=6)
    bar = figure.colorbar(image, ax=figure.axes, fraction=0.02, pad=0.01)
    bar.set_label('measured less simulated, mm', fontsize=7)
    bar.ax.tick_params(labelsize=6)
    return png(figure)


def temperatures(found: Fitted, job: int) -> bytes:
    """Readings of the pyrometer and the simulated cell's, before and after."""
    seen = found.replays[job].readings
    figure = new_figure(9.4, 2.6)
    axes = figure.add_subplot()
    t = seen.t - seen.t[0]
    axes.plot(t, seen.celsius, '.', color=INK, markersize=4, label='recorded')
    axes.plot(t, found.before[job].celsius, '.', color='#d08700', markersize=3, label='before')
    axes.plot(t, found.after[job].celsius, '.', color=BLUE, markersize=3, label='after')
    axes.legend(fontsize=7)
    style(axes, 'time, s (without arc only)', 'pyrometer, degC')
    return png(figure)
