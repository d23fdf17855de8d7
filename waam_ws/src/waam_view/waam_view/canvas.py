"""What all pictures of the report share: size, style, colours, and how they become PNG."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.figure import Figure

GRID, INK, BLUE, RED, GREEN, GREY = '#d9dde2', '#1f2933', '#1c6fb8', '#c23b31', '#23833f', '#8a94a0'
DPI = 130


def new_figure(width: float, height: float) -> Figure:
    """A figure without a screen; inches."""
    return Figure(figsize=(width, height), layout='constrained')


def png(figure: Figure) -> bytes:
    """The picture as a file."""
    out = io.BytesIO()
    figure.savefig(out, format='png', dpi=DPI)
    return out.getvalue()


def style(axes: Axes, x: str = '', y: str = '') -> None:
    """Grid, no frame at the top and right, names of the axes."""
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)
    axes.tick_params(labelsize=8, colors=INK)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
