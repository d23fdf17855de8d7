"""A `Tuning` as a picture: per layer psi as recorded and again, and what the height would have changed by."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from waam_process.grid import GridSpec

from .corrections import PsiAgain
from .prediction import Prediction
from .tune import Tuning

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Box = tuple[float, float, float, float]  # x from, to, y from, to
MAX_LAYERS = 8  # rows; of longer jobs evenly chosen ones


def draw(result: Tuning, path: Path) -> bool:
    """Writes a PNG; False when the job has no correction to show."""
    from matplotlib.figure import Figure

    layers = [(x.number, x.psi, x.prediction) for x in result.layers if x.psi and x.prediction]
    if not layers:
        return False
    chosen = sorted({round(i) for i in np.linspace(0, len(layers) - 1, MAX_LAYERS)})
    layers = [layers[i] for i in chosen]
    figure = Figure(figsize=(15, 0.9 + 2.1 * len(layers)), layout='constrained')
    axes = figure.subplots(len(layers), 4, squeeze=False, width_ratios=(1, 1, 1, 1.1))
    for row, layer in zip(axes, layers, strict=True):
        _row(figure, row, *layer)
    axes[-1][3].set_xlabel('RMS height error, mm')
    figure.suptitle(_title(result), fontsize=11)
    figure.savefig(path, dpi=90)
    return True


def _title(result: Tuning) -> str:
    changed = ', '.join(f'{k} = {v}' for k, v in result.parameters.changed.items())
    return f'{result.record.path.parent.name}: {changed or "parameters as recorded"}'


def _row(
    figure: Figure, row: Sequence[Axes], number: int, psi: PsiAgain, prediction: Prediction
) -> None:
    old = np.asarray(psi.recorded.psi, float).reshape(psi.spec.shape)
    inside = psi.core.footprint
    extent = _mm(psi.spec.extent)
    box = _box(inside, psi.spec)
    change = (prediction.again - prediction.recorded) * 1e3
    scale = max(0.05, float(np.nanpercentile(np.abs(np.where(inside, change, 0.0)), 99)))
    panels = (
        (old, 'psi as recorded', 'RdBu_r', 1.0, ''),
        (psi.result.psi, 'psi again', 'RdBu_r', 1.0, ''),
        (change, 'change of height', 'PuOr_r', scale, 'mm'),
    )
    for ax, (values, name, colours, limit, unit) in zip(row, panels, strict=False):
        shown = np.where(inside, values, np.nan)
        image = ax.imshow(
            shown,
            origin='lower',
            extent=extent,
            cmap=colours,
            vmin=-limit,
            vmax=limit,
            aspect='equal',
        )
        ax.set_xlim(box[0], box[1])
        ax.set_ylim(box[2], box[3])
        ax.set_title(f'layer {number}: {name}', fontsize=9)
        ax.tick_params(labelsize=7)
        ax.set_xlabel('mm', fontsize=7)
        bar = figure.colorbar(image, ax=ax, shrink=0.8)
        bar.ax.tick_params(labelsize=7)
        bar.set_label(unit, fontsize=8)
    _bars(row[3], number, prediction)


def _mm(extent: Box) -> Box:
    x0, x1, y0, y1 = (1e3 * v for v in extent)
    return x0, x1, y0, y1


def _box(inside: np.ndarray, spec: GridSpec) -> Box:
    """Limits of the footprint in mm with a small margin."""
    rows, cols = np.nonzero(inside)
    if not rows.size:
        return _mm(spec.extent)
    x, y = 1e3 * spec.x[[cols.min(), cols.max()]], 1e3 * spec.y[[rows.min(), rows.max()]]
    return float(x[0]) - 2, float(x[1]) + 2, float(y[0]) - 2, float(y[1]) + 2


def _bars(ax: Axes, number: int, prediction: Prediction) -> None:
    names = ('measured', 'recorded', 'again')
    labels = ('measured', 'predicted,\nas recorded', 'predicted,\nagain')
    values = [prediction.rms(n) * 1e3 for n in names]
    bars = ax.barh(
        labels[::-1], [0 if v != v else v for v in values[::-1]], color=('C1', 'C0', '0.4')
    )
    texts = ['no scan after it' if v != v else f'{v:.3f}' for v in values[::-1]]
    ax.bar_label(bars, texts, fontsize=8, padding=3)
    ax.set_xlim(0, 1.25 * max([v for v in values if v == v], default=1.0) or 1.0)
    ax.set_title(f'layer {number}: error after it', fontsize=9)
    ax.tick_params(labelsize=8)
