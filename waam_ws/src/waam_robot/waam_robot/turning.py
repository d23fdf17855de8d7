"""How the positioner turns a level part while the torch goes: the redundancy of six axes, tilt and turn in a job.

A torch on a level part leaves the turn C free. It is a linear function of where the torch is, start + along . (x, y)
from the middle of the box. So it is smooth, the same on every way to a place, and it serves beads, scans and idle moves
alike; nothing above the robot knows of it. `turn_choice.choose` chooses it so that the arm stays away from limits and
singularities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm import AXES, Arm
from .inverse import BRANCHES, solve
from .joint_nodes import JUMP, bad_places, possible_nodes

SPINS = 12
OVER = np.diag([1.0, -1.0, -1.0, 1.0])  # half a turn about x: the tool's z points to the part


@dataclass(frozen=True)
class Turning:
    """start: rad at the middle of the box, beside where the positioner stands at rest; along: (2,) rad/m of x and y."""

    start: float = 0.0
    along: tuple[float, float] = (0.0, 0.0)

    @property
    def still(self) -> bool:
        """The part does not turn, and stands as at rest."""
        return not (self.start or any(self.along))

    def at(self, tips: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(N,) rad for torch positions (N, 3), m, machine coordinates; middle: (3,) m of the box."""
        apart = np.asarray(tips, float)[:, :2] - middle[:2]
        return np.asarray(self.start + apart @ np.array(self.along))

    @property
    def text(self) -> str:
        """For people."""
        x, y = np.degrees(self.along) * 1e-3
        return f'{np.degrees(self.start):.0f} deg, and {x:.3f} deg per mm of x, {y:.3f} deg per mm of y'


@dataclass(frozen=True)
class Way:
    """branch and spin (rad) of the arm that are best along a path; middle: (6,) rad, mean of its angles there; used:
    largest share of a joint's range that it takes; wrist: rad, nearest that theta5 comes to 0; stretch: largest k;
    cost: of `joint_path`."""

    branch: int
    spin: float
    middle: np.ndarray
    used: float
    wrist: float
    stretch: float
    cost: float

    @property
    def text(self) -> str:
        """For people."""
        return (
            f'{self.used:.0%} of a joint\'s range, {np.degrees(self.wrist):.0f} deg off a stretched wrist, '
            f'{self.stretch:.1%} of the reach'
        )


def best_way(arm: Arm, upright: np.ndarray, tool: np.ndarray, jump: float = JUMP) -> Way | None:
    """The best branch and spin for poses `upright` (N, 4, 4), machine axes at the torch along a path; tool: (4, 4), the
    torch on them at spin 0; jump: rad, of a joint between neighbours that is too much. None where no single branch and
    spin serve all of it."""
    spins = np.arange(SPINS) * 2 * np.pi / SPINS
    poses = np.concatenate([upright @ spun(s) @ tool for s in spins])
    count = len(upright)
    found = solve(arm, poses)
    theta = found.theta.reshape(SPINS, count, BRANCHES, AXES).swapaxes(1, 2)
    k = found.stretch.reshape(SPINS, count, 2)[:, :, np.arange(BRANCHES) // 4]
    k = np.abs(k.swapaxes(1, 2))
    bad = bad_places(theta, found.wrist.reshape(SPINS, count, 3), k)
    theta = np.unwrap(theta, axis=2)
    with np.errstate(invalid='ignore'):
        bad[:, :, 1:] |= (np.abs(np.diff(theta, axis=2)).max(axis=-1) > jump) << 2
    nodes = possible_nodes(arm, theta, k, bad)
    if nodes is None:
        return None
    node, shift, _, _, cost = nodes
    n = int(cost.argmin())
    spin, branch = map(int, node[n])
    angles = theta[spin, branch] + shift[n]
    half = (np.array(arm.high) - np.array(arm.low)) / 2
    used = np.abs(angles - (np.array(arm.high) + np.array(arm.low)) / 2).max(axis=0) / half
    wrist = float(np.arcsin(np.abs(np.sin(angles[:, 4])).min()))
    return Way(
        branch, float(spins[spin]), angles.mean(axis=0), float(used.max()), wrist,
        float(k[spin, branch].max()), float(cost[n]),
    )  # fmt: skip


def spun(angle: float) -> np.ndarray:
    """(4, 4): about z."""
    out, (c, s) = np.eye(4), (np.cos(angle), np.sin(angle))
    out[:2, :2] = [[c, -s], [s, c]]
    return out
