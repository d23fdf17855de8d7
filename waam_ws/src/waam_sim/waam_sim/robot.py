"""The robot of a simulated cell: a trajectory controller with latency, servos that lag, and a geometry with errors.

Goals are followed as stock trajectory controllers do: by cubics between points with given speeds. The servo of each
axis lags as a first-order low-pass; behind it, the gear has backlash. The driver sees the motors. The torch is where
the links, the offsets and the waves of the gears put it. Work zero and scanner are taught at one place: there torch and
scanner are where they should be, and everywhere else they are off by how much the errors differ from those there.
The arm is the M-20iB/25 by its table (`Station`), or one from a URDF (`UrdfArm`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waam_node.params import param
from waam_robot.accuracy import AxisErrors
from waam_robot.arm import AXES, Arm, Link, forward
from waam_robot.station import Station

from .urdf_arm import UrdfArm

SUBSTEP = 2e-3  # s
SCANNER = np.array([0.060, 0.0, 0.120])  # m from the torch, as of ScannerParams


@dataclass(frozen=True)
class RobotParams:
    """How exact the robot is; every machine draws its own errors with these standard deviations."""

    servo_lag: float = 0.02  # time constant of the servos [s]
    latency: float = 0.015  # until the trajectory controller has a goal [s]
    joint_offset: float = 3.5e-4  # of every axis (0.02 deg) [rad]
    gear_wave: float = 9e-5  # of the gear of every axis (0.005 deg) [rad]
    axis_offset: float = 5e-5  # of the positioner's turn axis [m]
    link_length: float = 1e-4  # of every length of the arm [m]
    backlash: float = param(3e-5, 'of the gear of every axis, whole width', 'rad', 0.0, 0.01)
    scan_error: float = param(
        0.0,
        'sigma of the error in z that scans share where a robot carries it, for `scanner_shared_error`',
        'm',
        0.0,
        2e-3,
    )
    tilt: float = param(
        0.0, 'of the part by the positioner, as `tilt` of the bridge', 'rad', -1.745, 1.745
    )
    turning: tuple = param(
        (0.0, 0.0, 0.0),
        'of the part by the positioner, as `turning` of the bridge: for where the axes stand at first',
        'rad, rad/m',
    )
    urdf: str = param(
        '',
        'URDF of another arm, as `urdf` of the bridge: links `torch` and `part`, six revolute joints between them (and '
        'up to two under the part), which are named as the bridge names them; empty = the M-20iB/25',
    )
    posture: tuple = param(
        (math.nan,),
        'with `robot_urdf`: joints near which the arm works, torch upright, in the order of the file; NaN in the '
        'laboratory = that of the bridge',
        'rad',
    )
    origin: tuple = param(
        (-0.2, -0.15, 0.0),
        'machine zero on the faceplate, with `robot_urdf` in the frame of `part`, as `origin` of the bridge',
        'm',
    )
    # upper corner of the torch's box, whose lower one is machine zero, as `work_high` of the bridge [m]
    work_high: tuple = (0.4, 0.3, 0.2)


@dataclass(frozen=True)
class Trajectory:
    """start_us: time of its beginning; time (N,) s; joints, rates (N, n) rad, rad/s."""

    start_us: int
    time: np.ndarray
    joints: np.ndarray
    rates: np.ndarray

    def at(self, times_us: np.ndarray) -> np.ndarray:
        """(N, n) rad: cubics between the points; before and after them it stands."""
        t = np.clip((times_us - self.start_us) * 1e-6, self.time[0], self.time[-1])
        i = np.clip(np.searchsorted(self.time, t, 'right') - 1, 0, len(self.time) - 2)
        h = self.time[i + 1] - self.time[i]
        u = ((t - self.time[i]) / h)[:, None]
        h = h[:, None]
        a, b = self.joints[i], self.joints[i + 1]
        va, vb = h * self.rates[i], h * self.rates[i + 1]
        return np.asarray(
            a + u * va + u**2 * (3 * (b - a) - 2 * va - vb) + u**3 * (2 * (a - b) + va + vb)
        )


class SimRobot:
    """station: what is programmed; start: (3,) m, the torch in machine coordinates; taught: (3,) m, where work zero and
    scanner were taught. `dead`: the driver tells nothing and takes nothing any more, the axes stand. `speed_scale`:
    seconds of a goal that pass in a second; `behind_us`: by how much the goal under way is late through that."""

    def __init__(
        self,
        station: Station | UrdfArm,
        params: RobotParams,
        seed: int,
        start: np.ndarray,
        taught: np.ndarray,
        time_us: int,
    ) -> None:
        self.station, self.params, self.time_us = station, params, time_us
        self.dead = False
        self.speed_scale, self.behind_us = 1.0, 0
        rng = np.random.default_rng([seed, 7])
        errors = AxisErrors(params.joint_offset, params.gear_wave, 8, params.axis_offset)
        self._motor = station.joints(np.array([start]))[0]
        self._gear = self._motor.copy()
        self._rates = np.zeros(len(self._motor))
        self._errors = errors.draw(seed, len(self._motor))
        self._made = _with_errors(station, params.link_length, rng)
        self._told = (time_us, self._motor.copy(), self._rates.copy())
        self._now: Trajectory | None = None
        self._coming: list[tuple[int, Trajectory]] = []
        self._shift, self._lever = np.zeros(3), np.zeros(3)
        reference = self._true(station.joints(np.array([taught]))[0])
        self._shift = reference[0] - taught
        self._lever = reference[1]
        self.tip, self.scanner = self._true(self._gear)

    def beyond(self, joints: np.ndarray) -> str:
        """Which of joints (N, n) of a goal is beyond its limit; '' = none. The table's arm takes all."""
        return self.station.beyond(joints) if isinstance(self.station, UrdfArm) else ''

    def follow(
        self, start_us: int, time: np.ndarray, joints: np.ndarray, rates: np.ndarray
    ) -> None:
        """A goal that replaces the one before once it has arrived."""
        if not self.dead:
            due = self.time_us + round(self.params.latency * 1e6)
            self._coming.append((due, Trajectory(start_us, time, joints, rates)))

    def state(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Time (us), joints and rates (n,) of the motors, as the driver last told them."""
        return self._told

    def advance(self, milliseconds: int) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) m: where the torch truly is in each of the ms, machine coordinates, and how far the scanner is from
        where it would be with an exact robot and the torch there."""
        count = max(1, round(milliseconds * 1e-3 / SUBSTEP))
        passed = np.arange(1, count + 1) * round(SUBSTEP * 1e6)
        self.time_us += 1000 * milliseconds
        self._arrive()
        if not self.dead and self._now is not None:
            begun = self.time_us - 1000 * milliseconds - self.behind_us
            self._follow(self._now.at(begun + self.speed_scale * passed))
            self.behind_us += round((1 - self.speed_scale) * 1000 * milliseconds)
        before, self.tip, self.scanner = self.tip, *self._true(self._gear)
        share = (np.arange(1, milliseconds + 1) / milliseconds)[:, None]
        if not self.dead:
            self._told = (self.time_us, self._motor.copy(), self._rates.copy())
        return before + share * (self.tip - before), np.tile(self.scanner, (milliseconds, 1))

    def flange(self, theta: np.ndarray) -> np.ndarray:
        """(4, 4): where the flange of the M-20iB/25 truly is in its base for angles (6,) of the gears, rad."""
        assert isinstance(self.station, Station) and isinstance(self._made, Arm)
        joints = np.concatenate([theta, self.station.hold])
        return forward(self._made, theta + self._errors.of(joints)[:AXES], tool=False)

    def _arrive(self) -> None:
        while self._coming and self._coming[0][0] <= self.time_us:
            self._now, self.behind_us = self._coming.pop(0)[1], 0

    def _follow(self, wanted: np.ndarray) -> None:
        """The servos go after (N, n) wanted joints, one row per substep."""
        share = 1 - np.exp(-SUBSTEP / self.params.servo_lag)
        half = self.params.backlash / 2
        motor = self._motor
        for row in wanted:
            step = share * (row - motor)
            motor = motor + step
            self._gear = np.clip(self._gear, motor - half, motor + half)
        self._motor, self._rates = motor, step / SUBSTEP

    def _true(self, gear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3,) m torch, and (3,) m by how much the lever to the scanner is turned away."""
        joints = gear + self._errors.of(gear)
        frame = self.station.frames(joints[None], self._made)[0]  # type: ignore[arg-type]
        lever = (frame[:3, :3] - np.eye(3)) @ SCANNER
        return frame[:3, 3] - self._shift, lever - self._lever


def _with_errors(
    station: Station | UrdfArm, sigma: float, rng: np.random.Generator
) -> Arm | np.ndarray:
    """What `frames` of the station takes for an arm with errors of its lengths."""
    if isinstance(station, UrdfArm):
        return station.lengthened(sigma, rng)
    return _lengthened(station.place.arm, sigma, rng)


def _lengthened(arm: Arm, sigma: float, rng: np.random.Generator) -> Arm:
    """The arm with errors of the lengths that it has."""

    def off(length: float) -> float:
        return length + (float(rng.normal(0, sigma)) if length else 0.0)

    links = tuple(Link(off(link.d), off(link.a), link.alpha) for link in arm.links)
    return replace(arm, links=links)
