"""How goals of a stock joint trajectory controller begin and end. Pure.

The rules are those of `joint_trajectory_controller` of ros2_controllers 4.42 (Jazzy), with the defaults of its
parameters: a goal may bring tolerances of its own, without them only the speed at the end is looked at, and for that it
waits as long as it takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .robot import Trajectory

STOPPED = 0.01  # rad/s, `constraints.stopped_velocity_tolerance`
SUCCESSFUL, INVALID_GOAL, PATH_TOLERANCE_VIOLATED, GOAL_TOLERANCE_VIOLATED = 0, -1, -4, -5
REACHED = 'Goal successfully reached!'
PREEMPTED = 'Current goal preempted by new incoming action.'
OFF_PATH = 'Aborted due to path tolerance violation'
TOO_LATE = 'Aborted due to goal_time_tolerance exceeding by {:f} seconds'
STILL = 1e-7  # rad/s: of single precision
BESIDE_US = 1000  # for the speed that a trajectory has at a time


class ToleranceError(ValueError):
    """A tolerance of a goal that means nothing: the defaults are taken for all of them."""


class JointTolerance(Protocol):
    """As of control_msgs: 0 = the default, -1 = none. rad, rad/s."""

    name: str
    position: float
    velocity: float


@dataclass(frozen=True)
class Tolerances:
    """path, end: (2, n) rad and rad/s, 0 = none; late: s after its time that the end may be reached, 0 = any."""

    path: np.ndarray
    end: np.ndarray
    late: float = 0.0

    @classmethod
    def usual(cls, count: int) -> Tolerances:
        """Of a goal that brings none, for `count` joints."""
        none = np.zeros((2, count))
        return cls(none, np.array([none[0], none[1] + STOPPED]))

    def of_goal(
        self,
        path: Iterable[JointTolerance],
        end: Iterable[JointTolerance],
        late: float,
        names: Sequence[str],
    ) -> Tolerances:
        """These with those of a goal; late: s. ToleranceError names the joint."""
        both = []
        for usual, given in ((self.path, path), (self.end, end)):
            made = usual.copy()
            for one in given:
                if one.name not in names:
                    raise ToleranceError(f"there is no joint '{one.name}'")
                n = list(names).index(one.name)
                for row, value in enumerate((one.position, one.velocity)):
                    made[row, n] = _resolved(made[row, n], value, one.name)
            both.append(made)
        return Tolerances(both[0], both[1], _resolved(self.late, late, 'goal_time_tolerance'))


def _resolved(usual: float, given: float, name: str) -> float:
    if given < 0 and given != -1:
        raise ToleranceError(f'{given:g} for {name}')
    return usual if given == 0 else max(given, 0.0)


def refusal(trajectory: Trajectory, now_us: int) -> str:
    """Why a goal is not taken at now_us, '' = it is."""
    late = (now_us - trajectory.start_us) * 1e-6 - float(trajectory.time[-1])
    if trajectory.start_us and late > 0:
        return f'it has ended {late:.3f} s ago'
    return 'a joint still moves at its end' if np.abs(trajectory.rates[-1]).max() > STILL else ''


def begun(trajectory: Trajectory, now_us: int, joints: np.ndarray, rates: np.ndarray) -> Trajectory:
    """The trajectory with the way to its first point, from where the axes (n,) are at now_us, as far as that lies
    ahead; what they did before is forgotten. One without a start begins now."""
    start = trajectory.start_us or now_us
    ahead = start - now_us + round(trajectory.time[0] * 1e6)
    if ahead <= 0:
        if len(trajectory.time) > 1:
            return Trajectory(start, trajectory.time, trajectory.joints, trajectory.rates)
        return standing(now_us, trajectory.joints[0])
    time = np.append(0.0, trajectory.time + (start - now_us) * 1e-6)
    return Trajectory(
        now_us,
        time,
        np.vstack([joints, trajectory.joints]),
        np.vstack([rates, trajectory.rates]),
    )


def standing(now_us: int, joints: np.ndarray) -> Trajectory:
    """At (n,) from now_us on."""
    twice = np.tile(joints, (2, 1))
    return Trajectory(now_us, np.array([0.0, 1e-3]), twice, np.zeros_like(twice))


def end_of(
    trajectory: Trajectory, limits: Tolerances, at_us: int, joints: np.ndarray, rates: np.ndarray
) -> tuple[int, str] | None:
    """Error code and text of a goal that ends with axes (n,) at the trajectory's time at_us; None = it goes on."""
    past = (at_us - trajectory.start_us) * 1e-6 - float(trajectory.time[-1])
    tolerance = limits.path if past < 0 else limits.end
    if past < 0 and not tolerance.any():
        return None
    times = np.array([at_us - BESIDE_US, at_us, at_us + BESIDE_US])
    before, wanted, after = trajectory.at(times)
    speed = (after - before) / (2e-6 * BESIDE_US) if past < 0 else trajectory.rates[-1]
    off = np.abs(np.array([joints - wanted, rates - speed]))
    beyond = bool(((tolerance > 0) & (off > tolerance)).any())
    if past < 0:
        return (PATH_TOLERANCE_VIOLATED, OFF_PATH) if beyond else None
    if not beyond:
        return SUCCESSFUL, REACHED
    if limits.late and past > limits.late:
        return GOAL_TOLERANCE_VIOLATED, TOO_LATE.format(past)
    return None
