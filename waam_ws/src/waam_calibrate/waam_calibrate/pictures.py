"""Pictures of a resonance: the spectrum without and with each shaper, and what was measured. PNG bytes."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from . import shapers
from .resonance import Resonance

if TYPE_CHECKING:  # matplotlib is loaded only when something is drawn
    from matplotlib.figure import Figure


def spectra(found: Resonance) -> bytes:
    """Gain of the axis, and what each candidate leaves of it."""
    figure = _figure(4.6)
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
    return _png(figure)


def measured(found: Resonance) -> bytes:
    """Power spectral density of the three channels as measured."""
    figure = _figure(3.4)
    axis = figure.subplots()
    for i, name in enumerate('xyz'):
        axis.semilogy(found.hz, np.maximum(found.raw[:, i], 1e-12), lw=1, label=name)
    axis.set(xlabel='frequency, Hz', ylabel='PSD, m²/s³', title='acceleration as measured')
    axis.legend(fontsize=8)
    return _png(figure)


def _figure(height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, dpi=100, format='png')
    return out.getvalue()
