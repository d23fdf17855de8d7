"""The text files of the source's program (section 3.3): one point per line, numbers between semicolons, rad and mm.

forward: an angle per joint, six of an arm -> twelve numbers: the rows of the rotation matrix, then the position.
inverse: six angles of the state before, then those twelve -> six angles. The text calls the nine numbers the
directions of the axes, its table 3.4 prints rows; its example of an inverse line has 22 numbers and is refused
(docs/equations.md).
"""

from __future__ import annotations

import numpy as np

from .arm import AXES
from .frames import check_poses

MM = 1e-3
POSE = 12
MOST_LINES = 1_000_000


class PointsError(ValueError):
    """What is wrong, with its line."""


def read_numbers(text: str, wanted: int, what: str) -> np.ndarray:
    """(N, wanted). PointsError with the line for anything but so many finite numbers; empty lines and those that
    begin with # are passed over."""
    rows = []
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        raise PointsError(f'{len(lines)} lines; at most {MOST_LINES}')
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip()[0] == '#':
            continue
        cells = [c.strip() for c in line.rstrip().rstrip('.;').split(';')]
        if len(cells) != wanted:
            raise PointsError(f'line {number}: {len(cells)} numbers between ";", wanted {what}')
        try:
            row = [float(c) for c in cells]
        except ValueError:
            text = line.strip()[:40]
            raise PointsError(f'line {number}: "{text}" holds no number, wanted {what}') from None
        if not np.isfinite(row).all():
            raise PointsError(f'line {number}: a number that is not finite')
        rows.append(row)
    if not rows:
        raise PointsError('no line with numbers')
    return np.array(rows)


def read_angles(text: str, joints: int = AXES) -> np.ndarray:
    """(N, joints) rad: input of the forward problem."""
    told = 'six angles' if joints == AXES else f'{joints} angles'
    return read_numbers(text, joints, f'{told} in rad, one per joint')


def read_inverse(text: str) -> tuple[np.ndarray, np.ndarray]:
    """(N, 6) angles of the state before, rad, and poses (N, 4, 4), m: input of the inverse problem."""
    numbers = read_numbers(
        text, AXES + POSE, 'six angles (rad), nine of the rotation matrix by rows, three mm'
    )
    poses = np.zeros((len(numbers), 4, 4))
    poses[:, :3, :3] = numbers[:, 6:15].reshape(-1, 3, 3)
    poses[:, :3, 3] = numbers[:, 15:] * MM
    poses[:, 3, 3] = 1.0
    try:
        return numbers[:, :6], squared(check_poses(poses, 'point', tolerance=2e-4))
    except ValueError as e:
        raise PointsError(str(e)) from None


def squared(poses: np.ndarray) -> np.ndarray:
    """Poses whose rotations were printed with few digits, with the nearest true rotations."""
    out = poses.copy()
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    out[:, :3, :3] = left @ right
    return out


def pose_lines(poses: np.ndarray) -> str:
    """Output of the forward problem: poses (N, 4, 4)."""
    numbers = np.concatenate([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3] / MM], axis=1)
    return number_lines(numbers)


def number_lines(numbers: np.ndarray) -> str:
    """Rows of numbers as lines, ten digits behind the point."""
    return ''.join('; '.join(f'{v:.10f}' for v in row + 0.0) + '\n' for row in numbers)
