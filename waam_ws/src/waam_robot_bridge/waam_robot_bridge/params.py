"""Parameters of the robot bridge: those of the bridge and those of the robot, in one place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waam_bridge.params import CommonParams
from waam_bridge.program import Limits as Box
from waam_node.params import ParameterError, param
from waam_robot.positioner import Positioner
from waam_robot.station import JOINTS, Place
from waam_robot.timing import AXIS_NAMES
from waam_robot.turning import Turning
from waam_robot.urdf_station import UrdfPlace

from .limits import Limits

LIMITS = ('joint_speed_max', 'joint_acceleration_max', 'joint_jerk_max')
NAMES = ('joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6', 'tilt', 'turn')


MAX_TURNING = 20.0  # rad/m


def turning_of(values: Sequence[float]) -> Turning:
    """Of the parameter `turning`: rad, rad/m, rad/m."""
    start, x, y = map(float, values)
    return Turning(start, (x, y))


@dataclass(frozen=True)
class RobotParams(CommonParams):
    """Defaults fit the simulated robot cell."""

    port: str = param('robot', 'what machine_state shows as its port')
    positioner: tuple = param(
        (1.2, 0.35, 0.15),
        "from the robot's base to the tilt axis along x and z, and up to the faceplate",
        'm',
    )
    origin: tuple = param((-0.2, -0.15, 0.0), 'machine zero on the faceplate', 'm')
    tilt: float = param(
        0.0,
        'of the part towards the robot, by the positioner: that of the plan (`waam plan --tilt`)',
        'rad',
        -1.745,
        1.745,
    )
    turning: tuple = param(
        (0.0, 0.0, 0.0),
        'of a level part by the positioner while the torch goes: at the middle of the box (rad), per m of x and of y '
        '(rad/m); `waam plan --turning` chooses it; zeros = it stands still',
    )
    work_low: tuple = param((0.0, 0.0, 0.0), 'lower corner of the box that the torch may use', 'm')
    work_high: tuple = param((0.4, 0.3, 0.2), 'upper corner; HOME goes to (0, 0, 0.2)', 'm')
    trajectory_action: str = param(
        'joint_trajectory_controller/follow_joint_trajectory', "action of the robot's driver"
    )
    joint_names: tuple = param(NAMES, 'as the driver names them: six of the arm, tilt, turn')
    joint_speed_max: tuple = param(
        (3.5, 3.5, 4.5, 7.2, 7.2, 15.0, 2.0, 3.3), 'fastest that each may turn', 'rad/s'
    )
    joint_acceleration_max: tuple = param(
        (8.7, 8.7, 10.5, 20.9, 20.9, 34.9, 5.2, 8.7), 'greatest acceleration of each', 'rad/s^2'
    )
    joint_jerk_max: tuple = param(
        (87.0, 87.0, 105.0, 209.0, 209.0, 349.0, 52.0, 87.0),
        'greatest jerk of each: the lower, the longer the path of the torch is averaged',
        'rad/s^3',
    )
    delay: float = param(
        0.04, 'between command and goal: longer than a goal takes to the driver', 's', 0.0, 0.5
    )
    weld_delay: float = param(
        0.04,
        'of the welding outputs: `delay`, and what `servo_lag` leaves of the lag',
        's',
        0.0,
        0.5,
    )
    servo_lag: float = param(
        0.02, 'time constant of the servos, which goals make up for; 0 = not', 's', 0.0, 0.2
    )
    urdf: str = param(
        '',
        'URDF of another arm, with links `torch` (z towards the part) and `part`: then `origin` is in the frame of '
        '`part`, `joint_names` are its joints, and `positioner` means nothing; empty = the M-20iB/25',
    )
    posture: tuple = param(
        (math.nan,),
        'with `urdf`: joints near which the arm works, torch upright, as `joint_names`; NaN = one is searched for',
        'rad',
    )
    corner: float = param(
        2e-4, 'the torch may leave the path at a corner, to keep its speed; 0 = not', 'm', 0.0, 2e-3
    )
    state_timeout: float = param(0.15, 'joint states older than this cut the arc', 's', 0.03, 0.4)
    follow_max: float = param(
        0.003, 'distance of the torch from the commanded path that cuts the arc', 'm', 1e-4, 0.05
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        joints = len(self.joint_names) if self.urdf else JOINTS
        for name, count in (
            ('positioner', 3), ('origin', 3), ('turning', 3), ('work_low', 3), ('work_high', 3),
            ('joint_names', joints), *((name, joints) for name in LIMITS),
        ):  # fmt: skip
            got = len(getattr(self, name))
            if got != count:
                raise ParameterError(f"parameter '{name}' has {got} values, needs {count}")
        if self.urdf and self.tilt:
            raise ParameterError(
                "parameter 'tilt': only the M-20iB/25 tilts the part, not an arm from a URDF"
            )
        start, *along = map(float, self.turning)
        if any(map(float, self.turning)) and (self.urdf or self.tilt):
            raise ParameterError(
                "parameter 'turning': only a level part before the M-20iB/25 turns, not a tilted one or another arm's"
            )
        if not (abs(start) <= math.tau and max(map(abs, along)) <= MAX_TURNING):
            raise ParameterError(
                f"parameter 'turning' is {tuple(self.turning)}: at most a turn, and {MAX_TURNING:g} rad/m"
            )
        if self.known_posture and len(self.known_posture) != joints:
            got = len(self.posture)
            raise ParameterError(f"parameter 'posture' has {got} values, needs {joints}")
        if len(set(self.joint_names)) != joints:
            raise ParameterError(f"parameter 'joint_names' names one twice: {self.joint_names}")
        if not self.urdf:
            self._check_order()
        for name in LIMITS:
            if not all(v > 0 for v in getattr(self, name)):
                raise ParameterError(f"parameter '{name}' has a value that is not above 0")

    def _check_order(self) -> None:
        """ParameterError where a name of the arm stands in another's place: the robot would turn the wrong axis."""
        for given, known in zip(self.joint_names, NAMES, strict=True):
            if given != known and given in NAMES:
                raise ParameterError(
                    f"parameter 'joint_names' has '{given}' in the place of '{known}': wanted are the names of "
                    f'{", ".join(NAMES)}, in this order'
                )

    @property
    def known_posture(self) -> tuple[float, ...]:
        """`posture`, empty where one is to be searched for."""
        given = tuple(float(v) for v in self.posture)
        return given if all(map(math.isfinite, given)) else ()

    def limits_of_joints(self) -> Limits:
        """Of all joints, in the order of their names."""
        speed, push, jerk = (np.array(getattr(self, name), float) for name in LIMITS)
        names = tuple(map(str, self.joint_names)) if self.urdf else AXIS_NAMES
        return Limits(speed, push, jerk, names=names)

    def urdf_place(self) -> UrdfPlace:
        """For a UrdfStation."""
        p = self.place()
        names = tuple(map(str, self.joint_names))
        return UrdfPlace(names, p.origin, p.low, p.high, self.known_posture)

    def place(self) -> Place:
        """For a Station."""
        a_b, d_b, d_c = (float(v) for v in self.positioner)
        low, high, origin = (
            tuple(float(v) for v in values)
            for values in (self.work_low, self.work_high, self.origin)
        )
        return Place(
            positioner=Positioner(a_b=a_b, d_b=d_b, d_c=d_c),
            origin=origin, low=low, high=high, tilt=float(self.tilt),  # type: ignore[arg-type]
            turning=turning_of(self.turning),
        )  # fmt: skip

    def limits(self, box_mm: tuple[float, ...]) -> Box:
        """Those of the bridge, inside the box of the robot."""
        usual = super().limits(box_mm)
        low = tuple(map(max, usual.low, self.work_low))
        high = tuple(map(min, usual.high, self.work_high))
        fields = {**usual.__dict__, 'low': low, 'high': high}
        return Box(**fields)
