"""A single bead on a flat substrate: where it lies on a map, and how high its crown is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fusion.height_map import FusedMap

CROWN = 1.2e-3  # m, half width of the parabola that is fitted to the crown
STRIP = (6e-3, 14e-3)  # m from the axis, where the substrate is seen
ENDS = 8e-3  # m at each end that do not count: start hump and end crater


class WallError(ValueError):
    """Recordings that do not fit together or show no bead; the text says what was looked for."""


@dataclass(frozen=True)
class Bead:
    """Where the new bead lies on a map."""

    axis: float  # m, y of its centre line
    start: float  # m, x of half height
    end: float  # m


def find_bead(before: FusedMap, after: FusedMap) -> Bead:
    """The bead that is on `after` and not on `before` (same grid)."""
    growth = np.nan_to_num(after.z - before.z, nan=0.0)
    spec = after.spec
    near = 0.5 * np.percentile(growth[growth > 1e-3], 90) if (growth > 1e-3).sum() > 20 else None
    if near is None:
        raise WallError('no bead appears between the first and the last scan')
    rows, cols = np.nonzero(_largest_run(growth > near))
    weight = growth[rows, cols]
    axis = float(np.average(spec.y[rows], weights=weight))
    return Bead(axis, float(spec.x[cols.min()]), float(spec.x[cols.max()]))


def _largest_run(mask: np.ndarray) -> np.ndarray:
    """Keeps the rows around the fullest one that touch it without a break: one bead, not spatter elsewhere."""
    full = mask.sum(axis=1)
    best = int(np.argmax(full))
    low = high = best
    while low > 0 and full[low - 1] > 0.2 * full[best]:
        low -= 1
    while high < len(full) - 1 and full[high + 1] > 0.2 * full[best]:
        high += 1
    out = np.zeros_like(mask)
    out[low : high + 1] = mask[low : high + 1]
    return out


@dataclass(frozen=True)
class BeadTop:
    """Height of the crown above the substrate beside it, one value per profile."""

    x: np.ndarray  # (n,) m
    height: np.ndarray  # (n,) m
    u: np.ndarray  # (n,) m, standard uncertainty
    inner: np.ndarray  # (n,) bool, without the ends
    mean: float  # m, over the inner part
    mean_u: float  # m, its standard uncertainty


def crown(y: np.ndarray, z: np.ndarray) -> tuple[float, float]:
    """Highest value (m) of a parabola fitted to points (n,) across the crown, and its standard uncertainty.

    The fit is repeated without points further than four robust standard deviations. NaN with fewer than eight points.
    """
    use = np.ones(len(y), bool)
    for _ in range(3):
        if use.sum() < 8:
            return np.nan, np.nan
        p, covariance = np.polyfit(y[use], z[use], 2, cov=True)
        residual = np.abs(z - np.polyval(p, y))
        use = residual <= 4 * 1.4826 * np.median(residual[use]) + 1e-9
    low, high = float(y[use].min()), float(y[use].max())
    top = float(np.clip(-p[1] / (2 * p[0]), low, high)) if p[0] < 0 else (low if p[1] < 0 else high)
    basis = np.array([top * top, top, 1.0])
    return float(basis @ p), float(np.sqrt(basis @ covariance @ basis))


def bead_top(points: np.ndarray, bead: Bead) -> BeadTop:
    """Crown heights from profile points (n, m, 3) in the axes of the map, m.

    Substrate of a profile: median of its points in the strips beside the bead. u combines the fit of the crown and the
    scatter of the strip; the mean also carries the waviness of the substrate, which does not average out.
    """
    rows = []
    for profile in points:
        profile = profile[np.isfinite(profile).all(axis=1)]
        off = profile[:, 1] - bead.axis
        near, beside = np.abs(off) <= CROWN, (np.abs(off) >= STRIP[0]) & (np.abs(off) <= STRIP[1])
        if not near.any() or beside.sum() < 20:
            continue
        top, u_top = crown(off[near] / CROWN, profile[near, 2])
        strip = profile[beside, 2]
        base = float(np.median(strip))
        scatter = 1.4826 * float(np.median(np.abs(strip - base)))
        u_base = 1.25 * scatter / np.sqrt(len(strip))  # standard error of a median
        rows.append((float(np.median(profile[near, 0])), top - base, np.hypot(u_top, u_base), base))
    x, height, u, base = np.array(rows).reshape(-1, 4)[np.argsort([r[0] for r in rows])].T
    use = (x >= bead.start) & (x <= bead.end) & np.isfinite(height)
    inner = (x >= bead.start + ENDS) & (x <= bead.end - ENDS) & use
    if inner.sum() < 3:
        raise WallError('fewer than three profiles show the bead between its ends')
    waviness = float(np.std(base[inner]))
    mean_u = float(np.hypot(np.sqrt(np.sum(u[inner] ** 2)) / inner.sum(), waviness))
    return BeadTop(x[use], height[use], u[use], inner[use], float(np.mean(height[inner])), mean_u)
