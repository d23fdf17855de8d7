"""Ways between the beads of a part, arc off, without contacts: back along the torch, across, on to the next bead (needs
coal).

Across is the straight line in the joints, or one over postures in which the arm is drawn back from the positioner,
whichever is the quickest without a contact.
"""

from __future__ import annotations

import numpy as np

from .arm import AXES, forward, in_limits
from .collision import Contact, Scene
from .inverse import nearest_turns, solve
from .joint_path import BeadPath, Machine, PlanError
from .timing import Drives

LIFTS = (20e-3, 60e-3, 120e-3)  # m, back along the torch
STEP = 5e-3  # m between the places on the way back
JUMP = 0.3  # rad of a joint between them: more is a flip
AWAY = (0.5, 0.7)  # m of torch and wrist from the positioner, arm drawn back
GRID = 25  # angles of joints 2 and 3 that are tried for it


class WayError(PlanError):
    """No way without a contact was found; the text says what is too near on the first that was tried."""


def way_between(before: BeadPath, after: BeadPath, scene: Scene, pieces: int) -> np.ndarray:
    """(N, 8) rad, straight in the joints between its places, from the end of one bead to the start of the next. pieces:
    as many of those laid in the scene as stand there. WayError where none was found."""
    a, b = before.joints[-1], after.joints[0]
    first: Contact | None = None
    for lift in LIFTS:
        back = _back(a, before.branch, lift, scene.machine)
        on = _back(b, after.branch, lift, scene.machine)[::-1]
        ends = scene.first(back, pieces) or scene.first(on, pieces)
        if ends is not None:
            first = first or ends
            continue
        for middle in _across(back[-1], on[0], scene.machine):
            contact = scene.first(middle, pieces)
            if contact is None:
                return np.concatenate([back, middle[1:-1], on])
            first = first or contact
    raise WayError(first.text if first is not None else 'nothing was tried')


def _back(joints: np.ndarray, branch: int, lift: float, machine: Machine) -> np.ndarray:
    """(n, 8): from joints (8,) back along the torch, as far as the arm gets, at most `lift` (m)."""
    marks = np.linspace(0, lift, int(np.ceil(lift / STEP)) + 1)
    here = forward(machine.arm, joints[None, :AXES])[0]
    poses = np.tile(here, (len(marks), 1, 1))
    poses[:, :3, 3] -= marks[:, None] * here[:3, 2]
    found = solve(machine.arm, poses).theta[:, branch]
    theta = np.unwrap(found, axis=0)
    theta = theta + nearest_turns(machine.arm, theta[:1], joints[:AXES]) - theta[:1]
    bad = ~in_limits(machine.arm, theta) | np.isnan(theta).any(axis=1)
    bad[1:] |= np.abs(np.diff(np.nan_to_num(theta), axis=0)).max(axis=1) > JUMP
    count = int(np.argmax(bad)) if bad.any() else len(marks)
    theta = np.concatenate([joints[None, :AXES], theta[1 : max(count, 1)]])
    return np.column_stack([theta, np.tile(joints[AXES:], (len(theta), 1))])


def _across(a: np.ndarray, b: np.ndarray, machine: Machine) -> list[np.ndarray]:
    """Ways (n, 8) that are tried from a to b, the quickest first."""
    out = [np.array([a, b])]
    for away in AWAY:
        u, v = _drawn_back(a, away, machine), _drawn_back(b, away, machine)
        if u is None or v is None:
            continue
        turned = np.concatenate([u[:AXES], v[AXES:]])
        out += [np.array([a, u, v, b]), np.array([a, u, turned, v, b])]
    speed = Drives().speed
    return sorted(
        out, key=lambda way: float((np.abs(np.diff(way, axis=0)) / speed).max(axis=1).sum())
    )


def _drawn_back(joints: np.ndarray, away: float, machine: Machine) -> np.ndarray | None:
    """Joints (8,) with joints 2 and 3 changed as little as brings torch and wrist `away` (m) from the middle of the
    positioner; None where nothing does."""
    arm = machine.arm
    tried = [np.linspace(arm.low[n], arm.high[n], GRID) for n in (1, 2)]
    two, three = (grid.ravel() for grid in np.meshgrid(*tried))
    theta = np.tile(joints[:AXES], (len(two), 1))
    theta[:, 1], theta[:, 2] = two, three
    theta = theta[in_limits(arm, theta)]
    tool = forward(arm, theta)
    middle = machine.positioner.faceplate(0.0)[:3, 3] - [0.0, 0.0, machine.positioner.d_c]
    flange = tool[:, :3, 3] - 0.3 * tool[:, :3, 2]
    apart = np.minimum(*(np.linalg.norm(p - middle, axis=1) for p in (tool[:, :3, 3], flange)))
    good = theta[(apart > away) & (tool[:, 2, 3] > middle[2])]
    if not len(good):
        return None
    moved = np.abs(good[:, 1:3] - joints[1:3]).max(axis=1)
    return np.concatenate([good[int(moved.argmin())], joints[AXES:]])
