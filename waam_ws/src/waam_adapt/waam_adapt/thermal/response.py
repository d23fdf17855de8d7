"""Does the temperature answer to the arc? A reading that stays cold while a layer is laid is not of that layer.

The least rise that a spot within reach of the beads must show is that of a half-infinite body of the same metal, the
largest heat sink that there is: every real part, being finite, gets warmer. See `waam_process.heat.least_peak_rise`.
Times s, temperatures degC; pure.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from waam_process.heat import ArcPass, least_peak_rise
from waam_process.materials import Material

MAX_SPOT_DISTANCE = (
    12e-3  # m from the spot to the nearest bead at which it counts as on the layer: two bead widths
)
SHARE = 0.5  # of the least rise that must be seen: lag, emissivity and the share of the arc's heat are known roughly
NOISE = 5.0  # K; a rise that small cannot be told from noise
BEFORE = 3.0  # s before the arc that say how warm the spot was


@dataclass(frozen=True)
class LaidLayer:
    """A layer that the arc has laid. end: time of its end, s."""

    number: int
    end: float
    arc: ArcPass


class ResponseWatch:
    """Compares the rise of the temperature during a layer with what its arc must have brought.

    `add` every believed reading; `layer_begins` before the arc, `layer_ends` after it; `doubt` at any time.
    """

    def __init__(self, material: Material) -> None:
        self.material = material
        self._recent: deque[tuple[float, float]] = deque(maxlen=1000)
        self.forget()

    def forget(self) -> None:
        """A new job: nothing is known against the spot."""
        self._before = self._peak = math.nan
        self._watching = False
        self._laid: LaidLayer | None = None
        self._doubt = ''

    def add(self, time: float, temperature: float) -> None:
        """A reading: time s, temperature degC; times rise."""
        self._recent.append((time, temperature))
        while self._recent[0][0] < time - BEFORE:
            self._recent.popleft()
        if self._watching:
            self._peak = float(np.fmax(self._peak, temperature))
            if math.isnan(self._before):
                self._before = temperature
        if self._laid and time >= self._laid.end + self._delay:
            self._judge()

    def layer_begins(self) -> None:
        """From here on the temperature should rise above what it was in the last seconds."""
        self._watching, self._laid = True, None
        self._before = float(np.median([t for _, t in self._recent])) if self._recent else math.nan
        self._peak = math.nan

    def layer_ends(self, layer: LaidLayer) -> None:
        """Judged once the heat of the last bead has had time to reach the spot."""
        if self._watching and layer.arc.energy > 0:
            self._laid = layer

    def doubt(self) -> str:
        """Why the temperature is not believed, in words; '' = nothing is known against it."""
        return self._doubt

    @property
    def _delay(self) -> float:
        """s that heat needs to spread over MAX_SPOT_DISTANCE: MAX_SPOT_DISTANCE^2/(4 a)."""
        return MAX_SPOT_DISTANCE**2 / (4 * self.material.diffusivity)

    def _judge(self) -> None:
        laid = self._laid
        self._watching, self._laid = False, None
        if laid is None or math.isnan(self._peak - self._before):
            return
        m = self.material
        least = least_peak_rise(laid.arc, MAX_SPOT_DISTANCE, m.conductivity, m.diffusivity)
        rise = self._peak - self._before
        if SHARE * least < NOISE:
            return  # too little heat to tell
        if rise >= SHARE * least:
            self._doubt = ''
            return
        self._doubt = (
            f'layer {laid.number} brought {laid.arc.energy * 1e-3:.0f} kJ of heat, but the temperature rose by '
            f'{max(rise, 0.0):.0f} K only, from {self._before:.0f} degC; within '
            f'{MAX_SPOT_DISTANCE * 1e3:.0f} mm of a bead it rises by {least:.0f} K at least: '
            'the spot of the pyrometer does not lie on the layer'
        )
