"""Joint paths of whole parts: positioner, torch spin and branch of every bead, so that nothing flips inside a bead.

The positioner keeps the bead flat (torch upright) where its two axes can; what its turn is free by (`bead_turn`) is
chosen for every bead so that the arm stays away from limits and singularities. A torch is round: its spin about its own
axis is free and is chosen with the branch, constant inside a bead, by dynamic programming over the beads: away from
limits and singularities, with short ways between beads. Collisions, and the ways between beads, are looked
at by whoever asks for it (`refuse`; `waam_robot.clearance`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from .arm import AXES, M20IB25, Arm
from .bead import Bead
from .bead_turn import Turn, framed, turns_of
from .frames import rotation, wrapped
from .inverse import BRANCHES, Solutions, solve
from .joint_nodes import JUMP, bad_places, beyond, place_text, possible_nodes, why
from .positioner import Positioner
from .split import SplitLimits

LOOKED = 24  # points of a bead by which turns of the positioner are compared
WORTH = 0.9  # share of the cost of the usual turn from which on another one is worth it
UNEVEN = 5.0  # cost of 1 rad of the torch to upright


class PlanError(ValueError):
    """There is no joint path; the text names bead, point, place and reason. point: (3,) m of the part, where there is
    one; reason: without the place."""

    def __init__(self, text: str, point: np.ndarray | None = None, reason: str = '') -> None:
        super().__init__(text)
        self.point, self.reason = point, reason or text

    @classmethod
    def on(cls, number: int, bead: Bead, at: int, reason: str) -> PlanError:
        """At the at-th point of a bead."""
        return cls(f'{place_text(number, bead, at)}: {reason}', bead.points[at], reason)


@dataclass(frozen=True)
class Machine:
    """arm and positioner; spins: number of directions tried for the torch's spin; turns: of turns tried for the
    positioner where it is free; split: when C follows the point; turn_blend: m to both sides over which the turn of C
    is evened out: corners would ask it for jerks."""

    arm: Arm = M20IB25
    positioner: Positioner = field(default_factory=lambda: Positioner(a_b=1.2, d_b=0.35, d_c=0.15))
    spins: int = 12
    turns: int = 8
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
    stages: list[_Stage] = []
    others: list[Iterator[_Stage]] = []
    for number, bead in enumerate(beads):
        before = float(stages[-1].turn.c[-1]) if stages else None
        ways = _stages(number, bead, machine, before)
        stages.append(next(ways))
        others.append(ways)
    nodes = _cheapest(stages) if refuse is None else _allowed(stages, others, refuse)
    return [stage.path(node) for stage, node in zip(stages, nodes, strict=True)]


def _allowed(stages: list[_Stage], others: list[Iterator[_Stage]], refuse: Refuse) -> list[int]:
    """The cheapest nodes of which none is refused; a bead without any gets the next one of `others`."""
    good: set[tuple[int, int]] = set()
    refused: dict[int, PlanError] = {}  # the first reason for each bead
    while True:
        nodes = list(enumerate(_cheapest(stages)))
        for number, node in nodes:
            if (number, node) in good:
                continue
            said = refuse(number, stages[number].path(node))
            if said is None:
                good.add((number, node))
                continue
            try:
                stages[number].exclude(number, node, said)
            except PlanError as e:
                first = refused.setdefault(number, e)
                another = None if said.final else next(others[number], None)
                if another is None:
                    raise first from None
                stages[number] = another
                good = {pair for pair in good if pair[0] != number}
        if good.issuperset(nodes):
            return [node for _, node in nodes]


# ---- one bead: its nodes -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Stage:
    """Nodes of a bead: spin and branch (K,), whole turns (K, 6), angles at both ends (K, 6), cost (K,);
    theta: (S, 8, N, 6) without turns."""

    bead: Bead
    turn: Turn
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
            raise PlanError.on(number, self.bead, at, said.text)


def _stages(number: int, bead: Bead, machine: Machine, before: float | None) -> Iterator[_Stage]:
    """Nodes of a bead for every turn of the positioner that serves it, the best first. PlanError where none does.
    before: C at the end of the bead before."""
    turns = turns_of(
        bead, machine.positioner, machine.split, machine.turn_blend, before, machine.turns
    )
    error, served = None, False
    for turn in _ordered(bead, turns, machine):
        try:
            stage = _stage(number, bead, turn, machine)
        except PlanError as e:
            error = e if error is None or turn is turns[0] else error
            continue
        served = True
        yield stage
    if not served and error is not None:
        raise error


def _ordered(bead: Bead, turns: list[Turn], machine: Machine) -> list[Turn]:
    """The best first, by the least cost at some of their points; the usual one before what is hardly better."""
    if len(turns) == 1:
        return turns
    places = np.unique(np.linspace(0, len(bead.points) - 1, LOOKED).astype(int))
    cost = np.array([_roughly(turn.some(places), machine) for turn in turns])
    cost += [abs(float(turn.c[0] - turns[0].c[0])) for turn in turns]
    cost[0] *= WORTH
    order = np.argsort(cost, kind='stable')
    return [turns[n] for n in order if n == 0 or np.isfinite(cost[n])]


def _roughly(turn: Turn, machine: Machine) -> float:
    """Least cost of a node at these points, inf = there is none; jumps between them are not looked at."""
    found = _solved(turn, machine, np.inf)
    nodes = possible_nodes(machine.arm, found.theta, found.k, found.bad)
    return np.inf if nodes is None else float(nodes[-1].min() + UNEVEN * turn.off_flat.max())


@dataclass(frozen=True)
class _Solved:
    """theta (S, 8, N, 6) rad, k and bad (S, 8, N) of all spins (S,) and branches."""

    found: Solutions
    theta: np.ndarray
    k: np.ndarray
    bad: np.ndarray
    spins: np.ndarray


def _stage(number: int, bead: Bead, turn: Turn, machine: Machine) -> _Stage:
    said = beyond(number, bead, turn, machine.positioner)
    if said:
        raise PlanError(said)
    solved = _solved(turn, machine, JUMP)
    nodes = possible_nodes(machine.arm, solved.theta, solved.k, solved.bad)
    if nodes is None:
        s = solved
        at, said = why(bead, machine.arm, s.found, s.theta, s.bad, machine.spins)
        raise PlanError.on(number, bead, at, said)
    return _Stage(bead, turn, solved.theta, solved.spins, solved.k, *nodes)


def _solved(turn: Turn, machine: Machine, jump: float) -> _Solved:
    """jump: rad, of a joint between neighbouring points that is a flip."""
    count = len(turn.c)
    spins = np.arange(machine.spins) * 2 * np.pi / machine.spins
    poses = np.concatenate(
        [
            framed(turn.points, turn.axes, np.tile([np.cos(s), np.sin(s), 0.0], (count, 1)))
            for s in spins
        ]
    )
    found = solve(machine.arm, poses @ rotation(0, np.pi))
    theta = found.theta.reshape(machine.spins, count, BRANCHES, AXES).swapaxes(1, 2)
    wrist = found.wrist.reshape(machine.spins, count, 3)
    k = found.stretch.reshape(machine.spins, count, 2)[:, :, np.arange(BRANCHES) // 4]
    k = np.abs(k.swapaxes(1, 2))
    bad = bad_places(theta, wrist, k)
    theta = np.unwrap(theta, axis=2)
    step = np.abs(np.diff(theta, axis=2)).max(axis=-1) > jump
    bad[:, :, 1:] |= step << 2
    return _Solved(found, theta, k, bad, spins)


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
