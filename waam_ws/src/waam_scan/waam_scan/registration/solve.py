"""The rigid motion between two scans, or between a scan and its nominal surface, when metal was added or is missing.

Robust point-to-plane Gauss-Newton. Three things set it apart from plain ICP:

* Growth is not motion. New metal only ever lies above the old surface: the start is the lowest surface that enough
  points agree on, Tukey's kernel follows the noise of the clouds, and the edges of what has grown are left out.
* Normals of a scan are noisy, and squares of noise look like information: a flat plate seems to show its sideways
  position. The normal equations therefore multiply the normals of one cloud with those of the other (instrumental
  variables, Wright 1928): their noise is independent and averages out, and what remains is the shape.
* Directions that the shape does not show (sliding on a plane, turning a shaft) are left unmoved and named (solution
  remapping, Zhang, Kaess and Singh 2016). The covariance is a sandwich over patches of the surface, so that errors
  that neighbours share count once.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..calibration.robust import robust_scatter, tukey_weights, turned
from .changes import changed_places, unchanged_level
from .target import Cloud, Target
from .words import free_motions

TOLERANCE = np.array(
    [30e-6] * 3 + [np.radians(0.01)] * 3
)  # demanded accuracy; unit of the equations
POINTS = 40_000  # of the moving cloud
TUKEY = 4.685
ALIKE = 0.85  # cosine between the normals of two points that belong together
RELIABLE = 0.3  # correlation of the two clouds' normals from which a direction is more than noise
FIRST = 1.0e-3  # m, first limit where metal was added or is missing: a wider one would follow it
PATCH = 4e-3  # m, edge of the patches whose errors may be alike
CHANGES = ('growth', 'wear', 'any')


class RegistrationError(ValueError):
    """Clouds that cannot be brought together; the text says why."""


@dataclass(frozen=True)
class Registration:
    """p_reference = rotation @ p + translation. centre: (3,) m, middle of the moving cloud; covariance: (6, 6) of the
    motion of the centre (m) and the rotation about x, y, z (rad), infinite where unobserved; unobserved: in words;
    free: (6, k); noise: m, robust scatter of the pairs; used: points that decided; changed: share of the compared
    points that were added or taken away; compared: points with a partner; distance: (n,) m before and after, of the
    points (n, 3) for pictures."""

    rotation: np.ndarray
    translation: np.ndarray
    centre: np.ndarray
    covariance: np.ndarray
    unobserved: list[str]
    free: np.ndarray
    noise: float
    used: int
    compared: int
    changed: float
    converged: bool
    points: np.ndarray = field(repr=False)
    before: np.ndarray = field(repr=False)
    after: np.ndarray = field(repr=False)
    notes: list[str] = field(default_factory=list)

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4)"""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = self.rotation, self.translation
        return m

    @property
    def sigma(self) -> np.ndarray:
        """(6,) standard uncertainty of the motion of the centre (m) and of the rotation (rad)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def shift(self) -> np.ndarray:
        """(3,) m, motion of the centre."""
        return self.rotation @ self.centre + self.translation - self.centre

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moves points (n, 3)."""
        return points @ self.rotation.T + self.translation


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
            alike = np.abs(alike)  # of an open mesh the inside is unknown
        return r, rows, other, self.keep & m.ok & (alike > ALIKE)

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
    from .target import CloudTarget

    if change not in CHANGES:
        raise RegistrationError(f'change must be one of {", ".join(CHANGES)}, not {change!r}')
    cloud = moving if isinstance(moving, Cloud) else Cloud.of(moving, seed=seed)
    if isinstance(reference, np.ndarray):
        reference = Cloud.of(reference, seed=seed)
    target = CloudTarget(reference) if isinstance(reference, Cloud) else reference
    cloud = cloud.take(points, np.random.default_rng(seed))
    fit = _begin(cloud, target, start)
    before = fit.pairs()
    if before[3].sum() < 200:
        raise RegistrationError(
            f'only {int(before[3].sum())} of {len(before[0])} points have a partner on the reference: do the clouds '
            'overlap, in the same unit? (--search looks for the part anywhere)'
        )
    fit.shift = fit.shift + _to_level(fit, change, reach)
    noise, converged = _descend(fit, change, reach)
    return _result(fit, noise, converged, change, before)


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


def _weights(r: np.ndarray, good: np.ndarray, limit: float, change: str, ease: float) -> np.ndarray:
    """Tukey weights; on the side where metal may have come (or gone) the limit is narrower by `ease`."""
    narrow = limit * ease
    above = narrow if change == 'growth' else limit
    below = narrow if change == 'wear' else limit
    return np.where(good, tukey_weights(r, np.where(r > 0, above, below)), 0.0)


def _descend(fit: _Fit, change: str, reach: float) -> tuple[float, bool]:
    """Wide to narrow; returns the noise of the pairs and whether the last steps came to rest."""
    own = float(np.hypot(fit.cloud.noise, fit.target.noise))
    limit = reach if change == 'any' else min(reach, FIRST)
    while limit > 1.2 * TUKEY * own:
        for _ in range(8):
            if _step(fit, change, limit, own, 0.6) < 0.3:
                break
        limit *= 0.5
    noise = own
    for round_ in range(2):
        if round_:
            r, _, _, good = fit.pairs()
            fit.keep = fit.keep & ~changed_places(fit.cloud.points, r, good, change, TUKEY * noise)
        for _ in range(25):
            r, _, _, good = fit.pairs()
            near = np.abs(r[good]) < 3 * noise
            noise = float(np.clip(robust_scatter(r[good][near]) * 1.05, 0.7 * own, 1.5 * noise))
            noise = max(noise, 1e-6)
            length = _step(fit, change, TUKEY * noise, noise, 1.0)
            if length < 2e-3:
                break
    return noise, length < 0.1


def _step(fit: _Fit, change: str, limit: float, noise: float, ease: float) -> float:
    """One step within what the shape shows; its largest component in tolerances."""
    r, rows, other, good = fit.pairs()
    w = _weights(r, good, limit, change, ease)
    if (w > 0).sum() < 100:
        raise RegistrationError(
            f'the surfaces do not agree anywhere within {limit * 1e3:.2f} mm: start or --reach is wrong'
        )
    cross = (other * w[:, None]).T @ rows
    seen, _ = _shown(cross, rows, other, w, noise)
    step = -seen @ np.linalg.solve(seen.T @ cross @ seen, seen.T @ (other.T @ (w * r)))
    step *= min(
        1.0, 30.0 / max(np.abs(step).max(), 1e-9)
    )  # never more than a degree or a millimetre at once
    fit.move(step)
    return float(np.abs(step).max())


def _shown(
    cross: np.ndarray, rows: np.ndarray, other: np.ndarray, w: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal bases (6, k) of the motions that the shape shows and (6, 6 - k) of those that it does not.

    A motion is shown when independent points would fix it to its tolerance, and when the normals of the two
    clouds agree on it (RELIABLE). What neighbours share in errors is judged at the end, by the covariance.
    """
    values, vectors = np.linalg.eigh(0.5 * (cross + cross.T))
    a = np.einsum('ik,ij,jk->k', vectors, (rows * w[:, None]).T @ rows, vectors)
    b = np.einsum('ik,ij,jk->k', vectors, (other * w[:, None]).T @ other, vectors)
    agree = values / np.sqrt(np.maximum(a * b, 1e-300))
    shown = (values > noise**2) & (agree > RELIABLE)
    return vectors[:, shown], vectors[:, ~shown]


def _result(fit: _Fit, noise: float, converged: bool, change: str, before) -> Registration:
    r, rows, other, good = fit.pairs()
    w = _weights(r, good, TUKEY * noise, change, 1.0)
    cross = (other * w[:, None]).T @ rows
    shown, hidden = _shown(cross, rows, other, w, noise)
    covariance = _covariance(fit, other, w * r, cross, shown)
    wide = _too_wide(covariance, shown)
    hidden = np.hstack([hidden, shown @ wide])
    physical = hidden * TOLERANCE[:, None]
    covariance = covariance * np.outer(TOLERANCE, TOLERANCE)
    open_ = (np.abs(hidden) > 1e-3).any(axis=1)
    covariance[open_, open_] = np.inf
    everywhere = fit.target.match(fit.moved())
    compared = everywhere.ok
    changed = compared & (np.abs(r) > TUKEY * noise)
    lost = ~np.isfinite(r)
    return Registration(
        rotation=fit.rotation,
        translation=fit.centre + fit.shift - fit.rotation @ fit.centre,
        centre=fit.centre,
        covariance=covariance,
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


def _covariance(
    fit: _Fit, other: np.ndarray, errors: np.ndarray, cross: np.ndarray, shown: np.ndarray
) -> np.ndarray:
    """(6, 6) in tolerances: sandwich over patches of the surface, zero where nothing is shown."""
    patch = np.floor(fit.cloud.points / PATCH).astype(np.int64)
    _, group = np.unique(patch, axis=0, return_inverse=True)
    scores = np.zeros((int(group.max()) + 1, 6))
    np.add.at(scores, group.ravel(), other * errors[:, None])
    inverse = shown @ np.linalg.inv(shown.T @ cross @ shown) @ shown.T
    return inverse @ (scores.T @ scores) @ inverse.T


def _too_wide(covariance: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(k, m) directions within `shown` whose standard uncertainty exceeds three tolerances: found, but not known."""
    values, vectors = np.linalg.eigh(shown.T @ covariance @ shown)
    return vectors[:, values > 9.0]
