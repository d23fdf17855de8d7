"""Joint paths of whole parts: positioner, torch spin and branch of every bead, so that nothing flips inside a bead.

The positioner keeps the bead flat (torch upright) where its two axes can. A torch is round: its spin about its own axis
is free and is chosen with the branch, constant inside a bead, by dynamic programming over the beads: away from limits
and singularities, with short ways between beads. The ways between beads are not planned. Collisions are looked at by
whoever asks for it (`refuse`; `waam_robot.clearance`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .arm import AXES, DEG, M20IB25, Arm, limit_text
from .bead import Bead, evened
from .frames import rotation, wrapped
from .inverse import BRANCHES, Solutions, solve, unreachable_text
from .positioner import Positioner
from .split import SplitLimits, chord_error, radius_error

LEAN = 3 * DEG  # a bead whose torch leans more than this everywhere decides C by its lean
WRIST = 3 * DEG  # nearest that theta5 may come to 0
ELBOW = 0.998  # largest k: 3.6 deg off full stretch
SHOULDER = 20e-3  # m: nearest that the wrist may come to the axis of joint 1
JUMP = 0.15  # rad between neighbouring points: more is a flip
TURNS = (-1, 0, 1)  # whole turns tried for every joint


class PlanError(ValueError):
    """There is no joint path; the text names bead, point, place and reason."""


@dataclass(frozen=True)
class Machine:
    """arm and positioner; spins: number of directions tried for the torch's spin; split: when C follows the
    point; turn_blend: m to both sides over which the turn of C is evened out: corners would ask it for jerks."""

    arm: Arm = M20IB25
    positioner: Positioner = field(default_factory=lambda: Positioner(a_b=1.2, d_b=0.35, d_c=0.15))
    spins: int = 12
    split: SplitLimits = field(default_factory=SplitLimits)
    turn_blend: float = 5e-3


@dataclass(frozen=True)
class BeadPath:
    """joints: (N, 8) six DH angles, B, C, rad; branch, spin (rad): constant in the bead; mode: 'lean', 'follow' or
    'hold', how C was chosen; off_flat: largest angle of the torch to upright, rad; wrist, stretch: the nearest that
    theta5 came to 0 (rad) and the largest k.
    """

    bead: Bead
    joints: np.ndarray
    branch: int
    spin: float
    mode: str
    off_flat: float
    wrist: float
    stretch: float


Refuse = Callable[[int, BeadPath], 'Refused | None']


@dataclass(frozen=True)
class Refused:
    """Why a bead is not laid so: at: m along it; final: with another spin or branch it would be the same."""

    at: float
    text: str
    final: bool = False


def plan(
    beads: list[Bead], machine: Machine | None = None, refuse: Refuse | None = None
) -> list[BeadPath]:
    """Joint paths of beads in this order. PlanError where a bead cannot be laid in one go.

    refuse: asked for every path that would be taken (number of the bead, path); the next best one is taken for those
    that it refuses.
    """
    machine = machine or Machine()
    stages, c = [], None
    for number, bead in enumerate(beads):
        turn = _turn(bead, machine, c)
        c = float(turn.c[-1])
        stages.append(_stage(number, bead, turn, machine))
    nodes = _cheapest(stages) if refuse is None else _allowed(stages, refuse)
    return [stage.path(node) for stage, node in zip(stages, nodes, strict=True)]


def _allowed(stages: list[_Stage], refuse: Refuse) -> list[int]:
    """The cheapest nodes of which none is refused."""
    good: set[tuple[int, int]] = set()
    while True:
        nodes = list(enumerate(_cheapest(stages)))
        for number, node in nodes:
            if (number, node) not in good:
                said = refuse(number, stages[number].path(node))
                if said is None:
                    good.add((number, node))
                else:
                    stages[number].exclude(number, node, said)
        if good.issuperset(nodes):
            return [node for _, node in nodes]


# ---- positioner --------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Turn:
    """b, c: (N,) rad; poses: (N, 4, 4) of the torch in the robot's frame, spin 0; off_flat: (N,) rad."""

    b: np.ndarray
    c: np.ndarray
    mode: str
    points: np.ndarray
    axes: np.ndarray

    @property
    def off_flat(self) -> np.ndarray:
        return np.arctan2(np.hypot(self.axes[:, 0], self.axes[:, 1]), self.axes[:, 2])


def _turn(bead: Bead, machine: Machine, before: float | None) -> _Turn:
    """B and C along a bead. `before`: C at the end of the bead before."""
    mode, swing = _azimuth(bead, machine.split)
    swing = evened(swing, int(machine.turn_blend / bead.way[1]))
    first = float(wrapped(swing[0] + 3 * np.pi / 2))
    if before is not None:
        first = before if mode == 'hold' else before + float(wrapped(np.array(first - before)))
    c = first + swing - swing[0]
    positioner = machine.positioner
    seen = positioner.turned(_poses(bead.points, bead.axes), c)
    b = np.arctan2(seen[:, 0, 2], seen[:, 2, 2])
    held = positioner.faceplate(b) @ seen
    return _Turn(b, c, mode, held[:, :3, 3], held[:, :3, 2])


def _azimuth(bead: Bead, limits: SplitLimits) -> tuple[str, np.ndarray]:
    """How C goes along a bead, and the azimuth (N,) that it follows, without jumps."""
    flat = np.hypot(bead.axes[:, 0], bead.axes[:, 1])
    if np.arctan2(flat, bead.axes[:, 2]).min() >= LEAN:
        return 'lean', np.unwrap(np.arctan2(-bead.axes[:, 1], -bead.axes[:, 0]))
    radius = np.hypot(bead.points[:, 0], bead.points[:, 1])
    if radius.min() >= limits.r_crit:
        azimuth = np.unwrap(np.arctan2(bead.points[:, 1], bead.points[:, 0]))
        near0 = chord_error(radius[:-1], np.diff(azimuth)) <= limits.delta0
        near1 = radius_error(radius[:-1], radius[1:]) <= limits.delta1
        if near0.all() and near1.all() and abs(azimuth[-1] - azimuth[0]) > np.pi / 2:
            return 'follow', azimuth  # it goes around the axis
    return 'hold', np.full(len(bead.points), np.arctan2(bead.points[0, 1], bead.points[0, 0]))


def _poses(points: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(N, 4, 4) with z along the axes; x anyhow."""
    helper = np.where(np.abs(axes[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    return _framed(points, axes, helper)


def _framed(points: np.ndarray, z: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(N, 4, 4): z as given, x as near to `towards` (N, 3) as a right angle to z allows."""
    x = towards - np.einsum('ij,ij->i', z, towards)[:, None] * z
    x /= np.linalg.norm(x, axis=1)[:, None]
    out = np.zeros((len(points), 4, 4))
    out[:, :3, 0], out[:, :3, 1], out[:, :3, 2], out[:, :3, 3] = x, np.cross(z, x), z, points
    out[:, 3, 3] = 1.0
    return out


# ---- one bead: its nodes -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Stage:
    """Nodes of a bead: spin and branch (K,), whole turns (K, 6), angles at both ends (K, 6), cost (K,);
    theta: (S, 8, N, 6) without turns."""

    bead: Bead
    turn: _Turn
    theta: np.ndarray
    spins: np.ndarray
    k: np.ndarray
    node: np.ndarray
    shift: np.ndarray
    first: np.ndarray
    last: np.ndarray
    cost: np.ndarray

    def path(self, n: int) -> BeadPath:
        spin, branch = self.node[n]
        theta = self.theta[spin, branch] + self.shift[n]
        joints = np.column_stack([theta, self.turn.b, self.turn.c])
        off = float(self.turn.off_flat.max())
        wrist = float(np.abs(wrapped(theta[:, 4])).min())
        k = float(self.k[spin, branch].max())
        return BeadPath(
            self.bead, joints, int(branch), float(self.spins[spin]), self.turn.mode, off, wrist, k
        )

    def exclude(self, number: int, n: int, said: Refused) -> None:
        """Takes spin and branch of a node out, whatever its whole turns; PlanError where nothing else is left."""
        self.cost[(self.node == self.node[n]).all(axis=1)] = np.inf
        if said.final or not np.isfinite(self.cost).any():
            at = int(np.searchsorted(self.bead.way, said.at))
            raise PlanError(f'{_place(number, self.bead, at)}: {said.text}')


def _stage(number: int, bead: Bead, turn: _Turn, machine: Machine) -> _Stage:
    _check_positioner(number, bead, turn, machine.positioner)
    arm, count = machine.arm, len(bead.points)
    spins = np.arange(machine.spins) * 2 * np.pi / machine.spins
    poses = np.concatenate(
        [
            _framed(turn.points, turn.axes, np.tile([np.cos(s), np.sin(s), 0.0], (count, 1)))
            for s in spins
        ]
    )
    found = solve(arm, poses @ rotation(0, np.pi))
    theta = found.theta.reshape(machine.spins, count, BRANCHES, AXES).swapaxes(1, 2)
    wrist = found.wrist.reshape(machine.spins, count, 3)
    k = found.stretch.reshape(machine.spins, count, 2)[:, :, np.arange(BRANCHES) // 4]
    k = np.abs(k.swapaxes(1, 2))
    bad = bad_places(theta, wrist, k)
    theta = np.unwrap(theta, axis=2)
    step = np.abs(np.diff(theta, axis=2)).max(axis=-1) > JUMP
    bad[:, :, 1:] |= step << 2
    nodes = possible_nodes(arm, theta, k, bad)
    if nodes is None:
        raise PlanError(_why(number, bead, arm, found, theta, bad, machine.spins))
    return _Stage(bead, turn, theta, spins, k, *nodes)


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


# ---- whole part --------------------------------------------------------------------------------


def _cheapest(stages: list[_Stage]) -> list[int]:
    """Dynamic programming over the beads: nodes with the least sum of costs and of largest joint moves between."""
    total, back = [], []
    for n, stage in enumerate(stages):
        if n == 0:
            total.append(stage.cost)
            continue
        before = stages[n - 1]
        move = np.abs(before.last[:, None] - stage.first[None]).max(axis=-1)
        reach = total[-1][:, None] + move
        back.append(reach.argmin(axis=0))
        total.append(reach.min(axis=0) + stage.cost)
    if not stages:
        return []
    chosen = [int(total[-1].argmin())]
    for links in reversed(back):
        chosen.append(int(links[chosen[-1]]))
    return chosen[::-1]


# ---- reasons -----------------------------------------------------------------------------------


def _check_positioner(number: int, bead: Bead, turn: _Turn, positioner: Positioner) -> None:
    for name, angles, n in (('B', turn.b, 0), ('C', turn.c, 1)):
        low, high = positioner.low[n], positioner.high[n]
        out = (angles < low) | (angles > high)
        if out.any():
            at = int(np.argmax(out))
            raise PlanError(
                f'{_place(number, bead, at)}: {name} of the positioner would be {angles[at] / DEG:.1f} deg, '
                f'its range {low / DEG:.1f} to {high / DEG:.1f}'
            )


def _place(number: int, bead: Bead, at: int) -> str:
    x, y, z = np.round(bead.points[at] * 1e3, 1) + 0.0
    return f'bead {number}, {bead.way[at] * 1e3:.1f} mm from its start, at ({x:.1f}, {y:.1f}, {z:.1f}) mm of the part'


def _why(
    number: int,
    bead: Bead,
    arm: Arm,
    found: Solutions,
    theta: np.ndarray,
    bad: np.ndarray,
    spins: int,
) -> str:
    """Bead, place and reason of the spin and branch that came farthest."""
    count = len(bead.points)
    good = bad == 0
    far = np.where(good.all(axis=2), count, np.argmin(good, axis=2))
    spin, branch = np.unravel_index(int(far.argmax()), far.shape)
    at = int(far[spin, branch])
    if at == count:
        return _why_limits(number, bead, arm, theta, good.all(axis=2))
    said = f'{_place(number, bead, at)}: '
    what = int(bad[spin, branch, at])
    if what & REACH:
        said += unreachable_text(arm, found, int(spin) * count + at)
    elif what & FLIP:
        said += f'a joint would jump by more than {JUMP:.2f} rad: the arm passes a singularity'
    else:
        five = abs(float(wrapped(theta[spin, branch, at, 4]))) / DEG
        said += (
            f'too near to a singularity (theta5 = {five:.1f} deg, at least {WRIST / DEG:.0f}; '
            f'k = {found.stretch[int(spin) * count + at, branch // 4]:.4f}, at most {ELBOW})'
        )
    return said + f'. The other spins of the torch ({spins} tried) and branches fail before it'


def _why_limits(number: int, bead: Bead, arm: Arm, theta: np.ndarray, whole: np.ndarray) -> str:
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
            best, said = at, f'{_place(number, bead, at)}: {limit_text(arm, some[at])}'
    if best < 0:
        return f'{_place(number, bead, 0)}: no whole turn of the joints keeps all limits'
    return said + '. The other spins of the torch and branches are beyond a limit before it'
