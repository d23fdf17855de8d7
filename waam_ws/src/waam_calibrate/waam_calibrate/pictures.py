"""Pictures of calibrations: what was measured beside what was made of it. PNG bytes."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from . import shapers
from .lead import Lead
from .resonance import Resonance
from .wire import WireWheel

if TYPE_CHECKING:  # matplotlib is loaded only when something is drawn
    from matplotlib.figure import Figure


def spectra(found: Resonance) -> bytes:
    """Gain of the axis, and what each candidate leaves of it."""
    figure = figure_of(4.6)
    axis = figure.subplots()
    psd = found.total
    axis.plot(found.hz, psd, color='0.3', lw=2, label='without a shaper')
    for c in found.candidates:
        rest = shapers.residual(shapers.impulses(c.type, c.hz, c.damping), found.hz, c.damping) ** 2
        width = 2.2 if c is found.chosen else 1.0
        text = f'{c.type} {c.hz:.1f} Hz, {100 * c.vibration:.1f} % left'
        axis.plot(found.hz, np.maximum(psd * rest, 1e-9), lw=width, label=text)
    axis.axvline(found.mode.hz, color='0.6', ls=':')
    axis.set(
        yscale='log', ylim=(1e-3 * psd.max(), 2 * psd.max()), xlabel='frequency, Hz',
        ylabel='power over that commanded', title=f'{found.axis} axis: spectrum without and with each shaper',
    )  # fmt: skip
    axis.legend(fontsize=8, loc='upper right')
    return png(figure)


def measured(found: Resonance) -> bytes:
    """Power spectral density of the three channels as measured."""
    figure = figure_of(3.4)
    axis = figure.subplots()
    for i, name in enumerate('xyz'):
        axis.semilogy(found.hz, np.maximum(found.raw[:, i], 1e-12), lw=1, label=name)
    axis.set(xlabel='frequency, Hz', ylabel='PSD, m²/s³', title='acceleration as measured')
    axis.legend(fontsize=8)
    return png(figure)


def wire_lengths(found: WireWheel) -> bytes:
    """Counts over lengths, and the normal feed where a record was given."""
    figure = figure_of(3.4)
    panels = figure.subplots(1, 2 if found.feed else 1, squeeze=False)[0]
    top = 1.05 * found.lengths.max()
    panels[0].plot(found.lengths, found.counts, 'o', label='measured')
    panels[0].plot([0, top], [0, top * found.per_mm], label=f'{found.per_mm:.4g} counts/mm')
    panels[0].plot([0, top], [0, top * found.by_wheel], ':', label='by the wheel')
    panels[0].set(xlabel='wire, mm', ylabel='counts')
    panels[0].legend(fontsize=8)
    if found.feed:
        panels[1].plot(found.feed.ratios, '.', label='normal feed')
        panels[1].axhline(found.threshold, color='r', label='underfeed')
        panels[1].set(xlabel='window of 0.5 s', ylabel='measured over commanded')
        panels[1].legend(fontsize=8)
    return png(figure)


def wire_steps(found: Lead) -> bytes:
    """Wire speed as measured, and as delay and lag make it of the command; the first 20 s of it."""
    figure = figure_of(3.8)
    axis = figure.subplots()
    at = found.time - found.time[0]
    seen = at < 20.0
    axis.plot(at[seen], 1e3 * found.measured[seen], '.', ms=3, label='encoder')
    axis.plot(at[seen], 1e3 * found.modelled[seen], lw=1, label='command after delay and lag')
    axis.set(xlabel='time, s', ylabel='wire, mm/s', title='wire behind the steps of speed')
    axis.legend(fontsize=8)
    return png(figure)


def figure_of(height: float) -> Figure:
    """An empty figure, 9 inches wide; height: inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """As a file."""
    out = io.BytesIO()
    figure.savefig(out, dpi=100, format='png')
    return out.getvalue()
