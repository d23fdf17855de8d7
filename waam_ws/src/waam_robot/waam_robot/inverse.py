"""The analytic inverse of an arm with a spherical wrist: all eight branches of many poses at once.

S3 section 3.1.2, with the printed errors corrected (docs/equations.md). Branch b of 0 ... 7 has three bits: 4 = the arm
reaches over its shoulder (theta1 + pi), 2 = elbow down (theta2 = phi - acos k), 1 = wrist flipped (theta4 + pi).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm import AXES, PATTERN, Arm, ArmError, in_limits, limit_text
from .frames import check_poses, inverse, wrapped

BRANCHES = 8
EDGE = 1e-12  # k may exceed 1 by rounding at full stretch
WRIST = 1e-12  # sine of theta5 below which theta4 and theta6 turn about the same axis


@dataclass(frozen=True)
class Solutions:
    """theta: (N, 8, 6) DH angles in -pi ... pi, NaN where a branch does not exist; reachable: (N, 8);
    wrist: (N, 3) centre of the wrist, m, base frame; stretch: (N, 2) the source's k for both shoulders.
    """

    theta: np.ndarray
    reachable: np.ndarray
    wrist: np.ndarray
    stretch: np.ndarray

    @property
    def any(self) -> np.ndarray:
        """(N,) bool: at least one branch."""
        return np.asarray(self.reachable.any(axis=1))


def check_analytic(arm: Arm) -> None:
    """ArmError that names the first length or angle that the analytic inverse cannot have."""
    for n, (link, alpha) in enumerate(zip(arm.links, PATTERN, strict=True), 1):
        if abs(link.alpha - alpha) > 1e-12:
            raise ArmError(
                f'{arm.name}: the analytic inverse wants alpha{n} = {np.degrees(alpha):.0f} deg, '
                f'not {np.degrees(link.alpha):.3f}; use a URDF and the iterative inverse'
            )
    zero = {'d2': 1, 'd3': 2, 'd5': 4, 'a4': 3, 'a5': 4, 'a6': 5}
    for name, n in zero.items():
        if value := getattr(arm.links[n], name[0]):
            raise ArmError(f'{arm.name}: the analytic inverse wants {name} = 0, not {value:g} m')
    if not arm.links[1].a > 0 or not np.hypot(arm.links[2].a, arm.links[3].d) > 0:
        raise ArmError(f'{arm.name}: a2 and (a3, d4) have to be longer than nothing')


def solve(arm: Arm, poses: np.ndarray, theta4: float = 0.0) -> Solutions:
    """All branches of wire-tip poses (N, 4, 4), base frame, without limits.

    theta4 is taken where the wrist is stretched and theta4 and theta6 turn about the same axis. ArmError for an arm
    with another structure, ValueError for matrices that are no poses.
    """
    check_analytic(arm)
    poses = check_poses(poses, 'pose')
    flange = poses @ inverse(arm.tool)
    u, w = flange[:, :3, 0].T, flange[:, :3, 2].T  # (3, N)
    wrist = flange[:, :3, 3].T - arm.links[5].d * w
    out = np.empty((AXES, 2, 2, 2, len(poses)))  # shoulder, elbow, wrist
    c1, s1 = _shoulder(out[0], wrist)
    stretch = _elbow(arm, out[1:3], c1, s1, wrist)
    _wrist(out, c1, s1, u, w, theta4)
    theta = out.reshape(AXES, BRANCHES, -1)
    reachable = ~np.isnan(theta[1])
    theta[:, ~reachable] = np.nan
    return Solutions(np.moveaxis(theta, 0, -1).swapaxes(0, 1), reachable.T, wrist.T, stretch.T)


def _shoulder(theta1: np.ndarray, wrist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both theta1 into (2, 2, 2, N); their cosine and sine (2, 1, 1, N)."""
    px, py = wrist[0], wrist[1]
    first = np.arctan2(py, px)
    theta1[0] = first
    theta1[1] = np.where(first > 0, first - np.pi, first + np.pi)
    r = np.hypot(px, py)
    on_axis = r == 0.0
    safe = np.where(on_axis, 1.0, r)
    c, s = np.where(on_axis, 1.0, px / safe), py / safe
    return np.stack([c, -c])[:, None, None], np.stack([s, -s])[:, None, None]


def _elbow(
    arm: Arm, theta: np.ndarray, c1: np.ndarray, s1: np.ndarray, wrist: np.ndarray
) -> np.ndarray:
    """theta2 and theta3 into (2, 2, 2, 2, N), S3 eqs 3.4 to 3.7; returns k (2, N)."""
    a1, d1 = arm.links[0].a, arm.links[0].d
    a2, a3, d4 = arm.links[1].a, arm.links[2].a, arm.links[3].d
    v1 = (c1 * wrist[0] + s1 * wrist[1])[:, 0, 0] - a1  # (2, N)
    v2 = wrist[2] - d1
    r2 = v1 * v1 + v2 * v2
    r = np.sqrt(r2)
    with np.errstate(divide='ignore', invalid='ignore'):
        k = (a2 * a2 - d4 * d4 - a3 * a3 + r2) / (2 * a2 * r)
    k = np.where(np.isnan(k), np.inf, k)  # the wrist on joint 2 itself
    bound = np.where(np.abs(k) > 1 + EDGE, np.nan, np.clip(k, -1.0, 1.0))
    phi, bend = np.arctan2(v2, v1), np.arccos(bound)
    fore = np.arctan2(a3, d4)
    for n, sign in enumerate((1.0, -1.0)):
        theta2 = phi + sign * bend
        c2, s2 = np.cos(theta2), np.sin(theta2)
        theta3 = np.arctan2(c2 * v1 + s2 * v2 - a2, s2 * v1 - c2 * v2) - fore
        theta[0, :, n] = _into_turn(theta2)[:, None]
        theta[1, :, n] = _into_turn(theta3)[:, None]
    return k


def _wrist(
    out: np.ndarray, c1: np.ndarray, s1: np.ndarray, u: np.ndarray, w: np.ndarray, theta4: float
) -> None:
    """theta4, theta5 and theta6 into out[3:]."""
    c1, s1 = c1[:, :, 0], s1[:, :, 0]  # (2, 1, N)
    angle = out[1, :, :, 0] + out[2, :, :, 0]  # (2, 2, N)
    c23, s23 = np.cos(angle), np.sin(angle)
    v113, v323 = c1 * w[0] + s1 * w[1], s1 * w[0] - c1 * w[1]
    v313 = c23 * v113 + s23 * w[2]
    sine = np.sqrt(v313 * v313 + v323 * v323)
    stretched = sine < WRIST
    safe = np.where(stretched, 1.0, sine)
    c4 = np.where(stretched, np.cos(theta4), v313 / safe)
    s4 = np.where(stretched, np.sin(theta4), v323 / safe)
    c5 = s23 * v113 - c23 * w[2]
    # rows of the u column in the frames of joints 3 and 4
    u1, u3 = c1 * u[0] + s1 * u[1], s1 * u[0] - c1 * u[1]
    u31, u33 = c23 * u1 + s23 * u[2], s23 * u1 - c23 * u[2]
    s6, c6 = c4 * u3 - s4 * u31, c5 * (c4 * u31 + s4 * u3) - (c4 * v313 + s4 * v323) * u33
    four, five, six = np.arctan2(s4, c4), np.arctan2(sine, c5), np.arctan2(s6, c6)
    out[3, :, :, 0], out[4, :, :, 0], out[5, :, :, 0] = four, five, six
    out[3, :, :, 1] = np.where(four > 0, four - np.pi, four + np.pi)
    out[4, :, :, 1] = -five
    out[5, :, :, 1] = np.where(six > 0, six - np.pi, six + np.pi)


def _into_turn(angle: np.ndarray) -> np.ndarray:
    """-pi ... pi; the angles here lie less than a turn outside."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def unreachable_text(arm: Arm, found: Solutions, n: int) -> str:
    """Why pose n has no branch: where its wrist would be, and how far the arm reaches."""
    x, y, z = found.wrist[n] * 1e3
    a1, d1 = arm.links[0].a, arm.links[0].d
    fore = float(np.hypot(arm.links[2].a, arm.links[3].d))
    high, low = arm.links[1].a + fore, abs(arm.links[1].a - fore)
    flat = float(np.hypot(found.wrist[n, 0], found.wrist[n, 1]))
    near = float(np.hypot(flat - a1, found.wrist[n, 2] - d1))
    side = 'too far from' if near > high else 'too near to'
    return (
        f'out of reach: its wrist would be at ({x:.1f}, {y:.1f}, {z:.1f}) mm, {near * 1e3:.1f} mm from joint 2; '
        f'that is {side} it, the arm reaches {low * 1e3:.1f} to {high * 1e3:.1f} mm (k = {found.stretch[n, 0]:.3f})'
    )


def nearest_turns(arm: Arm, theta: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Angles (..., 6) with whole turns added: next to reference (6,) or (..., 6), inside limits where possible."""
    low, high = np.array(arm.low), np.array(arm.high)
    near = reference + wrapped(theta - reference)
    near = np.where(near > high, near - 2 * np.pi * np.ceil((near - high) / (2 * np.pi)), near)
    up = near + 2 * np.pi * np.ceil((low - near) / (2 * np.pi))
    return np.where((near < low) & (up <= high), up, near)


def choose(arm: Arm, found: Solutions, n: int, reference: np.ndarray) -> tuple[int, np.ndarray]:
    """(branch, angles (6,)) of pose n inside all limits whose largest joint move from reference is the smallest.

    ArmError that says why there is none.
    """
    if not found.any[n]:
        raise ArmError(f'pose {n}: {unreachable_text(arm, found, n)}')
    theta = nearest_turns(arm, found.theta[n], reference)
    allowed = found.reachable[n] & in_limits(arm, theta)
    if not allowed.any():
        said = [
            f'branch {b}: {limit_text(arm, theta[b])}'
            for b in range(BRANCHES)
            if found.reachable[n, b]
        ]
        raise ArmError(f'pose {n}: every branch is beyond a limit. ' + '. '.join(said))
    far = np.where(allowed, np.abs(theta - reference).max(axis=1), np.inf)
    best = int(np.argmin(far))
    return best, theta[best]
