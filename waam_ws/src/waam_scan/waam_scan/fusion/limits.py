"""What the fusion may expect of a surface and of its scanner."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FusionLimits:
    """Lengths in m, heights in the work frame."""

    height_min: float = -0.05  # points below are counted as outside
    height_max: float = 0.30  # points above are counted as outside
    noise: float = 50e-6  # scatter of the scanner, used while the data do not show it
    spike_factor: float = 4.0  # robust standard deviations from the cell's level to a spike
    support: float = 0.6e-3  # cells with fewer than four points need a neighbour this close
    slots: int = 16  # points in the sample of a cell
