"""The arm of the bridge's parameters; that of a URDF is read from its file."""

from __future__ import annotations

from pathlib import Path

from waam_node.params import ParameterError
from waam_robot.station import Station, StationError
from waam_robot.urdf_station import UrdfStation
from waam_robot.urdf_text import UrdfError

from .params import RobotParams


def station_of(params: RobotParams) -> Station | UrdfStation:
    """ValueError where the arm does not reach its box; ParameterError for a URDF that cannot be used, with the file."""
    if not params.urdf:
        return Station(params.place())
    try:
        return UrdfStation(Path(params.urdf).read_bytes(), params.urdf_place())
    except OSError as e:
        raise ParameterError(f"parameter 'urdf': {params.urdf}: {e.strerror}") from None
    except (UrdfError, StationError) as e:
        raise ParameterError(f"parameter 'urdf': {params.urdf}: {e}") from None
