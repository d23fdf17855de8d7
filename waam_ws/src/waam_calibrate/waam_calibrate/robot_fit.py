"""Tool centre point and hand-eye calibration of a robot, with uncertainty. Pure. Lengths in m, angles in rad.

Both are least squares (scipy) with the stated errors of the robot as further unknowns (`waam_robot.uncertain`), each
held to 0 by its standard deviation. The covariance of what is looked for is that of the whole: it has what the noise
does and what the errors of the robot do. Where the residuals are larger than all that explains, it is scaled up.

Tool: the tip t of the tool in the frame of the flange is the same point c of the base in all poses, F_i t = c.
Hand-eye: points p of profiles on a sphere of known radius r, |F_i X p - c| = r, with X the scanner in the frame of the
flange and c the centre in the base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from waam_robot.uncertain import Flange, turns

from .evidence import EvidenceError
from .robot_evidence import Poses, Profiled

MIN_TOUCHES, MIN_SCANS = 4, 6
TURN = np.radians(20.0)  # least spread of the orientations about the second of their axes
SURE_TOOL, SURE_SCANNER = 1.0e-3, 1.0e-3  # m, 95 % interval of a coordinate
SURE_ANGLE = np.radians(0.5)  # 95 % interval of an angle of the scanner
INTERVAL = 1.96  # standard deviations of a 95 % interval
TOO_FAR = 4.0  # standard deviations at which a touch is doubted; m where fitted points are left out
PER_POSE = 60  # points of a pose that are used
MIN_POINTS = 12  # of a pose
AWAY = 0.05, np.radians(15.0)  # m, rad from the nominal mounting: no longer this scanner
MISFIT = 3.0  # residuals over what noise and stated errors explain


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


@dataclass(frozen=True)
class Tool:
    """tip: (3,) m in the frame of the flange; point: (3,) m in the base; sigma: (3,) m, standard deviations; misses:
    (n,) m, how far the tip is from the point in each pose by the angles as told; misfit: residuals over those
    expected."""

    tip: np.ndarray
    point: np.ndarray
    sigma: np.ndarray
    misses: np.ndarray
    misfit: float

    @property
    def interval(self) -> np.ndarray:
        """(3,) m, half of the 95 % intervals."""
        return INTERVAL * self.sigma


@dataclass(frozen=True)
class HandEye:
    """scanner: (4, 4) in the frame of the flange; sigma: (6,) m, rad, of its position and of small turns about the
    axes of the flange; centre: (3,) m of the sphere in the base; misses: (m,) m of the points used, by the angles as
    told; of: (m,) their pose; points: (m, 3) m, in the base; left_out: share of the points; misfit as of Tool."""

    scanner: np.ndarray
    sigma: np.ndarray
    centre: np.ndarray
    misses: np.ndarray
    of: np.ndarray
    points: np.ndarray
    left_out: float
    misfit: float

    @property
    def interval(self) -> np.ndarray:
        """(6,) m, rad, half of the 95 % intervals."""
        return INTERVAL * self.sigma


def tool(poses: Poses, touch: float = 1e-4) -> Tool:
    """touch: m, standard deviation of one touch, each direction. EvidenceError for poor evidence."""
    n = len(poses.nominal)
    if n < MIN_TOUCHES:
        raise EvidenceError(f'{n} touches, at least {MIN_TOUCHES} are needed, 8 are good')
    _check_turned(poses.nominal[:, :3, :3])
    r, p = poses.nominal[:, :3, :3], poses.nominal[:, :3, 3]
    both = np.concatenate([r, np.broadcast_to(-np.eye(3), (n, 3, 3))], axis=2).reshape(-1, 6)
    start = np.linalg.lstsq(both, -p.reshape(-1), rcond=None)[0]
    fit = solve(_touch(touch), poses.flange, start, 3 * n - 6)
    plain = _touch(1.0)(start, poses.nominal).off.reshape(-1, 3)
    misses = np.linalg.norm(plain, axis=1)
    _check_misfit(fit.misfit, misses, poses.numbers)
    found = Tool(fit.x[:3], fit.x[3:6], fit.sigma[:3], misses, fit.misfit)
    if found.interval.max() > SURE_TOOL:
        raise EvidenceError(
            f'the tip is told to +-{1e3 * found.interval.max():.2f} mm only, {1e3 * SURE_TOOL:g} mm are needed: touch '
            'in more poses, with the torch leaning in more directions'
        )
    return found


def hand_eye(seen: Profiled, radius: float, nominal: np.ndarray, noise: float = 5e-5) -> HandEye:
    """radius: m of the sphere; nominal: (4, 4) scanner in the frame of the flange as it was mounted, to begin with;
    noise: m, of a point. EvidenceError for poor evidence."""
    if not (np.isfinite(radius) and 2e-3 <= radius <= 0.2):
        raise EvidenceError(f'a sphere with a radius of {1e3 * radius:g} mm: 2 to 200 mm')
    n = len(seen.poses.nominal)
    if n < MIN_SCANS:
        raise EvidenceError(f'{n} poses, at least {MIN_SCANS} are needed, 12 are good')
    _check_turned(seen.poses.nominal[:, :3, :3])
    points, of = _thinned(seen)
    x = np.concatenate([np.zeros(6), _centre(seen.poses.nominal, nominal, points, of, radius)])
    x = _roughly(seen.poses.nominal, nominal, points, of, radius, x)
    good = np.ones(len(points), bool)
    for _ in range(2):
        off = _sphere(nominal, points[good], of[good], radius, noise)
        fit = solve(off, seen.poses.flange, x, int(good.sum()) - 9)
        rest = np.abs(_sphere(nominal, points, of, radius, 1.0)(fit.x, fit.frames).off)
        limit = max(TOO_FAR * noise, TOO_FAR * 1.48 * float(np.median(rest)))
        good = rest < limit
    if good.mean() < 0.7:
        raise EvidenceError(
            f'{1 - good.mean():.0%} of the points lie off the sphere: cut the profiles to the sphere, check its radius'
        )
    told = _sphere(nominal, points[good], of[good], radius, 1.0)(fit.x, seen.poses.nominal).off
    _check_misfit(fit.misfit, _by_pose(told, of[good], n), seen.poses.numbers)
    return _judged(fit, nominal, told, of[good], points[good], 1 - float(good.mean()))


def _judged(
    fit: Fit,
    nominal: np.ndarray,
    misses: np.ndarray,
    of: np.ndarray,
    points: np.ndarray,
    left_out: float,
) -> HandEye:
    scanner = _moved(nominal, fit.x[:6])
    if np.linalg.norm(fit.x[:3]) > AWAY[0] or np.linalg.norm(fit.x[3:6]) > AWAY[1]:
        raise EvidenceError(
            f'the scanner would be {1e3 * np.linalg.norm(fit.x[:3]):.0f} mm and '
            f'{np.degrees(np.linalg.norm(fit.x[3:6])):.0f} deg from its nominal mounting: is that the right one?'
        )
    frames = fit.frames[of] @ scanner
    there = np.einsum('mij,mj->mi', frames[:, :3, :3], points) + frames[:, :3, 3]
    out = HandEye(scanner, fit.sigma[:6], fit.x[6:9], misses, of, there, left_out, fit.misfit)
    wide = out.interval
    if wide[:3].max() > SURE_SCANNER or wide[3:].max() > SURE_ANGLE:
        raise EvidenceError(
            f'the scanner is told to +-{1e3 * wide[:3].max():.2f} mm and {np.degrees(wide[3:].max()):.2f} deg only, '
            f'{1e3 * SURE_SCANNER:g} mm and {np.degrees(SURE_ANGLE):.1f} deg are needed: scan from more directions, '
            'the sphere at other places of the profile'
        )
    return out


def _touch(sigma: float) -> Problem:
    """The tip x[:3] of the flange is at x[3:6]; sigma: m."""

    def terms(x: np.ndarray, frames: np.ndarray) -> Terms:
        n = len(frames)
        lever = frames[:, :3, :3] @ x[:3]
        off = lever + frames[:, :3, 3] - x[3:6]
        by_tip = np.concatenate([frames[:, :3, :3], np.tile(-np.eye(3), (n, 1, 1))], axis=2)
        cross = np.cross(lever[:, None], np.eye(3))  # a turn w moves the lever by w x lever
        parts = (off.reshape(-1), by_tip.reshape(-1, 6), cross.reshape(-1, 3))
        shift = np.tile(np.eye(3), (n, 1))
        off_, by_x, by_turn = (v / sigma for v in parts)
        return Terms(off_, by_x, by_turn, shift / sigma, np.repeat(np.arange(n), 3))

    return terms


def _check_turned(turned: np.ndarray) -> None:
    """The orientations (n, 3, 3) differ about at least two axes."""
    vectors = Rotation.from_matrix(np.einsum('ji,njk->nik', turned[0], turned)).as_rotvec()
    _, _, axes = np.linalg.svd(vectors - vectors.mean(axis=0), full_matrices=False)
    spread = np.ptp(vectors @ axes.T, axis=0)
    if spread[1] < TURN:
        raise EvidenceError(
            f'the torch turned by {np.degrees(spread[0]):.0f} deg about one axis and {np.degrees(spread[1]):.0f} deg '
            f'about others, at least {np.degrees(TURN):.0f} deg about two axes are needed: lean it to more sides'
        )


def _check_misfit(misfit: float, misses: np.ndarray, numbers: tuple[int, ...]) -> None:
    if misfit <= MISFIT:
        return
    n = int(np.argmax(misses))
    raise EvidenceError(
        f'the poses contradict each other: residuals are {misfit:.1f} times what noise and the stated errors of the '
        f'robot explain, most in pose {numbers[n]} ({1e3 * misses[n]:.2f} mm): leave it out or measure again'
    )


# ---- the sphere


def _moved(nominal: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(4, 4): nominal shifted by x[:3] and turned by x[3:6], axes of the flange."""
    out = nominal.copy()
    out[:3, 3] = nominal[:3, 3] + x[:3]
    out[:3, :3] = turns(x[3:6]) @ nominal[:3, :3]
    return out


def _sphere(
    nominal: np.ndarray, points: np.ndarray, of: np.ndarray, radius: float, sigma: float
) -> Problem:
    """Points lie on the sphere about x[6:9], seen by the scanner at `nominal` moved by x[:6]; sigma: m."""

    def terms(x: np.ndarray, frames: np.ndarray) -> Terms:
        scanner, turned = _moved(nominal, x), frames[of, :3, :3]
        in_flange = points @ scanner[:3, :3].T
        lever = np.einsum('qij,qj->qi', turned, in_flange + scanner[:3, 3])
        away = lever + frames[of, :3, 3] - x[6:9]
        far = np.linalg.norm(away, axis=1)
        out = away / far[:, None]  # of the sphere, in the base
        own = np.einsum('qij,qi->qj', turned, out)  # the same in the flange
        by_x = np.concatenate([own, np.cross(in_flange, own), -out], axis=1)
        return Terms(
            (far - radius) / sigma, by_x / sigma, np.cross(lever, out) / sigma, out / sigma, of
        )

    return terms


def _thinned(seen: Profiled) -> tuple[np.ndarray, np.ndarray]:
    """At most PER_POSE points of every pose."""
    keep = []
    for n, number in enumerate(seen.poses.numbers):
        own = np.flatnonzero(seen.of == n)
        if len(own) < MIN_POINTS:
            raise EvidenceError(
                f'pose {number}: {len(own)} points on the sphere, at least {MIN_POINTS} are needed'
            )
        keep.append(own[np.linspace(0, len(own) - 1, min(len(own), PER_POSE)).astype(int)])
    index = np.concatenate(keep)
    return seen.points[index], seen.of[index]


def _centre(
    frames: np.ndarray, nominal: np.ndarray, points: np.ndarray, of: np.ndarray, radius: float
) -> np.ndarray:
    """(3,) m: below the tops of the profiles by the radius, roughly."""
    both = frames @ nominal
    tops = [points[of == n][np.argmax(points[of == n][:, 2])] for n in range(len(frames))]
    under = np.array(tops) - [0, 0, radius]
    return np.asarray(np.einsum('nij,nj->ni', both[:, :3, :3], under) + both[:, :3, 3]).mean(axis=0)


def _roughly(
    frames: np.ndarray,
    nominal: np.ndarray,
    points: np.ndarray,
    of: np.ndarray,
    radius: float,
    x: np.ndarray,
) -> np.ndarray:
    """(9,): without the errors of the robot, deaf to outliers."""
    off = _sphere(nominal, points, of, radius, 1e-3)
    scale = np.full(9, 1e-3)
    done: Any = least_squares(
        lambda y: off(y, frames).off, x, lambda y: off(y, frames).by_x, x_scale=scale,
        loss='soft_l1', f_scale=0.2,
    )  # fmt: skip
    return np.asarray(done.x)


def _by_pose(misses: np.ndarray, of: np.ndarray, count: int) -> np.ndarray:
    """(count,) m: RMS of each pose."""
    square = np.bincount(of, misses**2, count) / np.maximum(np.bincount(of, minlength=count), 1)
    return np.asarray(np.sqrt(square))


# ---- least squares with the errors of the robot as unknowns


def solve(terms: Problem, flange: Flange, start: np.ndarray, free: int) -> Fit:
    """terms(x, frames (n, 4, 4)); free: degrees of freedom without the errors of the robot."""
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
        out[:, :3, k] = Rotation.from_matrix(turn).as_rotvec()
        out[:, 3:, k] = moved[:, :3, 3] - nominal[:, :3, 3]
    return out
