"""Random parts for bench_robot.py, planned without contacts, and judged a second way: points and plain distances.

Nothing of `waam_robot.collision` is used to judge: frames come from Pinocchio by the URDF, bodies are points along
their middle lines 2 mm apart, beads are points 1 mm apart, and a contact is a distance below the sum of two radii.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from waam_robot.arm import AXES
from waam_robot.bead import Bead, make_bead
from waam_robot.bodies import (
    COLUMN,
    FACEPLATE_RADIUS,
    FACEPLATE_THICKNESS,
    NOZZLE_END,
    RADII,
    STEM,
)
from waam_robot.clearance import plan_clear
from waam_robot.collision import MARGIN, Scene
from waam_robot.joint_path import BeadPath, Machine, PlanError, plan
from waam_robot.timing import Drives
from waam_robot.urdf_text import write_urdf

WIDTH = 6e-3  # m, of beads
LATER = 60e-3  # m behind the torch: what of its own bead counts
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
    contact; nearest: m, its least distance of all; points: of the planned paths; seconds: of planning them."""

    planned: int = 0
    refused: int = 0
    contacts: int = 0
    confirmed: int = 0
    touching: list[str] = field(default_factory=list)
    points: int = 0
    seconds: float = 0.0
    nearest: float = np.inf


def run(count: int, seed: int) -> Found:
    """Random parts, planned and looked at again."""
    machine, rng, out = Machine(), np.random.default_rng(seed), Found()
    judge = Judge(machine)
    for n in range(count):
        part = random_part(rng)
        begin = time.process_time()
        try:
            paths = plan_clear(part, Scene(machine), WIDTH)
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
        if spare < 0:
            out.touching.append(f'part {n}: {what}, {spare * 1e3:.1f} mm')
    return out


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

    def _at(self, joints: np.ndarray, tree: cKDTree | None) -> tuple[float, str]:
        q = np.zeros(self._model.nq)
        q[self._order] = joints
        self._pin.framesForwardKinematics(self._model, self._data, q)
        places = [(name, link, self._put(frame, p), r) for name, link, frame, p, r in self._lines]
        found = [(self._plate(p) - r, f'{n} and positioner') for n, k, p, r in places if k > 1]
        if tree is not None:
            part = self._data.oMf[self._frames['part']]
            found += [
                (float(tree.query(self._seen(part, p))[0].min()) - r - WIDTH / 2, f'{n} and part')
                for n, k, p, r in places
                if k > 1
            ]
        for i, a in enumerate(places):
            for b in places[i + 1 :]:
                pair = (min(a[1], b[1]), max(a[1], b[1]))
                torch = pair == (4, AXES) and b[0] in ('nozzle', 'bracket')
                if pair in SELF or torch:
                    apart = float(cKDTree(a[2]).query(b[2])[0].min()) - a[3] - b[3]
                    found.append((apart, f'{a[0]} and {b[0]}'))
        return min(found)

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


def _dense(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    count = max(2, int(np.linalg.norm(b - a) / 2e-3) + 1)
    return a + np.linspace(0, 1, count)[:, None] * (b - a)


def _outside(points: np.ndarray, radius: float, low: float, high: float) -> np.ndarray:
    """(n,) m: distance of points from an upright cylinder, below 0 inside."""
    aside = np.hypot(points[:, 0], points[:, 1]) - radius
    above = np.maximum(points[:, 2] - high, low - points[:, 2])
    outer = np.hypot(np.maximum(aside, 0), np.maximum(above, 0))
    return np.where((aside < 0) & (above < 0), np.maximum(aside, above), outer)
