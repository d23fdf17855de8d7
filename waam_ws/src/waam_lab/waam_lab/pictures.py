"""Pictures of the laboratory's report. Each function returns a PNG as bytes; SI in, mm on the axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from waam_view.canvas import BLUE, GREEN, INK, new_figure, png, style
from waam_view.figures import nice_range

from .bands import Maps

AROUND = 3.0  # mm shown beyond the region


def _window(maps: Maps) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max of the region in mm."""
    spec, (rows, cols) = maps.first.spec, np.nonzero(maps.region)
    x, y = spec.x * 1e3, spec.y * 1e3
    return (
        x[cols.min()] - AROUND,
        x[cols.max()] + AROUND,
        y[rows.min()] - AROUND,
        y[rows.max()] + AROUND,
    )


def _show(axes: Any, maps: Maps, values: np.ndarray, title: str, **scale: Any) -> Any:
    spec = maps.first.spec
    x0, x1, y0, y1 = (v * 1e3 for v in spec.extent)
    axes.set_facecolor('#e4e7eb')
    image = axes.imshow(
        values, origin='lower', extent=(x0, x1, y0, y1), interpolation='nearest', **scale
    )
    inner = maps.interior.astype(float)
    if inner.any() and not inner.all():
        axes.contour(
            spec.x * 1e3, spec.y * 1e3, inner, [0.5], colors=INK, linewidths=0.9, linestyles='--'
        )
    left, right, low, high = _window(maps)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=7)
    return image


def error_maps(
    maps: Maps, tolerance: float, jobs: int, causes: Mapping[str, float] | None = None
) -> bytes:
    """Mean error, largest error, how often a cell is in tolerance, and the causes of a failure (shares), if there are
    any."""
    left, right, low, high = _window(maps)
    shape = (2, 2) if (high - low) > 0.35 * (right - left) else (4 if causes else 3, 1)
    each = (9.4 / shape[1] - 1.0) * (high - low) / (right - left) + 0.55
    figure = new_figure(9.4, min(11.0, max(1.6, each) * shape[0]))
    axes = np.atleast_1d(figure.subplots(*shape)).ravel()
    for unused in axes[3:]:
        unused.set_visible(bool(causes))
    scales = [
        (maps.mean * 1e3, f'mean error over {jobs} jobs', 'mm'),
        (maps.worst * 1e3, 'largest error of any job', 'mm'),
    ]
    for one, (values, title, unit) in zip(axes, scales, strict=False):
        limit = nice_range([values], 2 * tolerance * 1e3)
        image = _show(one, maps, values, title, cmap='RdBu_r', vmin=-limit, vmax=limit)
        bar = _bar(figure, image, one, unit, extend='both')
        for side in (-1, 1):
            bar.ax.axhline(side * tolerance * 1e3, color='black', linewidth=1.3)
    image = _show(
        axes[2], maps, maps.within * 100, 'jobs in tolerance', cmap='RdYlGn', vmin=0, vmax=100
    )
    _bar(figure, image, axes[2], '%')
    if causes:
        shares = [share * 100 for share in causes.values()]
        axes[3].barh(list(causes)[::-1], shares[::-1], color=BLUE)
        axes[3].set_title('where the failure is made, %', fontsize=9)
        axes[3].tick_params(labelsize=7)
    return png(figure)


def _bar(figure: Any, image: Any, axes: Any, unit: str, **options: Any) -> Any:
    bar = figure.colorbar(image, ax=axes, fraction=0.05, pad=0.02, **options)
    bar.set_label(unit, fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return bar


def histogram(errors: np.ndarray, tolerance: float) -> bytes:
    """PNG: distribution of the errors (n,) m of all judged cells of all jobs, in mm."""
    error, limit = errors * 1e3, tolerance * 1e3
    figure = new_figure(4.6, 3.0)
    axes = figure.add_subplot()
    if error.size:
        reach = max(2 * limit, float(np.percentile(np.abs(error), 99.5)) * 1.1)
        weights = np.full(error.size, 100.0 / error.size)
        edges = np.linspace(-reach, reach, 61).tolist()
        axes.hist(np.clip(error, -reach, reach), edges, weights=weights, color=BLUE)
        axes.axvline(error.mean(), color=INK, linewidth=1.0, linestyle=':')
    axes.axvspan(-limit, limit, color=GREEN, alpha=0.12)
    style(axes, 'height error, mm (green: tolerance, dotted: mean)', 'share of judged cells, %')
    return png(figure)


def levels(bands: list[tuple[float, float, float]], tolerance: float) -> bytes:
    """Mean error after every layer: mean over the jobs and the range of all of them."""
    figure = new_figure(4.6, 3.0)
    axes = figure.add_subplot()
    mean, low, high = (np.array(v) * 1e3 for v in zip(*bands, strict=True))
    layers = np.arange(1, len(mean) + 1)
    limit = tolerance * 1e3
    axes.axhspan(-limit, limit, color=GREEN, alpha=0.12)
    axes.fill_between(layers, low, high, color=BLUE, alpha=0.25, linewidth=0)
    axes.plot(layers, mean, 'o-', color=BLUE, markersize=4)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    style(axes, 'layers laid (line: mean, band: all jobs)', 'mean error of the layer, mm')
    return png(figure)
