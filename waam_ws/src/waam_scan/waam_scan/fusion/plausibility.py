"""Whether a map may be trusted for a correction. Every doubt is a sentence; an empty list means plausible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .height_map import FusedMap


@dataclass(frozen=True)
class PlausibilityLimits:
    """From where on a map is not trusted."""

    min_coverage: float = 0.5  # known share of the cells
    max_coverage_loss: float = 0.4  # against the previous map
    max_residual: float = 0.2e-3  # m, scatter of points in a cell
    max_growth: float = 6e-3  # m per layer and cell
    max_shrink: float = 1e-3  # m per layer and cell
    # of the common cells, that may exceed these two: edges of the part, spatter
    max_jump_share: float = 0.05
    max_age: float = 0.5  # s between the last profile used and the end of the scan
    # share of profiles that may be rejected, and of batches that may be lost
    max_rejected: float = 0.2


def map_reasons(fused: FusedMap, limits: PlausibilityLimits) -> list[str]:
    """Doubts from the map alone."""
    reasons = []
    if fused.coverage < limits.min_coverage:
        reasons.append(
            f'coverage {fused.coverage:.1%} of the grid is below the limit {limits.min_coverage:.1%}'
        )
    if fused.residual > limits.max_residual:
        reasons.append(
            f'points scatter by {fused.residual * 1e3:.3f} mm in a cell, limit {limits.max_residual * 1e3:.3f} mm'
        )
    return reasons


def jump_reasons(
    fused: FusedMap, previous: np.ndarray, layers: int, limits: PlausibilityLimits
) -> list[str]:
    """Doubts from the change against the previous map (rows, cols; m, NaN = unknown) of `layers` layers ago.

    Metal only grows, and by a bead per layer at most; a map that says otherwise has slipped (pose, mounting, zero).
    """
    reasons = []
    growth = (fused.z - previous)[np.isfinite(fused.z) & np.isfinite(previous)]
    if growth.size == 0:
        return ['no cell is known in both this map and the one before']
    high, low = limits.max_growth * max(layers, 0) + limits.max_shrink, -limits.max_shrink
    for share, text in (
        (np.mean(growth > high), f'grew by more than {high * 1e3:.2f} mm'),
        (np.mean(growth < low), f'sank by more than {-low * 1e3:.2f} mm'),
    ):
        if share > limits.max_jump_share:
            reasons.append(
                f'{share:.1%} of the cells {text} since the map before, limit {limits.max_jump_share:.1%}'
            )
    loss = float(np.isfinite(previous).mean()) - fused.coverage
    if loss > limits.max_coverage_loss:
        reasons.append(
            f'coverage fell by {loss:.1%} since the map before, limit {limits.max_coverage_loss:.1%}'
        )
    return reasons


def stream_reasons(
    used: int, rejected: int, batches: int, lost: int, age: float, limits: PlausibilityLimits
) -> list[str]:
    """Doubts from how the profiles came: used and rejected profiles, received and lost batches, age (s) of the last
    profile used at the end of the scan."""
    reasons = []
    for bad, all_of, text in (
        (rejected, used + rejected, 'profiles were rejected'),
        (lost, batches + lost, 'batches of profiles were lost'),
    ):
        if bad > limits.max_rejected * all_of:
            reasons.append(f'{bad} of {all_of} {text}, limit {limits.max_rejected:.0%}')
    if age > limits.max_age:
        reasons.append(
            f'the last profile is {age:.2f} s older than the end of the scan, limit {limits.max_age:.2f} s'
        )
    return reasons
