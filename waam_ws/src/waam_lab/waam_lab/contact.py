"""The true contact distance while metal is laid, exchange by exchange (10 ms), and the arcs that went out."""

from __future__ import annotations

import numpy as np

from waam_sim.arc import CTWD, LIT, REFERENCE_CTWD
from waam_sim.plant import OUTPUT_ARC, Plant

STRUCK = 1.0  # s after a strike from which on the distance is judged: the torch is on its way to it until then


class ContactTrace:
    """Listens to a cell of the laboratory. `errors`: contact distance less 15 mm (m), one per exchange with the arc
    burning, and the seconds since its strike; `lost`: arcs that went out although they were wanted."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, float]] = []
        self._since = 0.0
        self._lit = False
        self.lost = 0

    def on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        """samples (n,) of waam_process.plant_port.SAMPLE that the plant has just lived through."""
        lit = plant.arc.value(LIT) > 0.0
        if self._lit and not lit and samples['outputs'][-1] & OUTPUT_ARC:
            self.lost += 1
        if lit:
            self._since = self._since + 1e-3 * len(samples) if self._lit else 0.0
            self._rows.append((self._since, plant.arc.value(CTWD) - REFERENCE_CTWD))
        self._lit = lit

    @property
    def errors(self) -> np.ndarray:
        """(n, 2): s since the strike, m."""
        return np.array(self._rows, float).reshape(-1, 2)

    def judged(self) -> np.ndarray:
        """(n,) errors, m, from STRUCK s after each strike on."""
        errors = self.errors
        return errors[errors[:, 0] >= STRUCK, 1]

    @property
    def rms(self) -> float:
        """m; NaN when nothing is judged."""
        judged = self.judged()
        return float(np.sqrt(np.mean(judged**2))) if judged.size else float('nan')

    @property
    def least(self) -> float:
        """m: smallest contact distance of all, strikes included; NaN when no arc burned."""
        errors = self.errors
        return REFERENCE_CTWD + float(errors[:, 1].min()) if len(errors) else float('nan')

    @property
    def worst(self) -> float:
        """m: largest error either way."""
        judged = self.judged()
        return float(np.abs(judged).max()) if judged.size else float('nan')
