"""What was measured for a calibration of a robot: poses, and the profiles of a scanner. Reads the text of a file. Pure.

The first line names the columns. `j1 ... j6`: joint angles in degrees; or `x y z w p r`: the flange in the base frame,
mm and degrees (W P R, Rz(r) Ry(p) Rx(w)). For profiles also `pose`, a number for each pose, and `x_s z_s`, a point of
the profile in the frame of the scanner, mm: one line for each point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_robot.arm import M20IB25
from waam_robot.frames import pose_from_wpr
from waam_robot.joints import DH, Counting
from waam_robot.uncertain import Flange, Stated, UncertainArm, UncertainPoses

from .evidence import EvidenceError

JOINTS = ('j1', 'j2', 'j3', 'j4', 'j5', 'j6')
POSE = ('x', 'y', 'z', 'w', 'p', 'r')
POINT = ('pose', 'x_s', 'z_s')
MAX_ROWS = 200_000


@dataclass(frozen=True)
class Poses:
    """flange: n poses with their unknown errors; nominal: (n, 4, 4) without; numbers: (n,) as the file has them."""

    flange: Flange
    nominal: np.ndarray
    numbers: tuple[int, ...]


@dataclass(frozen=True)
class Profiled:
    """A reference seen from several poses. points: (m, 3) m in the frame of the scanner, y = 0; of: (m,) index of the
    pose."""

    poses: Poses
    points: np.ndarray
    of: np.ndarray


@dataclass(frozen=True)
class Robot:
    """How joints are counted, how exact the robot is said to be; position, angle: of poses where joints are not known,
    m and rad."""

    counting: Counting = DH
    stated: Stated = Stated()
    position: float = 2e-4
    angle: float = float(np.radians(0.02))


def touches(text: str, robot: Robot) -> Poses:
    """Poses in which the wire tip touched the same point. EvidenceError names line and column."""
    columns, rows = _table(text, ())
    return _poses(columns, rows, tuple(range(1, len(rows) + 1)), robot)


def profiles(text: str, robot: Robot) -> Profiled:
    """Points of profiles with the pose of each. EvidenceError names line and column."""
    columns, rows = _table(text, POINT)
    number = rows[:, columns.index('pose')]
    if (number != np.round(number)).any():
        raise EvidenceError('column pose: wanted whole numbers')
    found, first, of = np.unique(number, return_index=True, return_inverse=True)
    own = [columns.index(n) for n in columns if n not in POINT]
    apart = np.abs(rows[:, own] - rows[first][of][:, own]).max(axis=1)
    if apart.max(initial=0.0) > 1e-6:
        n = int(np.argmax(apart > 1e-6))
        raise EvidenceError(f'pose {number[n]:.0f} has more than one place: give each its number')
    points = np.zeros((len(rows), 3))
    points[:, 0] = rows[:, columns.index('x_s')] * 1e-3
    points[:, 2] = rows[:, columns.index('z_s')] * 1e-3
    poses = _poses(columns, rows[first], tuple(int(v) for v in found), robot)
    return Profiled(poses, points, np.asarray(of).ravel())


def _table(text: str, also: tuple[str, ...]) -> tuple[list[str], np.ndarray]:
    """Names of the columns and the numbers (n, columns)."""
    lines = [
        (n, s) for n, s in enumerate(text.splitlines(), 1) if s.strip() and s.strip()[0] != '#'
    ]
    if not lines:
        raise EvidenceError('the file is empty')
    columns = [c.lower() for c in _words(lines[0][1])]
    kinds = [(*names, *also) for names in (JOINTS, POSE)]
    if sorted(columns) not in [sorted(k) for k in kinds]:
        known = ' or '.join(f'"{", ".join(k)}"' for k in kinds)
        raise EvidenceError(f'line {lines[0][0]}: the columns must be {known}')
    if len(lines) - 1 > MAX_ROWS:
        raise EvidenceError(f'{len(lines) - 1} lines, at most {MAX_ROWS}: thin the profiles out')
    rows = np.zeros((len(lines) - 1, len(columns)))
    for i, (n, line) in enumerate(lines[1:]):
        words = _words(line)
        if len(words) != len(columns):
            raise EvidenceError(f'line {n}: {len(words)} values for {len(columns)} columns')
        for j, word in enumerate(words):
            rows[i, j] = _number(word, f'line {n}, column {columns[j]}')
    return columns, rows


def _words(line: str) -> list[str]:
    return line.replace(',', ' ').replace(';', ' ').split()


def _number(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise EvidenceError(f'{where}: {word[:20]!r} is no number') from None
    if not np.isfinite(value) or abs(value) > 1e6:
        raise EvidenceError(f'{where}: {word[:20]!r} cannot be')
    return value


def _poses(columns: list[str], rows: np.ndarray, numbers: tuple[int, ...], robot: Robot) -> Poses:
    if JOINTS[0] in columns:
        angles = np.radians(rows[:, [columns.index(n) for n in JOINTS]])
        flange: Flange = UncertainArm(M20IB25, robot.counting.to_dh(angles), robot.stated)
    else:
        at = rows[:, [columns.index(n) for n in POSE]]
        poses = pose_from_wpr(at[:, :3] * 1e-3, np.radians(at[:, 3:]))
        flange = UncertainPoses(poses, robot.position, robot.angle)
    return Poses(flange, flange.poses(np.zeros(len(flange.sigma))), numbers)
