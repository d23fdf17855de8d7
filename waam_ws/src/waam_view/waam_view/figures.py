"""Pictures of the report. Each function returns a PNG as bytes; input in SI, axes in the units of
the shop floor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from waam_process.loop_mode import LoopMode

from .canvas import BLUE, GREEN, GREY, INK, RED, new_figure, png, style
from .job_data import Job, Scan, number
from .worst_places import is_machined

DIVERGING = 'RdBu_r'
PAGE = 11.0  # highest picture, inches for 9.4 of width: printed on A4 it leaves room for heading and caption


def nice_range(values: list[np.ndarray], least: float) -> float:
    """Symmetric colour range (same unit): 99th percentile of the magnitudes, rounded up."""
    known = np.concatenate([np.empty(0), *(np.abs(v[np.isfinite(v)]) for v in values)])
    wanted = max(least, float(np.percentile(known, 99)) if known.size else least)
    scale = 10 ** math.floor(math.log10(wanted))
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return next(s * scale for s in steps if s * scale >= wanted * 0.999)


def _names(scan: Scan) -> tuple[str, str]:
    """Of the axes of a map."""
    if scan.unrolled:
        return 'x around the shaft (unrolled), mm', 'y along its axis, mm'
    return 'x, mm', 'y, mm'


def _window(scan: Scan) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max in mm of the region with a little around it; the whole map without a region."""
    x0, x1, y0, y1 = scan.extent_mm
    rows, cols = np.nonzero(scan.region)
    if not rows.size:
        return x0, x1, y0, y1
    d, around = scan.resolution * 1e3, 3.0
    left, right = x0 + cols.min() * d - around, x0 + (cols.max() + 1) * d + around
    low, high = y0 + rows.min() * d - around, y0 + (rows.max() + 1) * d + around
    return max(x0, left), min(x1, right), max(y0, low), min(y1, high)


def _show(
    axes: Axes, scan: Scan, values: np.ndarray, limit: float, colours: str = DIVERGING
) -> AxesImage:
    """A map with y up, cells as they are, unknown cells grey, cut to the region."""
    axes.set_facecolor('#e4e7eb')
    image = axes.imshow(
        values,
        origin='lower',
        extent=scan.extent_mm,
        cmap=colours,
        vmin=-limit,
        vmax=limit,
        interpolation='nearest',
        aspect='equal',
    )
    x0, x1, y0, y1 = _window(scan)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.tick_params(labelsize=7)
    return image


def _outline(axes: Axes, scan: Scan, mask: np.ndarray, colour: str, **style: Any) -> None:
    if mask.any() and not mask.all() and min(mask.shape) > 1:
        x0, _, y0, _ = scan.extent_mm
        d = scan.resolution * 1e3
        x = x0 + (np.arange(mask.shape[1]) + 0.5) * d
        y = y0 + (np.arange(mask.shape[0]) + 0.5) * d
        axes.contour(x, y, mask.astype(float), [0.5], colors=colour, **style)


def _aspect(scan: Scan) -> float:
    """Height over width of the map as shown."""
    x0, x1, y0, y1 = _window(scan)
    return (y1 - y0) / (x1 - x0)


def error_map(
    scan: Scan,
    error: np.ndarray,
    tolerance_mm: float,
    limit_mm: float,
    marks: list[tuple[float, float]],
) -> bytes:
    """error (rows, cols) mm of a scan, with the tolerance on map and colour bar; marks: (x, y) mm, numbered from 1."""
    figure = new_figure(9.0, min(7.0, max(2.6, 7.8 * _aspect(scan) + 1.0)))
    axes = figure.add_subplot()
    image = _show(axes, scan, error, limit_mm)
    beyond = np.nan_to_num(np.abs(error), nan=0.0) > tolerance_mm
    _outline(axes, scan, beyond, '#111111', linewidths=0.5)
    _outline(axes, scan, scan.interior, GREEN, linewidths=1.2, linestyles='--')
    x0, x1, _, _ = _window(scan)
    for k, (x, y) in enumerate(marks, 1):
        axes.plot(x, y, 'o', ms=13, mfc='none', mec='black', mew=1.8)
        side = 1 if x < (x0 + x1) / 2 else -1  # away from the edge of the picture
        axes.annotate(
            str(k), (x, y), (side * 15, 0), textcoords='offset points', ha='center', va='center', fontsize=11,
            fontweight='bold', bbox={'boxstyle': 'round,pad=0.2', 'fc': 'white', 'ec': 'black'},
        )  # fmt: skip
    bar = figure.colorbar(image, ax=axes, extend='both', fraction=0.05, pad=0.015)
    bar.set_label('height error, mm', fontsize=9)
    for side in (-1, 1):
        bar.ax.axhline(side * tolerance_mm, color='black', linewidth=1.5)
    across, up = _names(scan)
    axes.set_xlabel(across, fontsize=9)
    axes.set_ylabel(up, fontsize=9)
    return png(figure)


def stock_map(scan: Scan) -> bytes:
    """What is to be machined off after the last scan, which has the needed area."""
    stock, needed = scan.final_error * 1e3, scan.maps['needed'].astype(bool)
    high = max(0.1, float(np.nanquantile(stock, 0.99))) if np.isfinite(stock).any() else 1.0
    figure = new_figure(9.0, min(7.0, max(2.6, 7.8 * _aspect(scan) + 1.0)))
    axes = figure.add_subplot()
    image = axes.imshow(
        stock, origin='lower', extent=scan.extent_mm, cmap='YlOrBr', vmin=0, vmax=high
    )
    _outline(axes, scan, needed & (np.nan_to_num(stock, nan=-1.0) < 0), '#111111', linewidths=1.0)
    _outline(axes, scan, needed, GREEN, linewidths=1.2, linestyles='--')
    x0, x1, y0, y1 = _window(scan)
    axes.set(xlim=(x0, x1), ylim=(y0, y1))
    figure.colorbar(image, ax=axes, extend='max', fraction=0.05, pad=0.015).set_label(
        'stock, mm', fontsize=9
    )
    across, up = _names(scan)
    axes.set_xlabel(across, fontsize=9)
    axes.set_ylabel(up, fontsize=9)
    return png(figure)


def _columns(scan: Scan) -> int:
    return 3 if _aspect(scan) < 0.7 else 4


def _row_height(scan: Scan, columns: int) -> float:
    """Of small maps beside each other, inches; beside each are tick labels, at the right of all the colour bar."""
    return (8.5 / columns - 0.35) * min(1.3, _aspect(scan)) + 0.35


def grids(
    scans: list[Scan], maps: list[np.ndarray], limit: float, unit: str, titles: list[str]
) -> list[bytes]:
    """PNGs of one page each: maps (rows, cols) of all scans on one colour scale from -limit to limit."""
    if not scans:
        return []
    columns = _columns(scans[0])
    rows = max(1, int((PAGE - 0.35) / _row_height(scans[0], columns)))
    each = rows * columns
    return [
        small_multiples(scans[i : i + each], maps[i : i + each], limit, unit, titles[i : i + each])
        for i in range(0, len(scans), each)
    ]


def small_multiples(
    scans: list[Scan], maps: list[np.ndarray], limit: float, unit: str, titles: list[str]
) -> bytes:
    """PNG: maps (rows, cols), side by side on one colour scale from -limit to limit."""
    columns = min(len(scans), _columns(scans[0]))
    rows = math.ceil(len(scans) / columns)
    height = rows * _row_height(scans[0], columns) + 0.35
    figure = new_figure(9.4, max(1.8, height))
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
    for one, scan, values, title in zip(axes, scans, maps, titles, strict=False):
        image = _show(one, scan, values, limit)
        one.set_title(title, fontsize=8)
    for one in axes[len(scans) :]:
        one.set_visible(False)
    bar = figure.colorbar(image, ax=list(axes), fraction=0.03, pad=0.01, extend='both')
    bar.set_label(unit, fontsize=9)
    return png(figure)


def histogram(scan: Scan, error: np.ndarray, tolerance_mm: float, reach_mm: float = 0.0) -> bytes:
    """Distribution of error (rows, cols) mm inside the margin, with the tolerance. reach_mm: half the
    axis; 0 = from the data."""
    error = error[scan.interior]
    error = error[np.isfinite(error)]
    figure = new_figure(4.6, 3.0)
    axes = figure.add_subplot()
    if error.size:
        own = max(2 * tolerance_mm, float(np.percentile(np.abs(error), 99.5)) * 1.1)
        reach = reach_mm or own
        edges = np.linspace(-reach, reach, 61)
        weights = np.full(error.size, 100.0 / error.size)
        axes.hist(np.clip(error, -reach, reach), edges.tolist(), weights=weights, color=BLUE)
        axes.axvline(error.mean(), color=INK, linewidth=1.0, linestyle=':')
    axes.axvspan(-tolerance_mm, tolerance_mm, color=GREEN, alpha=0.12)
    for side in (-1, 1):
        axes.axvline(side * tolerance_mm, color=GREEN, linewidth=1.2)
    style(axes, 'final height error, mm (green: tolerance, dotted: mean)', 'share of cells, %')
    return png(figure)


def convergence(jobs: list[Job]) -> bytes:
    """RMS height error before every layer and after the last, one line per loop mode."""
    figure = new_figure(4.6, 3.0)
    axes = figure.add_subplot()
    tolerance = jobs[0].tolerance_mm
    axes.axhspan(0, tolerance, color=GREEN, alpha=0.12)
    colours: dict[str, str] = {
        LoopMode.OPEN_LOOP: RED,
        LoopMode.CLOSED_LOOP: BLUE,
        LoopMode.MONITOR: GREY,
    }
    for job in jobs:
        colour = colours[job.loop_mode]
        rms = [number(x.get('height_error_rms')) * 1e3 for x in job.layers]
        axes.plot(range(len(rms)), rms, 'o-', color=colour, label=job.loop_mode.replace('_', ' '))
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    style(axes, 'layers laid (green: tolerance)', 'RMS height error, mm')
    axes.legend(fontsize=8, frameon=False)
    return png(figure)


def section(job: Job, error: np.ndarray) -> bytes:
    """Cut through the region along its longer side: heights as found, after each layer, final; below: error, mm."""
    last = job.scans[-1]
    rows, cols = np.nonzero(last.region if last.region.any() else np.ones(last.z.shape, bool))
    along_x = bool(np.ptp(cols) >= np.ptp(rows))
    place = int(np.median(rows if along_x else cols))
    figure = new_figure(9.4, 4.2)
    heights, errors = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    _plot_heights(heights, job, along_x, place)
    errors.axhspan(-job.tolerance_mm, job.tolerance_mm, color=GREEN, alpha=0.12)
    errors.plot(*_cut(last, error * 1e-3, along_x, place), color=BLUE, linewidth=1.2)
    x0, x1, y0, y1 = _window(last)
    errors.set_xlim(*((x0, x1) if along_x else (y0, y1)))
    at = last.extent_mm[2 if along_x else 0] + (place + 0.5) * last.resolution * 1e3
    name = _names(last)[0 if along_x else 1]
    across = 'y' if along_x else 'x'
    style(heights, '', 'z, mm')
    style(errors, f'{name} (cut at {across} = {at:.1f} mm)', 'final error, mm')
    return png(figure)


def _plot_heights(axes: Axes, job: Job, along_x: bool, place: int) -> None:
    last = job.scans[-1]
    nominal = last.maps.get('nominal', np.full(last.z.shape, np.nan))
    for scan in job.scans:
        first, final = scan is job.scans[0], scan is last
        axes.plot(
            *_cut(scan, scan.z, along_x, place),
            color=RED if first else BLUE if final else GREY,
            label='as found' if first else 'final' if final else None,
            linewidth=1.6 if final else 1.0,
            alpha=1.0 if first or final else 0.6,
        )
    line = _cut(last, nominal, along_x, place)
    axes.plot(*line, color=GREEN, linewidth=1.2, linestyle='--', label='nominal')
    if is_machined(job) and 'target' in last.maps:
        aimed = _cut(last, last.maps['target'], along_x, place)
        axes.plot(*aimed, color=INK, linewidth=1.0, linestyle=':', label='aimed at')
    axes.legend(fontsize=8, frameon=False, ncols=4)


def _cut(
    scan: Scan, values: np.ndarray, along_x: bool, place: int
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinate and value in mm along one row or column, as far as the map is shown."""
    line = values[place] if along_x else values[:, place]
    start = scan.extent_mm[0 if along_x else 2]
    x0, x1, y0, y1 = _window(scan)
    low, high = (x0, x1) if along_x else (y0, y1)
    at = start + (np.arange(line.size) + 0.5) * scan.resolution * 1e3
    shown = (at > low) & (at < high)
    return at[shown], line[shown] * 1e3


def side_by_side(jobs: list[Job], limit_mm: float) -> bytes:
    """Final error maps of two or three loop modes on one colour scale."""
    scans = [j.scans[-1] for j in jobs]
    wide = _aspect(scans[0]) < 0.45
    rows, columns = (len(jobs), 1) if wide else (1, len(jobs))
    width = 9.4
    height = rows * (width / columns * _aspect(scans[0]) * 0.9 + 0.55) + 0.3
    figure = new_figure(width, height)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
    tolerance = jobs[0].tolerance_mm
    for one, job, scan in zip(axes, jobs, scans, strict=True):
        error = scan.final_error * 1e3
        image = _show(one, scan, error, limit_mm)
        beyond = np.nan_to_num(np.abs(error), nan=0.0) > tolerance
        _outline(one, scan, beyond, '#111111', linewidths=0.5)
        _outline(one, scan, scan.interior, GREEN, linewidths=1.2, linestyles='--')
        rms = number(job.run.get('rms_mm'))
        one.set_title(f'{job.loop_mode.replace("_", " ")}: RMS {rms:.3f} mm', fontsize=10)
        across, up = _names(scan)
        one.set_xlabel(across, fontsize=8)
        one.set_ylabel(up, fontsize=8)
    bar = figure.colorbar(image, ax=list(axes), extend='both', fraction=0.05, pad=0.015)
    bar.set_label('height error, mm', fontsize=9)
    for side in (-1, 1):
        bar.ax.axhline(side * tolerance, color='black', linewidth=1.5)
    return png(figure)
