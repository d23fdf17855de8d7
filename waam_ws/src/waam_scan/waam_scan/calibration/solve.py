"""Scanner-to-torch pose and time offset from passes over a known artefact.

A profile point p = (x_s, 0, z_s) of a profile stamped s lies at P = tcp(s + delay) + offset + R p. Its distance to the
artefact's surface must vanish. Robust Gauss-Newton over all points for offset, R and delay, together with the pose
of the artefact, which is known only to the uncertainties of its touch-off: what these leave open
appears in the covariance, not in the result. Points are reassigned to surfaces in every step (ICP with an exact model).

The covariance is a sandwich over groups of neighbouring profiles (cluster-robust, White 1980 / Liang and Zeger 1986):
errors that neighbours share, such as a shaking carriage, widen it; a sum over independent points would not see them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..transform import Mounting
from .artefact import Artefact
from .problem import SCALE, TOLERANCE, Problem, State
from .robust import beside, group_scores, robust_scatter, sandwich, tukey_weights, wide
from .scan_pass import Motion, Pass, gather
from .words import unobserved

PARAMETERS = ('x', 'y', 'z', 'rx', 'ry', 'rz', 'delay')
CAPTURE = (8e-3, 4e-3, 2e-3, 1e-3, 0.5e-3)  # m, Tukey limits while the pose is found
FITS = 0.6  # share of the points near the body that lie on it when the pose is right (edges are left out)
VAGUE = 25.0  # tolerances: a pose of the artefact known no better than this is not known
TUKEY = 4.685  # 95 % efficiency on normal errors
NOISE_FLOOR, NOISE_CEILING = 2e-6, 0.2e-3  # m; beyond the latter it is not noise but another body


class CalibrationError(ValueError):
    """Scans that do not give a calibration; the text says why and what to do."""


@dataclass(frozen=True)
class Calibration:
    """Where the scanner sits, how well that is known, and what the passes say about it."""

    mounting: Mounting  # the result
    covariance: np.ndarray  # (7, 7) of offset (m), rotation about work x, y, z (rad) and delay (s)
    unobserved: list[str]  # directions that the scans do not show, in words
    free: np.ndarray  # (7, k) their basis, in units of TOLERANCE
    noise: float  # m, robust scatter of the used points
    used: int  # points that decided
    seen: int  # points
    rejected_profiles: int
    faces: dict[str, tuple[float, int]]  # mean residual (m) and points per surface
    passes: dict[str, float]  # mean residual (m) per pass
    residuals: np.ndarray  # (used,) m, for pictures
    points: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """(7,) standard uncertainty: m, rad, s."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def observed(self) -> bool:
        """The passes show every direction of offset, rotation and delay."""
        return not self.unobserved


def _step(problem: Problem, s: State, limit: float, noise: float) -> tuple[State, float]:
    """One Gauss-Newton step with Tukey weights; also its largest component in tolerances."""
    r, jacobian, _, good = problem.linear(s)
    w = np.where(good, tukey_weights(r, limit), 0.0) / noise**2
    deviation, information, free = problem.prior(s)
    hessian = (jacobian * w[:, None]).T @ jacobian + np.diag(information)
    gradient = jacobian.T @ (w * r) + information * deviation
    moving = np.flatnonzero(free)
    scale = SCALE[moving]
    h = hessian[np.ix_(moving, moving)] * np.outer(scale, scale)
    step = -np.linalg.lstsq(h, gradient[moving] * scale, rcond=1e-14)[0]
    full = np.zeros(13)
    full[moving] = step * scale
    return s.moved(full), float(np.abs(step).max())


def _descend(problem: Problem, s: State, limits: Iterable[float], steps: int) -> State:
    for limit in limits:
        for _ in range(steps):
            s, length = _step(problem, s, limit, limit / 3)
            if length < 0.05:
                break
    return s


def _fit(problem: Problem, s: State) -> tuple[float, int]:
    """Share of the points near the body that lie on its surface, and how many do."""
    r, _, face, good = problem.linear(s)
    body = face < len(problem.artefact.body.names)
    on = int((good & body & (np.abs(r) < 0.3e-3)).sum())
    return on / max(int((body & (np.abs(r) < 5e-3)).sum()), 1), on


def _find(problem: Problem, start: State, reach: float, rng: np.random.Generator) -> State:
    """From rough start values: descents on a few points from shifted starts, until the body fits; else the best."""
    few = problem.take(4000, rng)
    best, best_fit = start, -1.0
    steps = (0.0, -reach, reach)
    shifts = sorted(itertools.product(steps, steps, (0.0, reach)), key=np.linalg.norm)
    for shift in shifts:
        s = _descend(few, replace(start, offset=start.offset + np.array(shift)), CAPTURE, 6)
        share, on = _fit(few, s)
        if share * np.sqrt(on) > best_fit:
            best, best_fit = s, share * np.sqrt(on)
        if share > FITS and on > 300:
            break
    return best


def calibrate(
    passes: list[Pass],
    artefact: Artefact,
    start: Mounting | None = None,
    reach: float = 5e-3,
    delay_reach: float = 0.1,
    limit: int = 150_000,
    seed: int = 0,
) -> Calibration:
    """The mounting that makes the passes agree with the artefact.

    start: rough mounting (within about 10 mm and 5 deg); reach: m, how far off its offset may be in each direction;
    delay_reach: s, how far profile stamps may be off; limit: points that are used, drawn evenly.
    Raises CalibrationError when the artefact is not found in the scans. Directions that the scans do not show are
    named in `unobserved` and stay at their start values; the caller decides whether to refuse them.
    """
    start = start or Mounting()
    rng = np.random.default_rng(seed)
    points = gather(passes, limit, abs(start.delay) + delay_reach, seed)
    if len(points.profile) < 100:
        raise CalibrationError(f'only {len(points.profile)} returns with a pose in the scans')
    problem = Problem(points, Motion(passes), artefact, start)
    state = State(
        start.offset.astype(float), start.rotation.astype(float), start.delay,
        artefact.position.astype(float), artefact.rotation,
    )  # fmt: skip
    state = _find(problem, state, reach, rng)
    state, noise = _refine(problem, state)
    if abs(state.delay - start.delay) > delay_reach:
        raise CalibrationError(
            f'the time offset runs beyond {delay_reach * 1e3:.0f} ms: start value or stamps are wrong'
        )
    return _result(problem, state, noise, start)


def _refine(problem: Problem, s: State) -> tuple[State, float]:
    """All points, Tukey's limit from their own scatter."""
    noise = CAPTURE[-1] / TUKEY
    for _ in range(30):
        r, _, _, good = problem.linear(s)
        near = r[good & (np.abs(r) < TUKEY * 2 * noise)]
        if len(near) < 100:
            raise CalibrationError(
                'the artefact is not found in the scans: check its size, its position and the start values'
            )
        noise = float(np.clip(robust_scatter(near), NOISE_FLOOR, 2 * NOISE_CEILING))
        s, length = _step(problem, s, TUKEY * noise, noise)
        if length < 1e-3:
            break
    if noise > NOISE_CEILING:
        raise CalibrationError(
            f'the body does not fit: its points scatter by {noise * 1e3:.2f} mm; check its size and the start values'
        )
    return s, noise


def _result(problem: Problem, s: State, noise: float, start: Mounting) -> Calibration:
    r, jacobian, face, good = problem.linear(s)
    w = np.where(good, tukey_weights(r, TUKEY * noise), 0.0)
    used = w > 0
    body = face < len(problem.artefact.body.names)
    seen = int((body & (np.abs(r) < 5e-3)).sum())
    if (used & body).sum() < 100 or (used & body).sum() < FITS * seen:
        raise CalibrationError(
            f'the body does not fit: {int((used & body).sum())} of {seen} points near it lie on its surface '
            f'(within {TUKEY * noise * 1e3:.2f} mm); check its size, its position and the start values'
        )
    covariance, free, words = _uncertainty(problem, s, r, jacobian, w, noise)
    return Calibration(
        mounting=Mounting(s.offset, s.rotation, s.delay),
        covariance=covariance,
        unobserved=words,
        free=free,
        noise=noise,
        used=int(used.sum()),
        seen=seen,
        rejected_profiles=problem.points.rejected,
        faces=_by(face[used], r[used], problem.artefact.faces),
        passes={
            p.name: float(np.mean(r[used & (problem.motion.of_pass[problem.points.profile] == i)]))
            if (used & (problem.motion.of_pass[problem.points.profile] == i)).any()
            else float('nan')
            for i, p in enumerate(problem.motion.passes)
        },
        residuals=r[used],
        points=_work_points(problem, s)[used],
    )


def _work_points(problem: Problem, s: State) -> np.ndarray:
    tcp, _ = problem.motion.at(s.delay)
    return tcp[problem.points.profile] + s.offset + problem.points.local @ s.rotation.T


def _by(face: np.ndarray, r: np.ndarray, names: tuple[str, ...]) -> dict[str, tuple[float, int]]:
    return {
        name: (float(r[face == i].mean()), int((face == i).sum()))
        for i, name in enumerate(names)
        if (face == i).any()
    }


def _uncertainty(
    problem: Problem, s: State, r: np.ndarray, jacobian: np.ndarray, w: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Covariance (7, 7), free directions (7, k) in tolerances, and these in words."""
    _, prior, free = problem.prior(s)
    moving = np.flatnonzero(free)
    scale = SCALE[moving]
    j = jacobian[:, moving] * scale
    prior = np.diag(prior[moving] * scale**2)
    hessian = (j * w[:, None]).T @ j / noise**2 + prior
    scores = group_scores(problem.points.profile, j * (w * r / noise**2)[:, None])
    alone = hessian[:7, :7]  # as if the artefact's pose were exact: what the motion shows
    by_motion = wide(sandwich(alone, scores[:, :7], prior[:7, :7]), 1.0)
    shown_by_none = np.hstack(by_motion) if by_motion else np.empty((7, 0))
    covariance = sandwich(hessian, scores, prior)[:7, :7]
    vague = beside(wide(covariance, VAGUE), shown_by_none)
    travelled = problem.motion.directions()
    words = [w for group in by_motion for w in unobserved(group, travelled)]
    words += unobserved(vague, travelled, by_motion=False)
    return covariance * np.outer(TOLERANCE, TOLERANCE), np.hstack([shown_by_none, vague]), words
