"""The width of a bead that stands free, from laser profiles across it, with its uncertainty.

Every profile gives one width: that of a parabola (the section of a bead, source 000) fitted to what stands above the
metal beside it. What lies beside other beads has no foot of its own; such profiles are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CAP = 0.25  # share of the crown's height above which points belong to the section
LOWEST = 0.3e-3  # m: lower crowns are no bead
BLOCK = 10e-3  # m along the bead over which widths go together
FEWEST = 12  # points of a section


class WidthError(ValueError):
    """No width can be told; the text says why."""


@dataclass(frozen=True)
class BeadWidth:
    """Mean over the middle of a bead."""

    width: float  # m
    u: float  # m, standard uncertainty of the mean: the scatter of the bead along its length, and of the fits
    profiles: int  # that gave a width


def section_width(across: np.ndarray, z: np.ndarray, reach: float) -> tuple[float, float]:
    """Width (m) and its standard uncertainty of the bead in one profile; across (n,) m from the path, z (n,) m.

    reach: m to either side in which the bead and the metal beside it are looked for. NaN where there is no free bead.
    """
    nothing = (float('nan'), float('nan'))
    known = np.isfinite(z) & np.isfinite(across)
    left, right = (
        known & (side * across > 0.75 * reach) & (side * across < reach) for side in (-1, 1)
    )
    if left.sum() < FEWEST // 2 or right.sum() < FEWEST // 2:
        return nothing
    base = np.median(z[left]), np.median(z[right])
    slope = (base[1] - base[0]) / (np.median(across[right]) - np.median(across[left]))
    height = z - (base[0] + slope * (across - np.median(across[left])))
    near = known & (np.abs(across) < 0.75 * reach)
    if near.sum() < FEWEST:
        return nothing
    top = float(np.quantile(height[near], 0.95))
    use = near & (height > CAP * top)
    if top < LOWEST or use.sum() < FEWEST:
        return nothing
    return _foot(across[use], height[use])


def _foot(across: np.ndarray, height: np.ndarray) -> tuple[float, float]:
    """Width between the zeros of the parabola, spikes left out; and its uncertainty by that of the coefficients."""
    nothing = (float('nan'), float('nan'))
    scale, keep = 1e-3, np.ones(len(across), bool)
    x = across / scale
    for _ in range(3):
        if keep.sum() < FEWEST:
            return nothing
        p, covariance = np.polyfit(x[keep], height[keep], 2, cov=True)
        off = np.abs(height - np.polyval(p, x))
        keep = off <= 4 * 1.4826 * np.median(off[keep]) + 1e-9
    a, b, c = p
    square = b * b - 4 * a * c
    if a >= 0 or square <= 0:
        return nothing
    root = np.sqrt(square)
    width = root / -a
    by_coefficient = np.array([-width / a + 2 * c / (a * root), -b / (a * root), 2 / root])
    u = np.sqrt(by_coefficient @ covariance @ by_coefficient)
    return scale * float(width), scale * float(u)


def bead_width(
    points: np.ndarray,
    start: tuple[float, float],
    end: tuple[float, float],
    reach: float = 9e-3,
    ends: float = 10e-3,
) -> BeadWidth:
    """points (n, m, 3) m: n profiles in the work frame, NaN = no echo. start, end: of the bead's path, m.

    ends: m at each end that do not count (start hump, crater). WidthError when fewer than three profiles show it.
    """
    way = np.subtract(end, start, dtype=float)
    length = float(np.hypot(*way))
    if not length > 2 * ends:
        raise WidthError(
            f'a bead of {1e3 * length:.1f} mm is too short: {2e3 * ends:.0f} mm are its ends'
        )
    unit = way / length
    rows = []
    for profile in np.asarray(points, float):
        offset = profile[:, :2] - start
        along = float(np.nanmedian(offset @ unit)) if np.isfinite(offset).any() else np.nan
        if not ends <= along <= length - ends:
            continue
        width, u = section_width(offset @ np.array([-unit[1], unit[0]]), profile[:, 2], reach)
        if np.isfinite(width):
            rows.append((along, width, u))
    if len(rows) < 3:
        raise WidthError(
            f'{len(rows)} of {len(points)} profiles show a free bead, at least 3 are needed'
        )
    along, widths, us = np.array(rows).T
    return BeadWidth(float(widths.mean()), _mean_u(along, widths, us), len(rows))


def _mean_u(along: np.ndarray, widths: np.ndarray, us: np.ndarray) -> float:
    """Widths within BLOCK go together, so the scatter is that of the means over blocks."""
    blocks = np.floor((along - along.min()) / BLOCK).astype(int)
    means = np.array([widths[blocks == b].mean() for b in np.unique(blocks)])
    scatter = means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else widths.std(ddof=1)
    return float(np.hypot(scatter, np.sqrt(np.sum(us**2)) / len(us)))
