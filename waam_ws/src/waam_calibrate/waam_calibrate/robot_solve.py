"""Least squares over poses of a robot whose errors are unknowns, too. Pure. Lengths in m, angles in rad."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from waam_robot.uncertain import Flange, turns

from .evidence import EvidenceError


@dataclass(frozen=True)
class Fit:
    """x: (m,) what is looked for, sigma: (m,); frames: (n, 4, 4) of the flange with the errors found."""

    x: np.ndarray
    sigma: np.ndarray
    frames: np.ndarray
    misfit: float


@dataclass(frozen=True)
class Terms:
    """off: (q,) residuals over their standard deviation; by_x: (q, m) their slopes; by_turn, by_shift: (q, 3) slopes by
    a small turn (rad) and a shift (m) of the flange of their pose, axes of the base; of: (q,) that pose."""

    off: np.ndarray
    by_x: np.ndarray
    by_turn: np.ndarray
    by_shift: np.ndarray
    of: np.ndarray


Problem = Callable[[np.ndarray, np.ndarray], Terms]


def solve(terms: Problem, flange: Flange, start: np.ndarray, free: int) -> Fit:
    """terms(x, frames (n, 4, 4)); free: degrees of freedom without the errors of the robot."""
    from scipy.optimize import least_squares

    m, nominal = len(start), flange.poses(np.zeros(len(flange.sigma)))
    slopes = _slopes(flange, nominal)

    def frames(y: np.ndarray) -> np.ndarray:
        off = slopes @ y[m:]
        out = nominal.copy()
        out[:, :3, :3] = turns(off[:, :3]) @ nominal[:, :3, :3]
        out[:, :3, 3] += off[:, 3:]
        return out

    def residuals(y: np.ndarray) -> np.ndarray:
        return np.concatenate([terms(y[:m], frames(y)).off, y[m:]])

    def jacobian(y: np.ndarray) -> np.ndarray:
        t = terms(y[:m], frames(y))
        by_pose = np.concatenate([t.by_turn, t.by_shift], axis=1)
        by_errors = np.einsum('qi,qik->qk', by_pose, slopes[t.of])
        held = np.hstack([np.zeros((len(y) - m, m)), np.eye(len(y) - m)])
        return np.vstack([np.hstack([t.by_x, by_errors]), held])

    begin = np.concatenate([start, np.zeros(slopes.shape[2])])
    scale = np.concatenate([np.full(m, 1e-3), np.ones(slopes.shape[2])])
    done: Any = least_squares(residuals, begin, jac=jacobian, x_scale=scale)
    misfit = float(np.sqrt(2 * done.cost / max(free, 1)))
    try:
        covariance = np.linalg.inv(done.jac.T @ done.jac)
    except np.linalg.LinAlgError:
        raise EvidenceError('the poses do not tell all that is looked for') from None
    spread = np.sqrt(np.maximum(np.diag(covariance)[:m], 0.0)) * max(1.0, misfit)
    return Fit(done.x[:m], spread, frames(done.x), misfit)


def _slopes(flange: Flange, nominal: np.ndarray) -> np.ndarray:
    """(n, 6, k): turn (rad) and shift (m) of every pose by one standard deviation of every error that has one."""
    held = np.flatnonzero(flange.sigma > 0)
    out = np.zeros((len(nominal), 6, len(held)))
    for k, error in enumerate(held):
        one = np.zeros(len(flange.sigma))
        one[error] = flange.sigma[error]
        moved = flange.poses(one)
        turn = moved[:, :3, :3] @ np.swapaxes(nominal[:, :3, :3], 1, 2)
        out[:, :3, k] = 0.5 * skewed(turn)
        out[:, 3:, k] = moved[:, :3, 3] - nominal[:, :3, 3]
    return out


def skewed(turned: np.ndarray) -> np.ndarray:
    """(n, 3): twice the sine of the angle along the axis of turns (n, 3, 3)."""
    r = turned
    pairs = [r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]]
    return np.stack(pairs, axis=1)
