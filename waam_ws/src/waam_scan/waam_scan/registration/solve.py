"""The rigid motion between two scans, or between a scan and its nominal surface, when metal was added or is missing.

Open3D estimates the motion (point-to-plane, Tukey's kernel, `icp.py`). This module adds what the library lacks:

* Growth is not motion. New metal only ever lies above the old surface: the start is the lowest surface that enough
  points agree on, the kernel follows the noise of the clouds, and the edges of what has grown are left out.
* Motions that the shape does not show (sliding on a plane, turning a shaft) are taken back and named (solution
  remapping, Zhang, Kaess and Singh 2016; `observed.py`).
* The covariance is a sandwich over patches of the surface, so that errors that neighbours share count once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..calibration.robust import robust_scatter, tukey_weights, turn_vector, turned
from .changes import changed_places, unchanged_level
from .icp import Icp
from .observed import TOLERANCE, covariance, shown_motions, too_wide
from .result import Registration, RegistrationError
from .target import Cloud, CloudTarget, Target
from .words import free_motions

POINTS = 40_000  # of the moving cloud
TUKEY = 4.685
ALIKE = 0.85  # cosine between the normals of two points that belong together
FIRST = 1.0e-3  # m, first limit where metal was added or is missing: a wider one would follow it
ROUGH_ITERATIONS, ITERATIONS = 8, 50  # of Open3D, on the way and at the end
LAST_STEPS = 4  # estimates with what has changed left out
RESTED = 0.1  # tolerances by which the last estimate may move
LEAST_PAIRS = 100
CHANGES = ('growth', 'wear', 'any')


@dataclass
class _Fit:
    """Points that are fitted and the motion so far, about `centre`."""

    cloud: Cloud
    target: Target
    centre: np.ndarray
    rotation: np.ndarray
    shift: np.ndarray  # of the centre
    keep: np.ndarray  # (n,) bool, points that may take part

    def moved(self) -> np.ndarray:
        return (self.cloud.points - self.centre) @ self.rotation.T + self.centre + self.shift

    def pairs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Signed distances (n,), rows of both clouds' normals (n, 6; in tolerances), and which pairs are good (n,)."""
        p = self.moved()
        m = self.target.match(p)
        r = np.einsum('ij,ij->i', p - m.foot, m.normal)
        arm = p - self.centre - self.shift
        own = self.cloud.normals @ self.rotation.T
        rows = np.column_stack([m.normal, np.cross(arm, m.normal)]) * TOLERANCE
        other = (
            rows if self.target.exact else np.column_stack([own, np.cross(arm, own)]) * TOLERANCE
        )
        alike = np.einsum('ij,ij->i', own, m.normal)
        if self.target.exact:
            alike = np.abs(alike)  # an open mesh has no known inside
        return r, rows, other, self.keep & m.ok & (alike > ALIKE)

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) m."""
        m = np.eye(4)
        m[:3, :3] = self.rotation
        m[:3, 3] = self.centre + self.shift - self.rotation @ self.centre
        return m

    def step_to(self, matrix: np.ndarray) -> np.ndarray:
        """(6,) in tolerances: the motion from here to a placement (4, 4)."""
        shift = matrix[:3, :3] @ self.centre + matrix[:3, 3] - self.centre - self.shift
        return np.concatenate([shift, turn_vector(matrix[:3, :3] @ self.rotation.T)]) / TOLERANCE

    def move(self, step: np.ndarray) -> None:
        step = step * TOLERANCE
        self.shift = self.shift + step[:3]
        self.rotation = turned(step[3:]) @ self.rotation


def register(
    moving: Cloud | np.ndarray,
    reference: Cloud | Target | np.ndarray,
    change: str = 'growth',
    reach: float = 3e-3,
    start: np.ndarray | None = None,
    points: int = POINTS,
    seed: int = 0,
) -> Registration:
    """The motion that brings `moving` onto `reference`.

    moving: (n, 3) m or Cloud; reference: the same, or a Target (MeshTarget for a nominal part); change: how the moving
    cloud may differ besides: 'growth' (metal was added), 'wear' (is missing), 'any'; reach: m, largest motion that is
    looked for; start: (4, 4) first guess; points: so many of the moving cloud are used.
    Raises RegistrationError when the surfaces do not meet.
    """
    if change not in CHANGES:
        raise RegistrationError(f'change must be one of {", ".join(CHANGES)}, not {change!r}')
    cloud = moving if isinstance(moving, Cloud) else Cloud.of(moving, seed=seed)
    if isinstance(reference, np.ndarray):
        reference = Cloud.of(reference, seed=seed)
    target = CloudTarget(reference) if isinstance(reference, Cloud) else reference
    whole, cloud = cloud, cloud.take(points, np.random.default_rng(seed))
    fit = _begin(cloud, target, start)
    before = fit.pairs()
    if before[3].sum() < 200:
        raise RegistrationError(
            f'only {int(before[3].sum())} of {len(before[0])} points have a partner on the reference: do the clouds '
            'overlap, in the same unit? (--search looks for the part anywhere)'
        )
    fit.shift = fit.shift + _to_level(fit, change, reach)
    noise, converged = _descend(fit, target.icp(whole), change, reach)
    return _result(fit, noise, converged, before)


def _begin(cloud: Cloud, target: Target, start: np.ndarray | None) -> _Fit:
    start = np.eye(4) if start is None else np.asarray(start, float)
    centre = cloud.points.mean(axis=0)
    shift = start[:3, :3] @ centre + start[:3, 3] - centre
    return _Fit(cloud, target, centre, start[:3, :3], shift, np.ones(len(cloud.points), bool))


def _to_level(fit: _Fit, change: str, reach: float) -> np.ndarray:
    """Shift (3,) m along the mean normal onto the surface that did not change."""
    r, rows, _, good = fit.pairs()
    near = good & (np.abs(r) < reach)
    if near.sum() < 200:
        raise RegistrationError(
            f'only {int(near.sum())} points lie within {reach * 1e3:.1f} mm of the reference (--reach, --search)'
        )
    normal = rows[near, :3].mean(axis=0) / TOLERANCE[0]
    length = float(np.linalg.norm(normal))
    if length < 0.5:  # surfaces all around hold the cloud in place
        return np.zeros(3)
    return -normal / length * unchanged_level(r[near], change, reach)


def _descend(fit: _Fit, icp: Icp, change: str, reach: float) -> tuple[float, bool]:
    """Narrows the kernel step by step. Returns the noise of the pairs and whether the last step converged."""
    own = float(np.hypot(fit.cloud.noise, fit.target.noise))
    limit = reach if change == 'any' else min(reach, FIRST)
    keep = np.ones(len(icp.points), bool)
    while limit > 1.2 * TUKEY * own:
        _step(fit, icp, limit, own, keep, ROUGH_ITERATIONS)
        limit *= 0.5
    noise = _step(fit, icp, TUKEY * own, own, keep, ITERATIONS)[1]
    r, _, _, good = fit.pairs()
    fit.keep = ~changed_places(fit.cloud.points, r, good, change, TUKEY * noise)
    keep = fit.keep[cKDTree(fit.cloud.points).query(icp.points, workers=2)[1]]
    for _ in range(LAST_STEPS):
        length, noise = _step(fit, icp, TUKEY * noise, noise, keep, ITERATIONS)
        if length < RESTED:
            break
    return noise, length < RESTED


def _step(
    fit: _Fit, icp: Icp, limit: float, noise: float, keep: np.ndarray, iterations: int
) -> tuple[float, float]:
    """Open3D's estimate, as far as the shape shows it: its largest component in tolerances, and the noise after it."""
    step = fit.step_to(icp.align(fit.matrix, limit, iterations, keep))
    r, rows, other, good = fit.pairs()
    w = np.where(good, tukey_weights(r, limit), 0.0)
    if (w > 0).sum() < LEAST_PAIRS:
        raise RegistrationError(
            f'the surfaces do not agree anywhere within {limit * 1e3:.2f} mm: start or --reach is wrong'
        )
    shown, _ = shown_motions((other * w[:, None]).T @ rows, rows, other, w, noise)
    step = shown @ (shown.T @ step)
    fit.move(step)
    return float(np.abs(step).max()), _noise(fit, noise)


def _noise(fit: _Fit, before: float) -> float:
    """Robust scatter (m) of the pairs that the noise so far explains; at most half as much again."""
    own = float(np.hypot(fit.cloud.noise, fit.target.noise))
    r, _, _, good = fit.pairs()
    near = good & (np.abs(r) < 3 * before)
    return max(float(np.clip(robust_scatter(r[near]) * 1.05, 0.7 * own, 1.5 * before)), 1e-6)


def _result(
    fit: _Fit, noise: float, converged: bool, before: tuple[np.ndarray, ...]
) -> Registration:
    r, rows, other, good = fit.pairs()
    w = np.where(good, tukey_weights(r, TUKEY * noise), 0.0)
    cross = (other * w[:, None]).T @ rows
    shown, hidden = shown_motions(cross, rows, other, w, noise)
    spread = covariance(fit.cloud.points, other * (w * r)[:, None], cross, shown)
    wide = too_wide(spread, shown)
    hidden = np.hstack([hidden, shown @ wide])
    physical = hidden * TOLERANCE[:, None]
    spread = spread * np.outer(TOLERANCE, TOLERANCE)
    open_ = (np.abs(hidden) > 1e-3).any(axis=1)
    spread[open_, open_] = np.inf
    everywhere = fit.target.match(fit.moved())
    compared = everywhere.ok
    changed = compared & (np.abs(r) > TUKEY * noise)
    lost = ~np.isfinite(r)
    return Registration(
        rotation=fit.rotation,
        translation=fit.centre + fit.shift - fit.rotation @ fit.centre,
        centre=fit.centre,
        covariance=spread,
        unobserved=free_motions(hidden, TOLERANCE, fit.centre + fit.shift),
        free=physical,
        noise=noise,
        used=int((w > 0).sum()),
        compared=int(compared.sum()),
        changed=float(changed.sum() / max(compared.sum(), 1)),
        converged=converged,
        points=fit.cloud.points,
        before=np.where(before[3], before[0], np.nan),
        after=np.where(compared & ~lost, r, np.nan),
    )
