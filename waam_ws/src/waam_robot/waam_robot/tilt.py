"""The part tilted by the positioner, so that what overhangs grows upwards and every bead lies in the flat position.

The tilt turns the part about the y axis, its z axis towards the robot: x goes up. So overhangs lean towards +x of the
part. The machine's frame stays level; at a tilt its box stands before the upper half of the faceplate (`carriage`), so
that arms reach over the rim of the faceplate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .frames import rotation
from .positioner import Positioner

MAX_TILT = np.radians(100.0)
RAISED = (
    0.25,
    0.10,
)  # m at 90 degrees: of the middle of the box, towards the upper rim and off the faceplate


def tilted(points: np.ndarray, tilt: float) -> np.ndarray:
    """(..., 3): points of the part in level axes when it is tilted by `tilt` (rad) about its zero."""
    return np.asarray(points, float) @ rotation(1, -tilt)[:3, :3].T


def carriage(positioner: Positioner, middle: np.ndarray, tilt: float) -> Positioner:
    """The positioner whose level faceplate has `middle` ((3,) m, over the centre of the faceplate) where the given one
    has it at the tilt, raised by RAISED."""
    share = np.sin(tilt)
    raised = np.asarray(middle, float) + [RAISED[0] * share, 0.0, RAISED[1] * abs(share)]
    here, there = (
        positioner.to_robot(np.eye(4), b, -positioner.turn_zero) @ np.append(point, 1.0)
        for b, point in ((0.0, middle), (tilt, raised))
    )
    along, _, up, _ = there - here
    return replace(positioner, a_b=positioner.a_b + float(along), d_b=positioner.d_b + float(up))
