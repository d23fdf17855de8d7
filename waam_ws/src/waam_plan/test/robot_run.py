"""Runs a program that was read back on the arm and positioner of waam_robot, and measures its path at the part.

What a controller does, from the programmed moves to the joints: lines and arcs in the frame of the part, the torch
turning evenly, corners rounded off by a parabola inside their zones, external axes moving along evenly; at every point
the inverse kinematics in one branch of the arm; the joints even between the points. The tip is where forward kinematics
of arm and positioner put it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from robot_line import Motion
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, Slerp

from waam_plan.plan import Plan
from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import Course, RobotProgramError, course
from waam_process.segment import Kind, Point
from waam_robot.arm import M20IB25, Arm, forward, limit_text
from waam_robot.frames import pose_from_wpr
from waam_robot.inverse import BRANCHES, Solutions, solve, unreachable_text

STEP = 0.2e-3  # m between the points that the controller computes, with the arc on
IDLE_STEP = 5e-3  # m, with the arc off
TURN_STEP = math.radians(3)  # of the positioner between them
BLEND = 16  # points in a rounded corner
NEAR = 6  # pieces of a path that are looked at: it may touch itself
JUMP = 0.35  # rad of a joint between two points of a bead: more is a flip


@dataclass(frozen=True)
class Path:
    """What the controller computes: tool poses (N, 4, 4) in the work frame, B and C (N, 2), arc (N,): whether it burns
    on the way to the point."""

    poses: np.ndarray
    external: np.ndarray
    arc: np.ndarray


@dataclass(frozen=True)
class Run:
    """joints: (N, 8) six DH angles, B, C, rad; tips: (M, 3) of the wire on the part, m, halfway between the points too;
    torch: (M, 3) unit vectors from the part into it; arc: (M,) bool; branch: of the arm."""

    joints: np.ndarray
    tips: np.ndarray
    torch: np.ndarray
    arc: np.ndarray
    branch: int


def path_of(motions: list[Motion], cell: RobotCell) -> Path:
    """The controller's points. RobotProgramError for a program without motions."""
    if len(motions) < 2:
        raise RobotProgramError('the program has fewer than two motions')
    if len({len(m.external) for m in motions}) > 1:
        raise RobotProgramError('some positions have external axes and others have none')
    ways = [course(a.end, b) for a, b in zip(motions, motions[1:], strict=False)]
    blends = [0.0, *(_blend(ways, motions, i) for i in range(len(ways)))]
    pieces = []
    for i, way in enumerate(ways):
        before, move = motions[i], motions[i + 1]
        pieces.append(_even(way, before, move, blends[i], blends[i + 1]))
        if blends[i + 1] > 0:
            pieces.append(_round(way, ways[i + 1], before, move, motions[i + 2], blends[i + 1]))
    places, turns, external, arc = (np.concatenate(part) for part in zip(*pieces, strict=True))
    poses = np.broadcast_to(np.eye(4), (len(places), 4, 4)).copy()
    poses[:, :3, :3], poses[:, :3, 3] = turns, places
    if not external.shape[1]:
        external = np.tile([0.0, -math.radians(cell.turn_zero_deg)], (len(places), 1))
    return Path(poses, external, arc)


def _blend(ways: list[Course], motions: list[Motion], i: int) -> float:
    """m, at the end of way i: half of a move is the most."""
    if i + 1 >= len(ways):
        return 0.0
    return min(motions[i + 1].zone, ways[i].length / 2, ways[i + 1].length / 2)


_Piece = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _even(way: Course, before: Motion, move: Motion, skip: float, leave: float) -> _Piece:
    """A move between its blends."""
    step = STEP if move.arc else IDLE_STEP
    turn = max(map(abs, np.subtract(move.external, before.external)), default=0.0)
    n = max(1, math.ceil((way.length - skip - leave) / step), math.ceil(turn / TURN_STEP))
    at = np.linspace(skip, way.length - leave, n + 1)
    share = at / way.length if way.length > 0 else np.linspace(0, 1, n + 1)
    return _piece(way.at(at), share, before, move)


def _piece(places: np.ndarray, share: np.ndarray, before: Motion, move: Motion) -> _Piece:
    ends = pose_from_wpr(np.zeros((2, 3)), np.array([before.wpr, move.wpr]))[:, :3, :3]
    turns = Slerp([0.0, 1.0], Rotation.from_matrix(ends))(np.clip(share, 0, 1)).as_matrix()
    a, b = np.array(before.external), np.array(move.external)
    outer = a + share[:, None] * (b - a) if len(a) else np.zeros((len(share), 0))
    return places, turns, outer, np.full(len(places), move.arc)


def _round(
    here: Course, there: Course, before: Motion, move: Motion, after: Motion, zone: float
) -> _Piece:
    """A corner: a parabola from `zone` before it to `zone` after it."""
    t = np.linspace(0, 1, BLEND + 1)[1:-1]
    first, last = here.at(np.array([here.length - zone]))[0], there.at(np.array([zone]))[0]
    weights = ((1 - t) ** 2, 2 * t * (1 - t), t**2)
    places = sum(w[:, None] * p for w, p in zip(weights, (first, here.end, last), strict=True))
    one = _piece(
        here.at(np.array([here.length - zone])), np.array([1 - zone / here.length]), before, move
    )
    two = _piece(there.at(np.array([zone])), np.array([zone / there.length]), move, after)
    turns = Slerp([0.0, 1.0], Rotation.from_matrix(np.concatenate([one[1], two[1]])))(t).as_matrix()
    outer = one[2] + t[:, None] * (two[2] - one[2])
    return np.asarray(places), turns, outer, np.full(len(t), move.arc)


def run(path: Path, cell: RobotCell, arm: Arm = M20IB25) -> Run:
    """The path on the robot. RobotProgramError that names the first place that no branch of the arm reaches."""
    device = cell.device
    shifted = path.poses.copy()
    shifted[:, :3, 3] += cell.origin
    held = device.to_robot(shifted, path.external[:, 0], path.external[:, 1])
    found = solve(arm, held)
    branch, theta = _branch(found, path, arm)
    joints = np.column_stack([theta, path.external])
    between = (joints[1:] + joints[:-1]) / 2
    every = np.empty((2 * len(joints) - 1, 8))
    every[::2], every[1::2] = joints, between
    tool = device.to_part(forward(arm, every[:, :6]), every[:, 6], every[:, 7])
    tips = tool[:, :3, 3] - np.array(cell.origin)
    arc = np.repeat(path.arc, 2)[1:]
    return Run(joints, tips, -tool[:, :3, 2], arc, branch)


def _branch(found: Solutions, path: Path, arm: Arm) -> tuple[int, np.ndarray]:
    """The branch that serves the whole path, with its angles (N, 6) inside the limits."""
    best, told = -1, ''
    for branch in range(BRANCHES):
        theta = np.unwrap(found.theta[:, branch], axis=0)
        lost = np.asarray(np.isnan(theta).any(axis=1))
        step = np.abs(np.diff(np.nan_to_num(theta), axis=0)).max(axis=1)
        flips = np.concatenate([[False], (step > JUMP) & path.arc[1:]])
        middle = (np.array(arm.low) + np.array(arm.high)) / 2
        usable = theta[~lost]
        if len(usable):
            theta = theta + 2 * np.pi * np.round((middle - usable.mean(axis=0)) / (2 * np.pi))
        bent = (theta[:, 1] + theta[:, 2])[:, None]
        reached = np.column_stack([theta, bent])
        low, high = np.array([*arm.low, arm.forearm[0]]), np.array([*arm.high, arm.forearm[1]])
        beyond = np.asarray(((reached < low) | (reached > high)).any(axis=1))
        bad = np.logical_or.reduce([lost, flips, beyond & ~lost])
        if not bad.any():
            return branch, theta
        at = int(np.argmax(bad))
        if at > best:
            best = at
            why = limit_text(arm, theta[at]) if beyond[at] else 'a joint would flip'
            told = unreachable_text(arm, found, at) if lost[at] else why
    x, y, z = path.poses[best, :3, 3] * 1e3
    raise RobotProgramError(
        f'the {arm.name} does not get beyond ({x:.1f}, {y:.1f}, {z:.1f}) mm of the program: {told}'
    )


@dataclass(frozen=True)
class Check:
    """path: m, how far the path with the arc on, as the robot goes it, and that of the plan are apart at most; lean:
    rad, the largest angle between the torch there and the plan's."""

    path: float
    lean: float


def check(plan: Plan, motions: list[Motion], cell: RobotCell, arm: Arm = M20IB25) -> Check:
    """RobotProgramError where the robot cannot go the program, or where the arc burns another number of times."""
    done = run(path_of(motions, cell), cell, arm)
    return Check(deviation(plan, done), _lean(plan, done))


def _lean(plan: Plan, done: Run) -> float:
    """Of the torch with the arc on to the nearest direction that the plan has."""
    wanted = np.array(sorted({s.tool_axis for layer in plan.layers for s in layer.deposits}))
    torch = done.torch[done.arc]
    off = [np.linalg.norm(np.cross(torch, axis), axis=1) for axis in wanted]
    turned = [torch @ axis < 0 for axis in wanted]
    angles = [
        np.where(t, np.pi, np.arcsin(np.clip(o, 0, 1))) for o, t in zip(off, turned, strict=True)
    ]
    return float(np.min(angles, axis=0).max(initial=0.0)) if len(torch) else 0.0


def deviation(plan: Plan, done: Run) -> float:
    """m: the largest distance of the one path from the other, bead by bead, both ways."""
    planned = _planned(plan)
    laid = _laid(done)
    if len(planned) != len(laid):
        raise RobotProgramError(
            f'the program lights the arc {len(laid)} times, the plan {len(planned)} times'
        )
    pairs = zip(planned, laid, strict=True)
    return max((max(_away(a, b), _away(b, a)) for a, b in pairs), default=0.0)


def _planned(plan: Plan) -> list[np.ndarray]:
    out = []
    for layer in plan.layers:
        for arc, group in groupby(layer.segments, key=lambda s: s.arc):
            pieces = [s for s in group if s.kind == Kind.DEPOSIT]
            if arc and pieces:
                corners: list[Point] = [pieces[0].start, *(s.end for s in pieces)]
                out.append(np.array(corners))
    return out


def _laid(done: Run) -> list[np.ndarray]:
    marks = np.flatnonzero(np.diff(np.concatenate([[False], done.arc, [False]]).astype(int)))
    return [done.tips[max(a - 1, 0) : b] for a, b in marks.reshape(-1, 2)]


def _away(points: np.ndarray, line: np.ndarray) -> float:
    """Largest distance of points (N, 3) from a polyline (M, 3)."""
    pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
    count = np.maximum(np.ceil(pieces / 0.25e-3).astype(int), 1)
    index = np.repeat(np.arange(len(pieces)), count)
    share = np.concatenate([(np.arange(n) + 0.5) / n for n in count])[:, None]
    marks = line[index] * (1 - share) + line[index + 1] * share
    _, found = cKDTree(marks).query(points, k=NEAR)
    best = np.full(len(points), np.inf)
    for column in found.T:
        k = index[np.minimum(column, len(index) - 1)]
        a, along = line[k], line[k + 1] - line[k]
        square = np.maximum(np.einsum('ij,ij->i', along, along), 1e-30)
        t = np.clip(np.einsum('ij,ij->i', points - a, along) / square, 0, 1)
        best = np.minimum(best, np.linalg.norm(a + t[:, None] * along - points, axis=1))
    return float(best.max())
