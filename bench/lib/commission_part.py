"""The first part after a commissioning, by what truly lies on the table of the simulated cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from std_srvs.srv import Trigger

from waam_bringup.client import GraphClient
from waam_bringup.commission_hand import PAD_MM, worn_pad
from waam_process.grid import HeightGrid

CLEAN = 0.99  # share of the needed area at or above nominal
STOCK_MM = 2.0  # that may stand on 99 % of it: one layer
NEEDED_MM = 0.2  # of metal that the worn part lacks, where it counts
RIM_MM = 3.0


@dataclass(frozen=True)
class Truth:
    """clean: share of the needed area at or above nominal; stock_mm: above nominal on 99 % of it."""

    clean: float
    stock_mm: float

    @property
    def good(self) -> bool:
        """It cleans up, and no more than a layer is to be machined off."""
        return self.clean >= CLEAN and self.stock_mm <= STOCK_MM


def truth(client: GraphClient) -> Truth:
    """Of the pad on the table now."""
    answer = client.call(Trigger, 'cell/save_truth', Trigger.Request())
    assert answer.success, answer.message
    return judged(HeightGrid.load_npz(Path(answer.message)))


def judged(surface: HeightGrid) -> Truth:
    """surface: m, work frame, the corner of the pad at zero."""
    x, y = np.meshgrid(1e3 * surface.spec.x, 1e3 * surface.spec.y)
    length, width, height = PAD_MM
    inside = (x > RIM_MM) & (x < length - RIM_MM) & (y > RIM_MM) & (y < width - RIM_MM)
    needed = inside & (worn_pad(x, y) < height - NEEDED_MM)
    over = 1e3 * surface.z[needed] - height
    return Truth(float(np.mean(over >= -0.05)), float(np.quantile(over, 0.99)))
