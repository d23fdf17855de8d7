"""Arc and heat over time: current, voltage, wire feed, travel speed and temperature, layers shaded."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from .canvas import BLUE, INK, RED, new_figure, png, style
from .job_data import Job, interpass_limit

ORANGE = '#e08a1e'
_MAX_POINTS = 4000
_LAYER_SHADES = ('#eef2f6', '#ffffff')


def thin(
    t: np.ndarray, values: np.ndarray, points: int = _MAX_POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """At most `points` samples (n,) that keep every local minimum and maximum visible."""
    if t.size <= points:
        return t, values
    size = math.ceil(t.size / (points // 2))
    whole = t.size // size * size
    blocks = values[:whole].reshape(-1, size)
    filled = np.where(
        np.isfinite(blocks), blocks, np.nanmean(values) if np.isfinite(values).any() else 0.0
    )
    pick = np.stack([filled.argmin(1), filled.argmax(1)], 1)
    pick.sort(1)
    index = (np.arange(len(blocks))[:, None] * size + pick).ravel()
    return t[index], values[index]


def process_plots(job: Job) -> bytes:
    """Current, voltage, wire feed, travel speed and temperature over time, layers shaded."""
    data = job.telemetry
    t = np.asarray(data['t'], float)
    seconds = t - t[0]
    scale, unit = (60.0, 'min') if seconds[-1] > 180 else (1.0, 's')
    time = seconds / scale
    rows = [
        ('arc current, A', [('current', 1.0, BLUE, '')]),
        ('arc voltage, V', [('voltage', 1.0, BLUE, '')]),
        ('wire feed, m/min', [('wire_feed', 60.0, BLUE, 'actual'), ('wire_feed_commanded', 60.0, ORANGE, 'commanded')]),
        ('travel, mm/s', [('speed', 1e3, BLUE, '')]),
        ('temperature, °C', [('temperature', 1.0, RED, '')]),
    ]  # fmt: skip
    figure = new_figure(9.4, 8.2)
    axes = figure.subplots(len(rows), 1, sharex=True)
    for one, (label, lines) in zip(axes, rows, strict=True):
        _shade_layers(one, time, data.get('layer'))
        for name, factor, colour, text in lines:
            values = np.asarray(data.get(name, np.full(t.shape, np.nan)), float) * factor
            one.plot(*thin(time, values), color=colour, linewidth=0.8, label=text or None)
        style(one, '', label)
        if len(lines) > 1:
            one.legend(fontsize=7, frameon=False, ncols=2, loc='upper right')
    limit = interpass_limit(job)
    if math.isfinite(limit):
        axes[-1].axhline(limit, color=INK, linewidth=1.0, linestyle='--')
        axes[-1].text(time[-1], limit, ' limit', fontsize=7, va='bottom', ha='right')
    axes[-1].set_xlabel(f'time, {unit} (numbers at the top: layer)', fontsize=9)
    _layer_names(axes[0], time, data.get('layer'))
    return png(figure)


def _spans(layer: np.ndarray | None) -> list[tuple[int, int, int]]:
    """(layer, first sample, last sample) of each stretch."""
    if layer is None or not len(layer):
        return []
    change = np.flatnonzero(np.diff(layer)) + 1
    starts, ends = np.r_[0, change], np.r_[change, len(layer)] - 1
    return [(int(layer[a]), int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def _shade_layers(axes: Axes, time: np.ndarray, layer: np.ndarray | None) -> None:
    for number_of_layer, a, b in _spans(layer):
        if number_of_layer > 0:
            axes.axvspan(time[a], time[b], color=_LAYER_SHADES[number_of_layer % 2], zorder=0)


def _layer_names(axes: Axes, time: np.ndarray, layer: np.ndarray | None) -> None:
    for number_of_layer, a, b in _spans(layer):
        if number_of_layer > 0 and time[b] - time[a] > 0.02 * (time[-1] - time[0]):
            axes.annotate(
                str(number_of_layer), ((time[a] + time[b]) / 2, 1.02), ha='center', fontsize=8,
                xycoords=axes.get_xaxis_transform(),
            )  # fmt: skip
