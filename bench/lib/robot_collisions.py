"""Random parts for bench_robot.py, beads and the ways between them planned without contacts, and judged a second way:
points and plain distances.

Nothing of `waam_robot.collision` is used to judge: frames come from Pinocchio by the URDF, bodies are points along
their middle lines 2 mm apart, beads are points 1 mm apart, and a contact is a distance below the sum of two radii.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from waam_robot.arm import AXES, forward
from waam_robot.bead import Bead, make_bead
from waam_robot.bodies import (
    COLUMN,
    FACEPLATE_RADIUS,
    FACEPLATE_THICKNESS,
    NOZZLE_END,
    RADII,
    STEM,
)
from waam_robot.clearance import plan_part
from waam_robot.collision import MARGIN, Scene
from waam_robot.inverse import nearest_turns, solve
from waam_robot.joint_path import BeadPath, Machine, PlanError, plan
from waam_robot.timing import Drives
from waam_robot.urdf_text import write_urdf
from waam_robot.ways import WayError

WIDTH = 6e-3  # m, of beads
LATER = 60e-3  # m behind the torch: what of its own bead counts
PLANTED = 20  # contacts that are put there
LEAST = 0.5e-3  # m that anything moves from place to place on a way, where nothing touches
TORCH_LENGTH = 0.33  # m from the wire tip to anything of the torch, at most
PLATE = 0.7  # m from an axis of the positioner to anything on it, at most
LOOK = 5e-3  # m of bead between the poses that are looked at
SELF = ((1, 3), (1, 4), (1, 6), (2, 6), (3, 6))  # links that are not joined to each other


def random_part(rng: np.random.Generator) -> list[Bead]:
    """Three level beads: the second beside or upon the first, the third near them and leaning elsewhere."""
    start = rng.uniform([-0.22, -0.22, 0.0], [0.22, 0.22, 0.15])
    first, axis = _walk(rng, start, 60)
    turn = rng.uniform(-0.01, 0.01, 3)
    second = make_bead(first + axis * 2e-3 + turn, np.tile(axis, (len(first), 1)), step=1e-3)
    near = start + rng.normal(0, 0.05, 3) * [1, 1, 0.5]
    third, other = _walk(rng, np.maximum(near, [-1, -1, 0.0]), 75)
    return [
        make_bead(first, np.tile(axis, (len(first), 1)), step=1e-3),
        second,
        make_bead(third, np.tile(other, (len(third), 1)), step=1e-3),
    ]


def _walk(
    rng: np.random.Generator, start: np.ndarray, lean: float
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (5, 3) across a torch axis (3,) that leans anywhere up to `lean` degrees."""
    angle, about = np.radians(rng.uniform(0, lean)), rng.uniform(0, 2 * np.pi)
    axis = np.array([np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about), np.cos(angle)])
    steps = rng.normal(0, 0.02, (4, 3))
    steps -= np.outer(steps @ axis, axis)
    return start + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]), axis


@dataclass
class Found:
    """planned, refused: parts; contacts: those refused for a contact; confirmed: those of them that the second method
    finds too near as well when they are planned without a look at contacts; touching: planned ones in which it finds a
    contact; nearest: m, its least distance of all in beads; no_way: parts without a way between two beads; ways:
    between the beads of planned parts; apart: m, the least distance on them; planted, caught: ways with a contact that
    was put there, and those of them in which the second method finds it; points: of the planned paths; seconds: of
    planning them and the ways."""

    planned: int = 0
    refused: int = 0
    contacts: int = 0
    confirmed: int = 0
    touching: list[str] = field(default_factory=list)
    points: int = 0
    seconds: float = 0.0
    nearest: float = np.inf
    no_way: list[str] = field(default_factory=list)
    ways: int = 0
    apart: float = np.inf
    planted: int = 0
    caught: int = 0


def run(count: int, seed: int) -> Found:
    """Random parts, planned and looked at again."""
    machine, rng, out = Machine(), np.random.default_rng(seed), Found()
    judge = Judge(machine)
    for n in range(count):
        part = random_part(rng)
        begin = time.process_time()
        try:
            paths, ways = plan_part(part, Scene(machine), WIDTH)
        except WayError as e:
            out.refused += 1
            out.no_way.append(f'part {n}: {e}')
            continue
        except PlanError as e:
            out.refused += 1
            if ' mm of ' in str(e):
                out.contacts += 1
                out.confirmed += judge.least(plan(part, machine))[0] < MARGIN
            continue
        out.seconds += time.process_time() - begin
        out.points += sum(len(p.joints) for p in paths)
        out.planned += 1
        spare, what = judge.least(paths)
        out.nearest = min(out.nearest, spare)
        between, which = judge.least_between(paths, ways)
        out.ways += len(ways)
        out.apart = min(out.apart, between)
        wrong = pushed(paths, ways, machine) if out.planted < PLANTED else None
        if wrong is not None:
            out.planted += 1
            out.caught += judge.least_between(paths, wrong)[0] < 0
        if min(spare, between) < 0:
            worst = what if spare < between else which
            out.touching.append(f'part {n}: {worst}, {min(spare, between) * 1e3:.1f} mm')
    return out


def pushed(
    paths: list[BeadPath], ways: list[np.ndarray], machine: Machine
) -> list[np.ndarray] | None:
    """The ways with the torch pushed 30 mm into the bead at the start of the first one; None where the arm does not
    get there."""
    arm, here = machine.arm, paths[0].joints[-1]
    pose = forward(arm, here[None, :AXES])
    pose[:, :3, 3] += 30e-3 * pose[:, :3, 2]
    theta = nearest_turns(arm, solve(arm, pose).theta[0, paths[0].branch], here[:AXES])
    if np.isnan(theta).any():
        return None
    there = np.concatenate([theta, here[AXES:]])
    return [np.concatenate([[here, there], ways[0]]), *ways[1:]]


class Judge:
    """Distances in a machine, by Pinocchio and points."""

    def __init__(self, machine: Machine) -> None:
        import pinocchio as pin

        self._pin, self.machine = pin, machine
        self._model = pin.buildModelFromXML(write_urdf(machine, Drives().speed))
        self._data = self._model.createData()
        self._frames = {f.name: n for n, f in enumerate(self._model.frames)}
        names = ['joint1', 'joint2', 'joint3', 'joint4', 'joint5', 'joint6', 'tilt', 'turn']
        self._order = [self._model.joints[self._model.getJointId(n)].idx_q for n in names]
        self._lines = self._drawn()
        # m per rad, at most, of what a joint moves; arm and part move against each other by no more than the sum
        lengths = [abs(k.a) + abs(k.d) for k in machine.arm.links]
        tool = float(np.linalg.norm(machine.arm.tool[:3, 3])) + TORCH_LENGTH
        self._levers = np.array([sum(lengths[n:]) + tool for n in range(AXES)] + [PLATE, PLATE])

    def _drawn(self) -> list[tuple[str, int, str, np.ndarray, float]]:
        """(name, link, frame of the URDF, points (n, 3), radius) of everything that moves with the arm."""
        out = []
        for n, link in enumerate(self.machine.arm.links, 1):
            corner = np.array([0, 0, link.d])
            for a, b in ((np.zeros(3), corner), (corner, corner + [link.a, 0, 0])):
                if np.linalg.norm(b - a) > 0:
                    out.append((f'link {n}', n, f'link{n}', _dense(a, b), RADII[n - 1]))
        nozzle = _dense(np.array([0, 0, -NOZZLE_END - 0.01]), np.array([0, 0, -0.12]))
        bracket = _dense(np.array([0, 0, -0.12]), np.array([-0.29, 0, -0.09]))
        out.append(('nozzle', AXES, 'torch', nozzle, 0.010))
        out.append(('bracket', AXES, 'torch', bracket, 0.022))
        return out

    def least(self, paths: list[BeadPath]) -> tuple[float, str]:
        """The smallest distance (m, below 0: they touch) in a part, and of what."""
        best, what = np.inf, ''
        laid = [np.zeros((0, 3))]
        for number, path in enumerate(paths):
            every = max(1, int(LOOK / path.bead.way[1]))
            for n in range(0, len(path.joints), every):
                done = path.bead.points[path.bead.way < path.bead.way[n] - LATER]
                tree = cKDTree(np.concatenate([*laid, done])) if number or len(done) else None
                spare, text = self._at(path.joints[n], tree)
                if spare < best:
                    best, what = spare, f'bead {number}, {path.bead.way[n] * 1e3:.0f} mm: {text}'
            laid.append(path.bead.points)
        return best, what

    def least_between(self, paths: list[BeadPath], ways: list[np.ndarray]) -> tuple[float, str]:
        """The smallest distance (m) on the ways (N, 8) rad between the beads, and of what.

        From a place with the distance d one goes on by joints that move nothing farther than d, so nothing is missed
        between the places. A way that does not lead from bead to bead is a contact.
        """
        best, what = np.inf, ''
        for number, way in enumerate(ways):
            ends = paths[number].joints[-1], paths[number + 1].joints[0]
            if max(np.abs(way[0] - ends[0]).max(), np.abs(way[-1] - ends[1]).max()) > 1e-9:
                return -np.inf, f'way {number} does not lead from bead to bead'
            tree = cKDTree(np.concatenate([path.bead.points for path in paths[: number + 1]]))
            for n, (a, b) in enumerate(zip(way, way[1:], strict=False)):
                span, gone = float(np.abs(b - a) @ self._levers), 0.0
                while gone <= span:
                    spare, text = self._at(a + (b - a) * (gone / max(span, 1e-12)), tree)
                    if spare < best:
                        best, what = spare, f'way {number}, leg {n}: {text}'
                    if spare < 0:
                        return best, what
                    left = span - gone
                    gone += min(max(spare, LEAST), left) if left > 0 else np.inf
        return best, what

    def _at(self, joints: np.ndarray, tree: cKDTree | None) -> tuple[float, str]:
        q = np.zeros(self._model.nq)
        q[self._order] = joints
        self._pin.framesForwardKinematics(self._model, self._data, q)
        places = [(name, link, self._put(frame, p), r) for name, link, frame, p, r in self._lines]
        moving = [(name, p, r) for name, link, p, r in places if link > 1]
        best, what = min((self._plate(p) - r, f'{n} and positioner') for n, p, r in moving)
        for i, a in enumerate(places):
            for b in places[i + 1 :]:
                pair = (min(a[1], b[1]), max(a[1], b[1]))
                torch = pair == (4, AXES) and b[0] in ('nozzle', 'bracket')
                if (pair in SELF or torch) and _at_least(a[2], b[2]) - a[3] - b[3] < best:
                    apart = float(cKDTree(a[2]).query(b[2])[0].min()) - a[3] - b[3]
                    best, what = min((best, what), (apart, f'{a[0]} and {b[0]}'))
        if tree is not None:
            part = self._data.oMf[self._frames['part']]
            for n, p, r in moving:
                thick, own = r + WIDTH / 2, self._seen(part, p)
                outside = np.maximum(np.maximum(tree.mins - own, own - tree.maxes), 0.0)
                near = np.linalg.norm(outside, axis=1) < best + thick
                if near.any():
                    apart = float(tree.query(own[near])[0].min()) - thick
                    best, what = min((best, what), (apart, f'{n} and part'))
        return best, what

    def _put(self, frame: str, points: np.ndarray) -> np.ndarray:
        place = self._data.oMf[self._frames[frame]]
        return points @ place.rotation.T + place.translation

    def _seen(self, place, points: np.ndarray) -> np.ndarray:
        return (points - place.translation) @ place.rotation

    def _plate(self, points: np.ndarray) -> float:
        """m: least distance of points from faceplate, stem and column."""
        own = self._seen(self._data.oMf[self._frames['part']], points)
        under = self.machine.positioner.d_c
        disc = _outside(own, FACEPLATE_RADIUS, -FACEPLATE_THICKNESS, 0.0)
        stem = _outside(own, STEM, -under, -FACEPLATE_THICKNESS)
        p = self.machine.positioner
        column = _outside(points - [p.a_b, -p.d_bb, 0.0], COLUMN, -1.0, p.d_b)
        return float(min(disc.min(), stem.min(), column.min()))


def _at_least(a: np.ndarray, b: np.ndarray) -> float:
    """m: points (n, 3) and (m, 3) of two lines are no nearer than this, by the balls around them."""
    balls = [((p[0] + p[-1]) / 2, np.linalg.norm(p[-1] - p[0]) / 2) for p in (a, b)]
    return float(np.linalg.norm(balls[0][0] - balls[1][0]) - balls[0][1] - balls[1][1])


def _dense(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    count = max(2, int(np.linalg.norm(b - a) / 2e-3) + 1)
    return a + np.linspace(0, 1, count)[:, None] * (b - a)


def _outside(points: np.ndarray, radius: float, low: float, high: float) -> np.ndarray:
    """(n,) m: distance of points from an upright cylinder, below 0 inside."""
    aside = np.hypot(points[:, 0], points[:, 1]) - radius
    above = np.maximum(points[:, 2] - high, low - points[:, 2])
    outer = np.hypot(np.maximum(aside, 0), np.maximum(above, 0))
    return np.where((aside < 0) & (above < 0), np.maximum(aside, above), outer)
