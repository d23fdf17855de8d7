"""Parameters of bridge and cell for another arm: one URDF for both (`waam lab --urdf`, `waam up --urdf`).

Names and fastest speeds of the joints are those of the file. A URDF has no accelerations and no jerks: they are in the
proportion that the bridge's usual limits have. The posture is searched for once, so that bridge and cell reach the box
the same way.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from waam_robot.urdf_text import UrdfError
from waam_robot_bridge.params import RobotParams
from waam_robot_bridge.station_file import station_of
from waam_sim.urdf_arm import branches

from .. import params

PER_SPEED = (2.5, 25.0)  # acceleration, 1/s, and jerk, 1/s^2, per speed: those of the M-20iB/25
BRIDGE, CELL = 'robot_bridge', 'cell'


def settings(file: Path, wanted: params.Overrides) -> dict[str, dict[str, Any]]:
    """`wanted` with what the file says added where it says nothing. ValueError with the file for one that cannot be
    used."""
    robot = dict(wanted.get(BRIDGE, {}))
    found = {**_of_joints(file), **robot}
    filled: RobotParams = params.make({BRIDGE: found}).robot_bridge
    if not filled.known_posture:
        middle = np.add(filled.work_low, filled.work_high) / 2
        found['posture'] = tuple(map(float, station_of(filled).joints(middle[None])[0]))
    cell = {'robot_urdf': found['urdf'], 'robot_origin': filled.origin}
    others = {node: dict(values) for node, values in wanted.items()}
    return {**others, BRIDGE: found, CELL: {**cell, **others.get(CELL, {})}}


def parameter_file(file: Path, given: list[Path], target: Path) -> Path:
    """Writes `target` for the nodes of a graph, which has the parameter files `given` as well."""
    wanted: dict[str, dict[str, Any]] = {}
    for each in given:
        blocks = params.read_file(each)
        for node, key in (('bridge', BRIDGE), (CELL, CELL)):
            wanted.setdefault(key, {}).update(params.of_node(blocks, node))
    found = settings(file, wanted)
    robot, cell = found[BRIDGE], found[CELL]
    posture = dict(zip(robot['joint_names'], robot['posture'], strict=True))
    in_file = _of_joints(Path(robot['urdf']))['joint_names']
    cell.setdefault('robot_posture', [posture[name] for name in in_file])
    text = {
        node: {'ros__parameters': _plain(values)}
        for node, values in (('bridge', robot), (CELL, cell))
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(yaml.safe_dump(text))
    return target


def _of_joints(file: Path) -> dict[str, Any]:
    try:
        arm, table = branches(file.read_bytes())
        joints = [*arm.joints, *table.joints]
        if still := [j.name for j in joints if j.speed <= 0]:
            raise UrdfError(f"joint '{still[0]}' has no limit of its velocity")
    except OSError as e:
        raise ValueError(f'--urdf {file}: {e.strerror}') from None
    except UrdfError as e:
        raise ValueError(f'--urdf {file}: {e}') from None
    push, jerk = PER_SPEED
    speeds = [j.speed for j in joints]
    return {
        'urdf': str(file.absolute()),
        'joint_names': tuple(j.name for j in joints),
        'joint_speed_max': tuple(speeds),
        'joint_acceleration_max': tuple(v * push for v in speeds),
        'joint_jerk_max': tuple(v * jerk for v in speeds),
    }


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """For YAML: lists; a NaN stays out."""
    return {
        k: list(v) if isinstance(v, tuple) else v
        for k, v in values.items()
        if not (isinstance(v, float) and math.isnan(v))
    }
