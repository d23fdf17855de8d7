"""What of the arm serves a whole bead: spins and branches that reach every point inside all limits, away from
singularities and without a jump, what they cost, and why there is none."""

from __future__ import annotations

import numpy as np

from .arm import AXES, DEG, Arm, limit_text
from .bead import Bead
from .bead_turn import Turn
from .frames import wrapped
from .inverse import Solutions, unreachable_text
from .positioner import Positioner

WRIST = 3 * DEG  # nearest that theta5 may come to 0
ELBOW = 0.998  # largest k: 3.6 deg off full stretch
SHOULDER = 20e-3  # m: nearest that the wrist may come to the axis of joint 1
JUMP = 0.15  # rad between neighbouring points: more is a flip
TURNS = (-1, 0, 1)  # whole turns tried for every joint
NOTHING, REACH, SINGULAR, FLIP = 0, 1, 2, 4


def bad_places(theta: np.ndarray, wrist: np.ndarray, k: np.ndarray) -> np.ndarray:
    """(S, 8, N) int: what is wrong at a point, bits of REACH and SINGULAR."""
    lost = np.isnan(theta[..., 0])
    with np.errstate(invalid='ignore'):
        singular = (np.abs(np.sin(theta[..., 4])) < np.sin(WRIST)) | (k > ELBOW)
    singular |= (np.hypot(wrist[..., 0], wrist[..., 1]) < SHOULDER)[:, None]
    return lost * REACH | (singular & ~lost) * SINGULAR


def possible_nodes(
    arm: Arm, theta: np.ndarray, k: np.ndarray, bad: np.ndarray
) -> tuple[np.ndarray, ...] | None:
    """(node, shift, first, last, cost) of what works along the whole bead and inside all limits; None without any."""
    spin, branch = np.nonzero((bad == 0).all(axis=2))
    if not len(spin):
        return None
    some = theta[spin, branch]  # (K, N, 6)
    low, high = some.min(axis=1), some.max(axis=1)
    forearm = some[..., 1] + some[..., 2]
    found = []
    for turns in _turn_sets(low, high, arm):
        shift = 2 * np.pi * turns
        inside = ((low + shift >= arm.low) & (high + shift <= arm.high)).all(axis=1)
        bent = forearm + shift[1] + shift[2]
        inside &= (bent.min(axis=1) >= arm.forearm[0]) & (bent.max(axis=1) <= arm.forearm[1])
        n = np.nonzero(inside)[0]
        if len(n):
            cost = _cost(arm, low[n] + shift, high[n] + shift, some[n], k[spin[n], branch[n]])
            node = np.column_stack([spin[n], branch[n]])
            shifts = np.tile(shift, (len(n), 1))
            found.append((node, shifts, some[n, 0] + shift, some[n, -1] + shift, cost))
    if not found:
        return None
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def _turn_sets(low: np.ndarray, high: np.ndarray, arm: Arm) -> list[np.ndarray]:
    """Whole turns (6,) that bring at least one node inside each joint's range."""
    per_joint = [
        [
            t
            for t in TURNS
            if (
                (low[:, j] + 2 * np.pi * t >= arm.low[j])
                & (high[:, j] + 2 * np.pi * t <= arm.high[j])
            ).any()
        ]
        for j in range(AXES)
    ]
    return [np.array(t) for t in np.array(np.meshgrid(*per_joint)).reshape(AXES, -1).T]


def _cost(
    arm: Arm, low: np.ndarray, high: np.ndarray, theta: np.ndarray, k: np.ndarray
) -> np.ndarray:
    """(K,): grows towards limits and singularities; 1 is worth a move of 1 rad between beads."""
    middle = (np.array(arm.low) + np.array(arm.high)) / 2
    half = (np.array(arm.high) - np.array(arm.low)) / 2
    used = (np.maximum(np.abs(low - middle), np.abs(high - middle)) / half).max(axis=1)
    wrist = np.abs(np.sin(theta[..., 4])).min(axis=1)
    stretched = 1 - k.max(axis=1)
    return np.asarray(0.2 / (1.001 - used) + 0.2 / wrist + 0.02 / stretched)


# ---- reasons -----------------------------------------------------------------------------------


def beyond(number: int, bead: Bead, turn: Turn, positioner: Positioner) -> str:
    """Which axis of the positioner would be beyond its range first; '' = none."""
    for name, angles, n in (('B', turn.b, 0), ('C', turn.c, 1)):
        low, high = positioner.low[n], positioner.high[n]
        out = (angles < low) | (angles > high)
        if out.any():
            at = int(np.argmax(out))
            return (
                f'{place_text(number, bead, at)}: {name} of the positioner would be {angles[at] / DEG:.1f} deg, '
                f'its range {low / DEG:.1f} to {high / DEG:.1f}'
            )
    return ''


def place_text(number: int, bead: Bead, at: int) -> str:
    """Where the at-th point of a bead is, for people."""
    x, y, z = np.round(bead.points[at] * 1e3, 1) + 0.0
    return f'bead {number}, {bead.way[at] * 1e3:.1f} mm from its start, at ({x:.1f}, {y:.1f}, {z:.1f}) mm of the part'


def why(
    bead: Bead,
    arm: Arm,
    found: Solutions,
    theta: np.ndarray,
    bad: np.ndarray,
    spins: int,
) -> tuple[int, str]:
    """Point and reason of the spin and branch that came farthest."""
    count = len(bead.points)
    good = bad == 0
    far = np.where(good.all(axis=2), count, np.argmin(good, axis=2))
    spin, branch = np.unravel_index(int(far.argmax()), far.shape)
    at = int(far[spin, branch])
    if at == count:
        return _why_limits(arm, theta, good.all(axis=2))
    what = int(bad[spin, branch, at])
    if what & REACH:
        said = unreachable_text(arm, found, int(spin) * count + at)
    elif what & FLIP:
        said = f'a joint would jump by more than {JUMP:.2f} rad: the arm passes a singularity'
    else:
        five = abs(float(wrapped(theta[spin, branch, at, 4]))) / DEG
        said = (
            f'too near to a singularity (theta5 = {five:.1f} deg, at least {WRIST / DEG:.0f}; '
            f'k = {found.stretch[int(spin) * count + at, branch // 4]:.4f}, at most {ELBOW})'
        )
    return at, f'{said}. The other spins of the torch ({spins} tried) and branches fail before it'


def _why_limits(arm: Arm, theta: np.ndarray, whole: np.ndarray) -> tuple[int, str]:
    """The node that leaves its limits latest."""
    best, said = -1, ''
    low, high = np.array(arm.low), np.array(arm.high)
    for spin, branch in np.argwhere(whole):
        some = theta[spin, branch]
        turns = np.round(((low + high) / 2 - some.mean(axis=0)) / (2 * np.pi))
        some = some + 2 * np.pi * turns
        forearm = some[:, 1] + some[:, 2]
        out = (some < low) | (some > high)
        bent = (forearm < arm.forearm[0]) | (forearm > arm.forearm[1])
        beyond = out.any(axis=1) | bent
        at = int(np.argmax(beyond))
        if beyond.any() and at > best:
            best, said = at, limit_text(arm, some[at])
    if best < 0:
        return 0, 'no whole turn of the joints keeps all limits'
    return best, said + '. The other spins of the torch and branches are beyond a limit before it'
