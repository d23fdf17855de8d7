"""The frames of a robot cell: its URDF, and where the frames of the machine hang in it."""

from __future__ import annotations

import numpy as np

from waam_bridge.frame_tree import MACHINE, STANDOFF, TORCH, WORK, Placed, Tree, quaternion
from waam_node.params import ParameterError
from waam_robot.frames import wpr
from waam_robot.positioner import Machine
from waam_robot.station import Station
from waam_robot.urdf_station import UrdfStation
from waam_robot.urdf_text import PART, check_urdf, write_urdf
from waam_robot.urdf_text import TORCH as TORCH_LINK

from .params import RobotParams

OURS = {MACHINE, WORK, TORCH, STANDOFF, 'scanner'}


def description(params: RobotParams, station: Station | UrdfStation) -> str:
    """The URDF of the cell, its joints by the driver's names. ParameterError for a file whose links have names of
    frames that are placed by the cell."""
    if isinstance(station, Station):
        names = tuple(map(str, params.joint_names))
        machine = Machine(station.place.arm, station.place.positioner)
        return write_urdf(machine, np.array(params.joint_speed_max, float), joints=names)
    text = check_urdf(station.text)
    if taken := sorted(OURS & Tree(text).frames):
        raise ParameterError(
            f"parameter 'urdf': {params.urdf}: its link '{taken[0]}' has the name of a frame of the cell"
        )
    return text


def fixed_frames(station: Station | UrdfStation) -> list[Placed]:
    """Machine coordinates on the link `part`, and the wire tip on the link `torch`."""
    return [
        _placed(PART, MACHINE, station.machine_on_part),
        _placed(TORCH_LINK, TORCH, station.tip_on_torch),
    ]


def _placed(parent: str, child: str, pose: np.ndarray) -> Placed:
    x, y, z = pose[:3, 3].tolist()
    return Placed(parent, child, (x, y, z), quaternion(wpr(pose).tolist()))
