"""What the plan of a restoration cannot reach, in words with figures and places."""

from __future__ import annotations

import numpy as np

from waam_plan import masks
from waam_plan.layers.restored_layers import Restoration
from waam_plan.plan import UNLIKE, PlannedLayer, metal_of
from waam_process.grid import GridSpec, HeightGrid

WALL = 1.0e-3  # m to the side of a wall, within which a height says nothing about the metal
SPOT = 2e-6  # m2, smaller places are no places


def warn(
    job: Restoration,
    planned: list[PlannedLayer],
    complete: bool,
    nominal: HeightGrid,
    warnings: list[str],
) -> None:
    """Warns of what the plan cannot reach, with figures and places.

    A wall of the part hides what lies within WALL of it: there a shift of a cell is a step of the whole wall, and no
    metal. So the surface stands above nominal only where it stands above all that is wanted within that distance, and
    metal is missing only where it is missing from all that was found there.
    """
    settings, spec, missing = job.settings, nominal.spec, job.wanted - job.found
    cells = WALL / spec.resolution
    if not planned:
        warnings.append(
            f'nothing to restore: nowhere more than {settings.min_layer * settings.layer_height * 1e3:.2f} mm is '
            f'missing (largest depth {np.nanmax(missing) * 1e3:.2f} mm)'
        )
    above = masks.drop_spots(job.found - masks.highest_near(job.wanted, cells), SPOT, spec)
    least = settings.min_layer * settings.layer_height
    if above.max() > least:
        warnings.append(
            f'the surface stands up to {above.max() * 1e3:.2f} mm above nominal, {_where(above, least, spec)}; '
            'deposition cannot lower it, machine it first'
        )
    if complete and planned:
        laid = np.sum([p.planned for p in planned], axis=0)
        missing = job.wanted - masks.highest_near(job.found, cells) - laid
        short = masks.drop_spots(np.where(job.count > 0, missing, 0.0), SPOT, spec)
        if short.max() > 0.1 * settings.layer_height:
            warnings.append(
                f'the thickest layer limits the metal; {short.max() * 1e3:.2f} mm stay missing, '
                f'{_where(short, 0.1 * settings.layer_height, spec)}'
            )
    for layer in planned:
        want = metal_of(layer, spec, settings)
        if abs(layer.volume - want) > UNLIKE * want:
            warnings.append(
                f'layer {layer.number}: segments lay {layer.volume * 1e9:.0f} mm3 of {want * 1e9:.0f} mm3 planned '
                '(limits of layer height)'
            )


def _where(height: np.ndarray, limit: float, spec: GridSpec) -> str:
    """The island with the highest cell, of those above `limit`: its area, and the place of the cell."""
    row, col = np.unravel_index(int(np.argmax(height)), height.shape)
    labels = masks.label(height > limit)
    area = (labels == labels[row, col]).sum() * spec.resolution**2 * 1e6
    at = f'x = {spec.x[col] * 1e3:.1f} mm, y = {spec.y[row] * 1e3:.1f} mm'
    return f'on {area:.0f} mm2 around {at}'
