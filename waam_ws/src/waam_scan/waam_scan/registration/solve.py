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
from .icp import FINE, ROUGH, Icp
from .observed import TOLERANCE, covariance, shown_motions, too_wide
from .result import Registration, RegistrationError
from .target import Cloud, CloudTarget, Target
from .words import free_motions

POINTS = 40_000  # of the moving cloud
TUKEY = 4.685
MIN_NORMAL_COSINE = 0.85  # cosine between the normals of two points that belong together
FIRST = 1.0e-3  # m, first limit where metal was added or is missing: a wider one would follow it
LAST_STEPS = 4  # estimates with what has changed left out
RESTED = 0.1  # tolerances by which the last estimate may move
MIN_PAIRS = 100
CHANGES = ('growth', 'wear', 'any')


@dataclass(frozen=True)
class _Pairs:
    """Points of the moving cloud and what is nearest to them on the target."""

    distance: np.ndarray  # (n,) m, signed: above the target is positive
    rows: np.ndarray  # (n, 6) what a motion changes of it, in tolerances, by the target's normals
    other: np.ndarray  # (n, 6) the same by the normals of the cloud
    met: np.ndarray  # (n,) bool, the target has a surface there
    good: np.ndarray  # (n,) bool, and the normals agree


@dataclass
class _Fit:
    """Points that are fitted and the motion so far, about `centre`."""

    cloud: Cloud
    target: Target
    centre: np.ndarray
    rotation: np.ndarray
    shift: np.ndarray  # of the centre
    keep: np.ndarray  # (n,) bool, points that may take part
    _here: _Pairs | None = None  # pairs of where the cloud is now

    def moved(self) -> np.ndarray:
        return (self.cloud.points - self.centre) @ self.rotation.T + self.centre + self.shift

    def pairs(self) -> _Pairs:
        """Every point of the cloud and its place on the target."""
        if self._here is None:
            self._here = self._pairs()
        return self._here

    def _pairs(self) -> _Pairs:
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
        return _Pairs(r, rows, other, m.ok, m.ok & (alike > MIN_NORMAL_COSINE))

    @property
    def usable(self) -> np.ndarray:
        """(n,) bool: good pairs that may take part."""
        return self.keep & self.pairs().good

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
        self._here = None


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
    if before.good.sum() < 200:
        raise RegistrationError(
            f'only {int(before.good.sum())} of {len(before.good)} points have a partner on the reference: do the '
            'clouds overlap, in the same unit? (--search looks for the part anywhere)'
        )
    fit.move(np.concatenate([_to_level(fit, change, reach), np.zeros(3)]) / TOLERANCE)
    noise, converged = _descend(fit, target.icp(whole), change, reach)
    return _result(fit, noise, converged, before)


def _begin(cloud: Cloud, target: Target, start: np.ndarray | None) -> _Fit:
    start = np.eye(4) if start is None else np.asarray(start, float)
    centre = cloud.points.mean(axis=0)
    shift = start[:3, :3] @ centre + start[:3, 3] - centre
    return _Fit(cloud, target, centre, start[:3, :3], shift, np.ones(len(cloud.points), bool))


def _to_level(fit: _Fit, change: str, reach: float) -> np.ndarray:
    """Shift (3,) m along the mean normal onto the surface that did not change."""
    r, rows = fit.pairs().distance, fit.pairs().rows
    near = fit.usable & (np.abs(r) < reach)
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
        _step(fit, icp, limit, own, keep, ROUGH)
        limit *= 0.5
    noise = _step(fit, icp, TUKEY * own, own, keep, FINE)[1]
    r = fit.pairs().distance
    fit.keep = ~changed_places(fit.cloud.points, r, fit.usable, change, TUKEY * noise)
    keep = fit.keep[cKDTree(fit.cloud.points).query(icp.points, workers=2)[1]]
    for _ in range(LAST_STEPS):
        length, noise = _step(fit, icp, TUKEY * noise, noise, keep, FINE)
        if length < RESTED:
            break
    return noise, length < RESTED


def _step(
    fit: _Fit, icp: Icp, limit: float, noise: float, keep: np.ndarray, settled: float
) -> tuple[float, float]:
    """Open3D's estimate, as far as the shape shows it: its largest component in tolerances, and the noise after it."""
    step = fit.step_to(icp.align(fit.matrix, limit, settled, keep))
    pairs = fit.pairs()
    w = np.where(fit.usable, tukey_weights(pairs.distance, limit), 0.0)
    if (w > 0).sum() < MIN_PAIRS:
        raise RegistrationError(
            f'the surfaces do not agree anywhere within {limit * 1e3:.2f} mm: start or --reach is wrong'
        )
    shown, _ = shown_motions(pairs.rows, pairs.other, w, noise)
    step = shown @ (shown.T @ step)
    fit.move(step)
    return float(np.abs(step).max()), _noise(fit, noise)


def _noise(fit: _Fit, before: float) -> float:
    """Robust scatter (m) of the pairs that the noise so far explains; at most half as much again."""
    own = float(np.hypot(fit.cloud.noise, fit.target.noise))
    r = fit.pairs().distance
    near = fit.usable & (np.abs(r) < 3 * before)
    return max(float(np.clip(robust_scatter(r[near]) * 1.05, 0.7 * own, 1.5 * before)), 1e-6)


def _result(fit: _Fit, noise: float, converged: bool, before: _Pairs) -> Registration:
    pairs = fit.pairs()
    r, rows, other = pairs.distance, pairs.rows, pairs.other
    w = np.where(fit.usable, tukey_weights(r, TUKEY * noise), 0.0)
    shown, hidden = shown_motions(rows, other, w, noise)
    cross = (other * w[:, None]).T @ rows
    spread = covariance(fit.cloud.points, other * (w * r)[:, None], cross, shown)
    wide = too_wide(spread, shown)
    hidden = np.hstack([hidden, shown @ wide])
    physical = hidden * TOLERANCE[:, None]
    spread = spread * np.outer(TOLERANCE, TOLERANCE)
    open_ = (np.abs(hidden) > 1e-3).any(axis=1)
    spread[open_, open_] = np.inf
    changed = pairs.met & (np.abs(r) > TUKEY * noise)
    return Registration(
        rotation=fit.rotation,
        translation=fit.centre + fit.shift - fit.rotation @ fit.centre,
        centre=fit.centre,
        covariance=spread,
        unobserved=free_motions(hidden, TOLERANCE, fit.centre + fit.shift),
        free=physical,
        noise=noise,
        used=int((w > 0).sum()),
        compared=int(pairs.met.sum()),
        changed=float(changed.sum() / max(pairs.met.sum(), 1)),
        converged=converged,
        points=fit.cloud.points,
        before=np.where(before.good, before.distance, np.nan),
        after=np.where(pairs.met, r, np.nan),
    )
