"""How a sensor is mounted: which of its axes lie along those of the machine. Pure."""

from __future__ import annotations

import numpy as np

AXES = {'x': (0, 1), 'y': (1, 1), 'z': (2, 1), '-x': (0, -1), '-y': (1, -1), '-z': (2, -1)}


def mounting(text: str) -> np.ndarray:
    """(3, 3) from the axes of the sensor to those of the machine. text: the sensor's axis that lies along x, y and z of
    the machine, such as '-y x z'. ValueError when it is no rotation."""
    names = text.split()
    turn = np.zeros((3, 3))
    if len(names) == 3 and all(n in AXES for n in names):
        for row, name in zip(turn, names, strict=True):
            column, sign = AXES[name]
            row[column] = sign
    if round(float(np.linalg.det(turn))) != 1:
        raise ValueError(
            f"'{text}' is no mounting: wanted three axes such as '-y x z', right-handed"
        )
    return turn
