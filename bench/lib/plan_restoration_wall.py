"""A recorded wall as a worn surface: planned layer by layer, laid on the simulated cell, scanned and planned again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .paths import DATA
from .plan_checks import field, lay

CLOUD = DATA / 'wall_scan' / 'x_1610_cloud.pcd'
TOLERANCE = 0.2e-3
CELL = 0.4e-3  # m, of the simulated field
MOST = 12  # layers
FINE = {'bead_width': 5e-3, 'layer_height': 1e-3, 'pitch_ratio': 0.5, 'stagger': True}
EDGE = 0.75  # bead widths beside the edge that are judged apart


@dataclass(frozen=True)
class Restored:
    """Shares of the area within the tolerance, inside and along the edges; p95 of the absolute error, m."""

    share: float
    p95: float
    edges: float
    layers: int
    error: np.ndarray  # (rows, cols) m, NaN outside the zone
    depth: np.ndarray  # (rows, cols) m, missing before


def run(strategy: str = 'solid', **overrides) -> Restored:
    """Restore the scanned zone to a plane one layer above its crest."""
    from waam_plan import masks
    from waam_plan.layers.restore import plan_restoration
    from waam_plan.mesh.clouds import read_cloud
    from waam_plan.mesh.inputs import flat
    from waam_plan.settings import PlanSettings
    from waam_process.grid import HeightGrid

    settings = PlanSettings(strategy=strategy, **{**FINE, **overrides})
    zone = flat(read_cloud(CLOUD), settings)
    plan = plan_restoration(zone.found, zone.nominal, settings)
    surface = masks.fill_unknown(zone.found.z)
    metal = field(plan, CELL, _onto(HeightGrid(zone.found.spec, surface), CELL))
    clock, layers, found = 0.0, 0, zone.found
    while plan.layers and layers < MOST:
        for s in plan.layers[0].segments:
            if s.arc and s.length > 0:
                clock = lay(metal, s, clock)
            clock += 1.0
        layers += 1
        found = _scan(metal, found.spec)
        plan = plan_restoration(found, zone.nominal, settings, laid=layers)
    return _judged(found, zone, settings, layers)


def _onto(grid, cell: float) -> np.ndarray:
    """Heights of a grid on cells of another size over the same extent."""
    from waam_process.grid import GridSpec

    x0, x1, y0, y1 = grid.spec.extent
    spec = GridSpec.covering(x0, y0, x1, y1, cell)
    x, y = np.meshgrid(spec.x, spec.y)
    return grid.sample(np.minimum(x, x1 - 1e-9), np.minimum(y, y1 - 1e-9))


def _scan(metal, spec):
    """The simulated surface on the plan's grid."""
    from waam_process.grid import HeightGrid

    x, y = np.meshgrid(spec.x, spec.y)
    return HeightGrid(spec, metal.grid().sample(x, y))


def _judged(found, zone, settings, layers: int) -> Restored:
    from waam_plan import masks

    part = np.isfinite(zone.nominal.z)
    inner = masks.shrink(part, EDGE * settings.bead_width / found.spec.resolution)
    error = np.where(part, found.z - zone.nominal.z, np.nan)
    within = np.abs(error) <= TOLERANCE
    return Restored(
        share=float(within[inner].mean()),
        p95=float(np.percentile(np.abs(error[inner]), 95)),
        edges=float(within[part & ~inner].mean()),
        layers=layers,
        error=np.where(part, error, np.nan),
        depth=zone.nominal.z - zone.found.z,
    )
