"""Which branch of the arm and which spin of the torch serve a whole path: inside all limits, away from singularities,
without a jump. What each costs, and why there is none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .arm import AXES, DEG, Arm, limit_text
from .frames import wrapped
from .inverse import BRANCHES, Solutions, solve, unreachable_text

SPINS = 12  # directions of the torch's spin about its own axis that are tried
OVER = np.diag([1.0, -1.0, -1.0, 1.0])  # half a turn about x: the tool's z points to the part
WRIST_MIN = 3 * DEG  # nearest that theta5 may come to 0
STRETCH_MAX = 0.998  # largest k: 3.6 deg off full stretch
SHOULDER_MIN = 20e-3  # m: nearest that the wrist may come to the axis of joint 1
JUMP_MAX = 0.15  # rad between neighbouring points: more is a flip
TURNS = (-1, 0, 1)  # whole turns tried for every joint
OUT_OF_REACH, SINGULAR, FLIP = 1, 2, 4  # bits


class NoWay(ValueError):
    """Nothing serves the whole path. at: number of the point where the best one fails."""

    def __init__(self, at: int, reason: str) -> None:
        super().__init__(reason)
        self.at = at


@dataclass(frozen=True)
class Way:
    """joints: (N, 6) rad along the path, with one branch and spin (rad); used: largest share of a joint's range that it
    takes; wrist: rad, nearest that theta5 comes to 0; stretch: largest k; cost: grows towards limits and
    singularities."""

    branch: int
    spin: float
    joints: np.ndarray
    used: float
    wrist: float
    stretch: float
    cost: float

    @property
    def middle(self) -> np.ndarray:
        """(6,) rad: mean of the angles along the path."""
        return np.asarray(self.joints.mean(axis=0))

    @property
    def text(self) -> str:
        """For people."""
        return (
            f'{self.used:.0%} of a joint\'s range, {np.degrees(self.wrist):.0f} deg off a stretched wrist, '
            f'{self.stretch:.1%} of the reach'
        )


def ways(arm: Arm, upright: np.ndarray, jump: float = JUMP_MAX) -> Iterator[Way]:
    """What serves a path, the cheapest first. upright: (N, 4, 4), machine axes at the torch along it; jump: rad, of a
    joint between neighbours that is too much. NoWay where nothing does."""
    spins = np.arange(SPINS) * 2 * np.pi / SPINS
    count = len(upright)
    found = solve(arm, np.concatenate([upright @ spun(s) @ OVER for s in spins]))
    theta = found.theta.reshape(SPINS, count, BRANCHES, AXES).swapaxes(1, 2)
    k = found.stretch.reshape(SPINS, count, 2)[:, :, np.arange(BRANCHES) // 4]
    k = np.abs(k.swapaxes(1, 2))
    bad = _bad_places(theta, found.wrist.reshape(SPINS, count, 3), k)
    theta = np.unwrap(theta, axis=2)
    with np.errstate(invalid='ignore'):
        bad[:, :, 1:] |= (np.abs(np.diff(theta, axis=2)).max(axis=-1) > jump) * FLIP
    inside = _inside_limits(arm, theta, (bad == 0).all(axis=2))
    if not inside:
        raise NoWay(*_why(arm, found, theta, bad))
    half = (np.array(arm.high) - np.array(arm.low)) / 2
    costs = [_cost(arm, theta[s, b] + shift, k[s, b]) for s, b, shift in inside]
    for n in np.argsort(costs, kind='stable'):
        spin, branch, shift = inside[n]
        joints = theta[spin, branch] + shift
        off = np.abs(joints - (np.array(arm.high) + np.array(arm.low)) / 2).max(axis=0)
        wrist = float(np.arcsin(np.abs(np.sin(joints[:, 4])).min()))
        yield Way(
            branch, float(spins[spin]), joints, float((off / half).max()), wrist,
            float(k[spin, branch].max()), costs[n],
        )  # fmt: skip


def spun(angle: float) -> np.ndarray:
    """(4, 4): about z."""
    out, (c, s) = np.eye(4), (np.cos(angle), np.sin(angle))
    out[:2, :2] = [[c, -s], [s, c]]
    return out


def _bad_places(theta: np.ndarray, wrist: np.ndarray, k: np.ndarray) -> np.ndarray:
    """(S, 8, N) int: what is wrong at a point, bits of OUT_OF_REACH and SINGULAR."""
    lost = np.isnan(theta[..., 0])
    with np.errstate(invalid='ignore'):
        singular = (np.abs(np.sin(theta[..., 4])) < np.sin(WRIST_MIN)) | (k > STRETCH_MAX)
    singular |= (np.hypot(wrist[..., 0], wrist[..., 1]) < SHOULDER_MIN)[:, None]
    return lost * OUT_OF_REACH | (singular & ~lost) * SINGULAR


def _inside_limits(
    arm: Arm, theta: np.ndarray, whole: np.ndarray
) -> list[tuple[int, int, np.ndarray]]:
    """(spin, branch, whole turns (6,) rad) that keep theta (S, 8, N, 6) inside all limits, of the `whole` (S, 8)."""
    found = []
    for spin, branch in np.argwhere(whole).tolist():
        some = theta[spin, branch]
        low, high = some.min(axis=0), some.max(axis=0)
        forearm = some[:, 1] + some[:, 2]
        fitting = [
            [t for t in TURNS
             if low[j] + 2 * np.pi * t >= arm.low[j] and high[j] + 2 * np.pi * t <= arm.high[j]]
            for j in range(AXES)
        ]  # fmt: skip
        for turns in np.array(np.meshgrid(*fitting)).reshape(AXES, -1).T:
            bent = forearm + 2 * np.pi * (turns[1] + turns[2])
            if bent.min() >= arm.forearm[0] and bent.max() <= arm.forearm[1]:
                found.append((spin, branch, 2 * np.pi * turns))
    return found


def _cost(arm: Arm, joints: np.ndarray, k: np.ndarray) -> float:
    middle = (np.array(arm.low) + np.array(arm.high)) / 2
    half = (np.array(arm.high) - np.array(arm.low)) / 2
    used = float((np.abs(joints - middle).max(axis=0) / half).max())
    wrist = float(np.abs(np.sin(joints[:, 4])).min())
    return 0.2 / (1.001 - used) + 0.2 / wrist + 0.02 / (1 - float(k.max()))


# ---- reasons -----------------------------------------------------------------------------------


def _why(arm: Arm, found: Solutions, theta: np.ndarray, bad: np.ndarray) -> tuple[int, str]:
    """Point and reason of the spin and branch that came farthest."""
    count = bad.shape[2]
    good = bad == 0
    far = np.where(good.all(axis=2), count, np.argmin(good, axis=2))
    spin, branch = np.unravel_index(int(far.argmax()), far.shape)
    at = int(far[spin, branch])
    if at == count:
        return _why_limits(arm, theta, good.all(axis=2))
    what = int(bad[spin, branch, at])
    if what & OUT_OF_REACH:
        said = unreachable_text(arm, found, int(spin) * count + at)
    elif what & FLIP:
        said = f'a joint would jump by more than {JUMP_MAX:.2f} rad: the arm passes a singularity'
    else:
        five = abs(float(wrapped(theta[spin, branch, at, 4]))) / DEG
        k = found.stretch[int(spin) * count + at, branch // 4]
        said = (
            f'too near to a singularity (theta5 = {five:.1f} deg, at least {WRIST_MIN / DEG:.0f}; '
            f'k = {k:.4f}, at most {STRETCH_MAX})'
        )
    return at, f'{said}. The other spins of the torch ({SPINS} tried) and branches fail before it'


def _why_limits(arm: Arm, theta: np.ndarray, whole: np.ndarray) -> tuple[int, str]:
    """The spin and branch that leave their limits latest."""
    best, said = -1, ''
    low, high = np.array(arm.low), np.array(arm.high)
    for spin, branch in np.argwhere(whole):
        some = theta[spin, branch]
        turns = np.round(((low + high) / 2 - some.mean(axis=0)) / (2 * np.pi))
        some = some + 2 * np.pi * turns
        forearm = some[:, 1] + some[:, 2]
        beyond = ((some < low) | (some > high)).any(axis=1)
        beyond |= (forearm < arm.forearm[0]) | (forearm > arm.forearm[1])
        at = int(np.argmax(beyond))
        if beyond.any() and at > best:
            best, said = at, limit_text(arm, some[at])
    if best < 0:
        return 0, 'no whole turn of the joints keeps all limits'
    return best, said + '. The other spins of the torch and branches are beyond a limit before it'
