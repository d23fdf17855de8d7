"""A first guess for a part that lies anywhere on the table, turned about z by any angle."""

from __future__ import annotations

import numpy as np

from .result import RegistrationError
from .target import Cloud, Target

TURNS = 24  # angles that are tried
WIDE = (20e-3, 10e-3, 5e-3)  # m, capture while the guess settles
AGREEMENT_RADIUS = 1.0e-3  # m, points this close agree
RIVAL = 0.95  # share of the best agreement from which another angle is as good


def search_placement(
    cloud: Cloud, target: Target, vertices: np.ndarray, change: str = 'any', seed: int = 0
) -> tuple[np.ndarray, list[str]]:
    """(4, 4) first guess that brings the cloud onto the target, and remarks.

    vertices: (n, 3) m of the target, for its middle and top. The cloud must show the part alone, seen from above.
    A part that fits as well at another angle gives a remark. Raises RegistrationError when no angle fits.
    """
    rng = np.random.default_rng(seed)
    few = cloud.take(3000, rng)
    found = []
    for angle in np.arange(TURNS) * 2 * np.pi / TURNS:
        guess = _settle(few, target, _placed(few.points, vertices, angle))
        found.append((_agreement(few, target, guess), angle, guess))
    found.sort(key=lambda f: -f[0])
    share, _, best = found[0]
    if share < 0.2:
        raise RegistrationError(
            f'the part was not found: at the best angle only {share:.0%} of the points lie within '
            f'{AGREEMENT_RADIUS * 1e3:.0f} mm of the reference'
        )
    rivals = [f for f in found[1:] if f[0] > RIVAL * share and _apart(f[2], best) > np.radians(10)]
    notes = [
        f'at an angle of {np.degrees(_apart(rivals[0][2], best)):.0f} deg from here the part fits as well: '
        'symmetric, or too little of it was seen'
    ] if rivals else []  # fmt: skip
    return best, notes


def _placed(points: np.ndarray, vertices: np.ndarray, angle: float) -> np.ndarray:
    """Turned by `angle`, middles of the outlines and tops brought together."""
    c, s = np.cos(angle), np.sin(angle)
    m = np.eye(4)
    m[:2, :2] = [[c, -s], [s, c]]
    turned = points @ m[:3, :3].T
    low, high = np.percentile(turned, [0.5, 99.5], axis=0)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)) - 0.5 * (low + high)
    m[:3, 3] = [middle[0], middle[1], vertices[:, 2].max() - high[2]]
    return m


def _settle(few: Cloud, target: Target, guess: np.ndarray) -> np.ndarray:
    """A few point-to-plane steps in x, y, z and about z, with a shrinking limit."""
    for limit in WIDE:
        for _ in range(4):
            p = few.points @ guess[:3, :3].T + guess[:3, 3]
            m = target.match(p)
            r = np.einsum('ij,ij->i', p - m.foot, m.normal)
            w = np.clip(1 - (np.linalg.norm(p - m.foot, axis=1) / limit) ** 2, 0, 1) ** 2
            centre = p.mean(axis=0)
            arm = (p - centre) * 10.0  # about even with the shifts for a part of 100 mm
            j = np.column_stack([m.normal, arm[:, 0] * m.normal[:, 1] - arm[:, 1] * m.normal[:, 0]])
            h = (j * w[:, None]).T @ j + 1e-3 * len(p) * np.eye(4)
            step = -np.linalg.solve(h, j.T @ (w * r))
            guess = _turned(step[3] * 10.0, centre, step[:3]) @ guess
    return guess


def _turned(angle: float, centre: np.ndarray, shift: np.ndarray) -> np.ndarray:
    m = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    m[:2, :2] = [[c, -s], [s, c]]
    m[:3, 3] = centre + shift - m[:3, :3] @ centre
    return m


def _agreement(few: Cloud, target: Target, guess: np.ndarray) -> float:
    p = few.points @ guess[:3, :3].T + guess[:3, 3]
    m = target.match(p)
    alike = np.abs(np.einsum('ij,ij->i', few.normals @ guess[:3, :3].T, m.normal)) > 0.8
    return float((alike & (np.linalg.norm(p - m.foot, axis=1) < AGREEMENT_RADIUS)).mean())


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two placements, rad."""
    trace = np.trace(a[:3, :3] @ b[:3, :3].T)
    return float(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
