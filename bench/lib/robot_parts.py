"""Parts as beads for bench_robot.py, and what their joint paths are judged by: a second way, from the joints alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waam_robot.arm import link_frames
from waam_robot.bead import Bead, make_bead
from waam_robot.clearance import plan_clear
from waam_robot.collision import Scene
from waam_robot.joint_nodes import JUMP
from waam_robot.joint_path import BeadPath, Machine, PlanError, plan
from waam_robot.timing import part_pose, time_bead, torch_speed

SPEED = 10e-3  # m/s
LAYER, PITCH = 2e-3, 4.4e-3


def round_bead(
    radius: Callable[[np.ndarray], np.ndarray],
    lean: Callable[[np.ndarray], np.ndarray],
    z: Callable[[np.ndarray], np.ndarray],
    turns: float = 1.0,
) -> Bead:
    """A bead around the turn axis; radius (m), inward lean (rad) and z (m) over the turn (0 ... turns)."""
    t = np.linspace(0, turns, int(3000 * turns) + 1)
    a = 2 * np.pi * t
    r, leans = radius(t), lean(t) + 0 * t
    points = np.stack([r * np.cos(a), r * np.sin(a), z(t) + 0 * t], axis=1)
    axes = np.stack([-np.sin(leans) * np.cos(a), -np.sin(leans) * np.sin(a), np.cos(leans)], axis=1)
    return make_bead(points, axes)


def oval() -> list[Bead]:
    """500 mm, 5 % ovality, two layers."""

    def radius(t):
        a = 2 * np.pi * t
        return 0.25 * 0.95 / np.hypot(0.95 * np.cos(a), np.sin(a))

    return [round_bead(radius, lambda t: 0 * t, lambda t, n=n: n * LAYER + 0 * t) for n in range(2)]


def pad() -> list[Bead]:
    """60 x 35 mm beside the axis, beads turned around with the arc on, two layers."""
    y = np.arange(9) * PITCH
    points = np.array([[x, v, 0] for n, v in enumerate(y) for x in ((0, 0.06), (0.06, 0))[n % 2]])
    return [make_bead(points + [0.02, 0.01, n * LAYER]) for n in range(2)]


def cone() -> list[Bead]:
    """Leaning by 25 degrees, three layers."""
    lean = np.radians(25)
    return [
        round_bead(
            lambda t, n=n: 0.12 - n * LAYER * np.sin(lean) + 0 * t,
            lambda t: lean,
            lambda t, n=n: n * LAYER * np.cos(lean) + 0 * t,
        )
        for n in range(3)
    ]


def vase() -> list[Bead]:
    """One helix of three turns, its lean from 5 to 60 degrees."""
    return [
        round_bead(
            lambda t: 0.10 - 0.01 * t,
            lambda t: np.radians(5 + 55 * t / 3),
            lambda t: LAYER * t,
            3.0,
        )
    ]


def frame() -> list[Bead]:
    """Square outlines of 80 and 70 mm about the axis, two layers."""
    square = np.array([[-1, 0], [-1, -1], [1, -1], [1, 1], [-1, 1], [-1, 0]])
    return [
        make_bead(np.column_stack([square * half, np.full(6, n * LAYER)]))
        for n in range(2)
        for half in (0.04, 0.035)
    ]


def wall() -> list[Bead]:
    """A wall of 200 mm past the axis at 30 mm, leaning by 40 degrees, eight layers there and back."""
    lean = np.radians(40)
    axis = np.tile([0, -np.sin(lean), np.cos(lean)], (2, 1))
    ends = np.array([[-0.1, 0.03, 0], [0.1, 0.03, 0]])
    return [make_bead((ends + n * LAYER * axis)[:: 1 - 2 * (n % 2)], axis) for n in range(8)]


PARTS = {'oval': oval, 'pad': pad, 'cone': cone, 'vase': vase, 'frame': frame, 'wall': wall}


@dataclass
class Result:
    """points planned, seconds of the whole plan with timing; off: |v / programmed - 1| that 99 % of the way keep;
    told: share of the way that the plan itself tells to be slower; used: largest use of a limit."""

    points: int
    seconds: float
    off: float
    told: float
    used: float


def run(beads: list[Bead], machine: Machine) -> Result:
    """Joint paths and timing of a part; its torch speed by forward kinematics."""
    begin = time.perf_counter()
    paths = plan_clear(beads, Scene(machine))
    timed = [time_bead(path, SPEED) for path in paths]
    seconds = time.perf_counter() - begin
    if flips(paths, machine):
        raise SystemExit('a flip inside a bead')
    off = np.concatenate([np.abs(torch_speed(t, machine) / SPEED - 1) for t in timed])
    way = np.concatenate([np.gradient(t.way) for t in timed])
    order = np.argsort(off)
    share = np.cumsum(way[order]) / way.sum()
    told = sum(s.end - s.begin for t in timed for s in t.slow) / way.sum()
    return Result(
        sum(len(b.points) for b in beads),
        seconds,
        float(off[order][np.searchsorted(share, 0.99)]),
        float(told),
        max(float(t.used.max()) for t in timed),
    )


def flips(paths: list[BeadPath], machine: Machine) -> int:
    """Beads that flip, by what the links do: sides of shoulder, elbow and wrist, and jumps, between the points too."""
    return sum(_flips(path, machine) for path in paths)


def _flips(path: BeadPath, machine: Machine) -> bool:
    theta = path.joints[:, :6]
    between = (theta[1:] + theta[:-1]) / 2
    frames = link_frames(machine.arm, np.concatenate([theta, between]))
    wrist, shoulder, elbow = (frames[:, n, :3, 3] for n in (5, 1, 2))
    ahead = frames[:, 1, :3, 0]  # where the arm looks after joint 1
    side = np.sign(np.einsum('ij,ij->i', wrist[:, :2], ahead[:, :2]))
    across = np.cross(elbow - shoulder, wrist - elbow)
    bend = np.sign(np.einsum('ij,ij->i', across, frames[:, 1, :3, 2]))
    fore, hand = frames[:, 4, :3, 1], frames[:, 6, :3, 2]
    roll = np.sign(np.einsum('ij,ij->i', np.cross(fore, hand), frames[:, 4, :3, 2]))
    steady = all(np.ptp(s) == 0 for s in (side, bend, roll))
    return not steady or bool(np.abs(np.diff(theta, axis=0)).max() > JUMP)


def random_bead(rng: np.random.Generator) -> Bead:
    """A short bent bead anywhere on the faceplate with the torch leaning anywhere up to some 80 degrees."""
    start = rng.uniform([-0.3, -0.3, 0], [0.3, 0.3, 0.3])
    points = start + np.cumsum(rng.normal(0, 0.02, (4, 3)), axis=0)
    lean, about = rng.uniform(0, np.radians(80)), rng.uniform(0, 2 * np.pi)
    axis = [np.sin(lean) * np.cos(about), np.sin(lean) * np.sin(about), np.cos(lean)]
    return make_bead(points, np.tile(axis, (4, 1)), step=1e-3)


def random_parts(count: int, seed: int = 1) -> tuple[int, int, list[str]]:
    """(flips, parts planned, refusals) of parts of two beads; limits and place on the part are checked as well."""
    rng, machine = np.random.default_rng(seed), Machine()
    flipped, planned, refused = 0, 0, []
    for _ in range(count):
        beads = [random_bead(rng), random_bead(rng)]
        try:
            paths = plan(beads, machine)
        except PlanError as e:
            refused.append(str(e))
            continue
        planned += 1
        flipped += flips(paths, machine)
        for path in paths:
            theta = path.joints[:, :6]
            off = np.abs(part_pose(path.joints, machine)[:, :3, 3] - path.bead.points).max()
            if off > 1e-9 or (theta < machine.arm.low).any() or (theta > machine.arm.high).any():
                raise SystemExit(f'a joint path off its bead ({off} m) or beyond a limit')
    return flipped, planned, refused


def wide_parts(count: int, turns: int, seed: int = 1) -> tuple[int, int]:
    """(refused, flips) of parts of two level beads anywhere within 0.8 m of the turn axis along x and y, `turns` turns
    of the positioner being tried for a bead."""
    rng, machine = np.random.default_rng(seed), Machine(turns=turns)
    refused, flipped = 0, 0
    for _ in range(count):
        beads = [_level_bead(rng), _level_bead(rng)]
        try:
            flipped += flips(plan(beads, machine), machine)
        except PlanError:
            refused += 1
    return refused, flipped


def _level_bead(rng: np.random.Generator) -> Bead:
    start = rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 0.3])
    steps = np.column_stack([rng.normal(0, 0.02, (4, 2)), np.zeros(4)])
    return make_bead(start + np.cumsum(steps, axis=0), step=1e-3)
