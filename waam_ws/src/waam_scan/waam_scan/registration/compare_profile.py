"""The height profile along a wall from a fused cloud, for comparison with what others measured on it."""

from __future__ import annotations

import numpy as np

from ..recordings.bead import WallError


def crest(
    points: np.ndarray,
    x: np.ndarray,
    window: float = 1.0e-3,
    slab: float = 0.2e-3,
    support: int = 10,
) -> np.ndarray:
    """Height of the wall's crest (n,) m at places x (n,) m along it; NaN where the cloud has nothing.

    points: (k, 3) m, wall along x. At each place: the highest point within `window` (m) of length under which, within
    `slab` (m), at least `support` points lie; so neither a spike nor spatter makes a crest.
    """
    order = np.argsort(points[:, 0])
    along, z = points[order, 0], points[order, 2]
    low = np.searchsorted(along, x - window / 2, 'left')
    high = np.searchsorted(along, x + window / 2, 'right')
    out = np.full(len(x), np.nan)
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        if b - a < support:
            continue
        top = np.sort(z[a:b])[::-1]
        dense = np.flatnonzero(top[: len(top) - support + 1] - top[support - 1 :] <= slab)
        if len(dense):
            out[i] = top[dense[0]]
    return out


def level(points: np.ndarray) -> np.ndarray:
    """The cloud (n, 3) m turned and shifted so that its substrate is z = 0. WallError when there is none."""
    from ..recordings.wall import fit_substrate

    plane = fit_substrate(points)
    if not plane.scatter < 0.5e-3:
        raise WallError(f'no substrate: its points scatter by {plane.scatter * 1e3:.2f} mm')
    return (points - [0.0, 0.0, plane.a]) @ plane.rotation.T
