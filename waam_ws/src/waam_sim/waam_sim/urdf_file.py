"""Reads the URDF that a simulated cell is told to have for its arm."""

from __future__ import annotations

import math
from pathlib import Path

from waam_node.params import ParameterError
from waam_robot.urdf_text import UrdfError

from .robot import RobotParams
from .urdf_arm import UrdfArm


def arm_of(
    params: RobotParams, names: tuple[str, ...] = (), posture: tuple[float, ...] = ()
) -> UrdfArm:
    """names: order of the joints, () = as in the file; posture: rad, where the parameters have none. ParameterError
    with the file."""
    given = tuple(float(v) for v in params.posture)
    if not all(map(math.isfinite, given)):
        given = posture
    if not given:
        raise ParameterError(
            "parameter 'robot_posture' is needed with 'robot_urdf': that of the bridge, from which both reach the box"
        )
    if params.tilt:
        raise ParameterError(
            "parameter 'robot_tilt': only the M-20iB/25 tilts the part, not an arm from a URDF"
        )
    if len(params.origin) != 3:
        raise ParameterError(f"parameter 'robot_origin' has {len(params.origin)} values, needs 3")
    try:
        text = Path(params.urdf).read_bytes()
        return UrdfArm(text, given, names, tuple(float(v) for v in params.origin))
    except OSError as e:
        raise ParameterError(f"parameter 'robot_urdf': {params.urdf}: {e.strerror}") from None
    except UrdfError as e:
        raise ParameterError(f"parameter 'robot_urdf': {params.urdf}: {e}") from None
