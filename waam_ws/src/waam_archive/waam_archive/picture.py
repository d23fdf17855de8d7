"""A control chart as a picture: means above, ranges below, limits as lines, points that broke a rule marked."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from .charts import Chart, Signal
from .metrics import Metric

matplotlib.use('Agg')
from matplotlib import pyplot  # noqa: E402


def draw(found: Chart, metric: Metric, labels: list[str], file: Path) -> None:
    """Writes PNG, SVG or PDF, as the name of the file says. labels: (k,) when each subgroup ended. ValueError when
    the kind of file is unknown."""
    figure, (upper, lower) = pyplot.subplots(
        2, 1, figsize=(10, 6), sharex=True, height_ratios=(2, 1), layout='constrained'
    )
    try:
        unit = f', {metric.unit}' if metric.unit else ''
        single = found.group == 1
        _panel(upper, found.means, (found.lower, found.center, found.upper))
        _marks(upper, found.means, [s for s in found.signals if not s.of_ranges])
        upper.set_ylabel(('value' if single else f'mean of {found.group}') + unit)
        _panel(lower, found.ranges, (found.range_lower, found.range_center, found.range_upper))
        _marks(lower, found.ranges, [s for s in found.signals if s.of_ranges])
        lower.set_ylabel(('moving range' if single else 'range') + unit)
        cpk = f'   Cpk {found.cpk:.2f}' if np.isfinite(found.cpk) else ''
        upper.set_title(f'{metric.text}{cpk}')
        every = max(1, len(labels) // 10)
        ticks = range(0, len(labels), every)
        lower.set_xticks(ticks, [labels[i] for i in ticks], rotation=30, ha='right')
        figure.savefig(file, dpi=120)
    finally:
        pyplot.close(figure)


def _panel(axes: Axes, values: np.ndarray, limits: tuple[float, float, float]) -> None:
    axes.plot(values, '.-', color='#1f5fa8', linewidth=1, markersize=5)
    for value, style in zip(limits, ('--', '-', '--'), strict=True):
        axes.axhline(value, color='#777777', linestyle=style, linewidth=1)
        axes.annotate(
            f'{value:.4g}',
            (1.005, value),
            xycoords=('axes fraction', 'data'),
            va='center',
            fontsize=8,
        )
    axes.grid(alpha=0.2)


def _marks(axes: Axes, values: np.ndarray, signals: list[Signal]) -> None:
    for signal in signals:
        at = list(signal.points)
        label = f'{signal.rule}: {signal.text}'
        axes.plot(at, values[at], 'o', markersize=10, fillstyle='none', label=label)
    if signals:
        axes.legend(fontsize=8, loc='best')
