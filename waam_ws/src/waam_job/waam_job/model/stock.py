"""What a machined part still carries: whether it cleans up, and how much stock is to be removed where. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from waam_plan import finish, masks
from waam_plan.plan import Plan

TOP_UP_BELOW = 0.05e-3  # m above nominal, lower places are topped up: a scan's noise


@dataclass(frozen=True)
class Stock:
    """Lengths in m; NaN where nothing was seen."""

    share: (
        float  # of the needed area at or above nominal, 0..1; what is not laid or not seen is below
    )
    below: float  # m, of the lowest place below nominal; 0 = none
    x: float  # m, of that place
    y: float
    mean: float  # m to remove, over what was laid
    high: float  # m, 99 % of it have less
    volume: float  # m3 above nominal, on the part
    allowance: float  # m, aimed at

    @property
    def cleans_up(self) -> bool:
        """Enough of the needed area is at or above nominal."""
        return self.share >= finish.CLEAN_SHARE

    @property
    def text(self) -> str:
        """For people."""
        share = math.floor(1e3 * self.share + 1e-9) / 10  # no 100.0 % with a place below
        said = f'{share:.1f}% of the needed area at or above nominal'
        if self.below > 0:
            place = f'x = {self.x * 1e3:.1f} mm, y = {self.y * 1e3:.1f} mm'
            said += f', lowest {self.below * 1e3:.2f} mm below at {place}'
        return (
            f'{said}; to machine: mean {self.mean * 1e3:.2f} mm, 99 % {self.high * 1e3:.2f} mm, '
            f'{self.volume * 1e6:.1f} cm3'
        )

    def facts(self) -> dict[str, Any]:
        """For report.json (docs/job_folder.md)."""
        lengths = {
            f'{n}_mm': getattr(self, n) * 1e3
            for n in ('below', 'x', 'y', 'mean', 'high', 'allowance')
        }
        return {'share': self.share, **lengths, 'volume_cm3': self.volume * 1e6}


def needed_area(plan: Plan) -> np.ndarray:
    """bool (rows, cols) of the plan's grid: where the part as found lacks metal."""
    return finish.needed_area(plan.as_found, plan.nominal)


def counted_area(plan: Plan) -> np.ndarray:
    """The same, each place once: of a shaft that of one turn."""
    needed, shaft = needed_area(plan), plan.settings.unrolled
    return needed & shaft.first_turn(plan.spec) if shaft else needed


def low_places(plan: Plan, z: np.ndarray) -> np.ndarray:
    """bool (rows, cols): needed and lower than TOP_UP_BELOW above nominal. z: (rows, cols) m, of the last scan; plan:
    that of the first pass. What was not seen counts as low."""
    return needed_area(plan) & ~(z - plan.nominal.z >= TOP_UP_BELOW)


def stock_of(plan: Plan, z: np.ndarray) -> Stock:
    """z: (rows, cols) m, the surface after the last layer; plan: that of the first pass."""
    needed, over = counted_area(plan), z - plan.nominal.z
    share = float((over[needed] >= 0).mean()) if needed.any() else 1.0
    low = np.where(needed & np.isfinite(over), over, np.inf)
    row, col = np.unravel_index(int(np.argmin(low)), low.shape)
    laid = plan.region & np.isfinite(over) & ~masks.flanks(plan.nominal.z, plan.spec.resolution)
    some = over[laid] if laid.any() else np.array([math.nan])
    return Stock(
        share=share,
        below=max(0.0, -float(low[row, col])),
        x=float(plan.spec.x[col]),
        y=float(plan.spec.y[row]),
        mean=float(some.mean()),
        high=float(np.quantile(some, 0.99)),
        volume=float(np.clip(over[laid], 0.0, None).sum()) * plan.spec.resolution**2,
        allowance=plan.settings.allowance,
    )
