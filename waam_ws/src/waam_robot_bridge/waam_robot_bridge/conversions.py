"""Goals, joint states and welding inputs and outputs <-> messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from waam_node.conversions import nanoseconds, stamp_ns

from .goals import Goal
from .weld import ARC, GAS

WELDING = 'welding'  # name of the device in both messages
OUTPUTS = ('arc', 'gas', 'wire_feed_speed', 'voltage')
INPUTS = ('gas_ok', 'current', 'voltage', 'wire_speed')
GAS_OK = 2  # bit of the controller's inputs


@dataclass(frozen=True)
class WeldReading:
    """What the welding device measures, as the controller's inputs: bits, A, V, m/s; no distance sensor."""

    inputs: int = 0
    current: float = 0.0
    voltage: float = 0.0
    wire_speed: float = 0.0
    distance: float = float('nan')
    distance_reading: int = 0


def us_from_time(stamp: Time) -> int:
    """us of ROS time."""
    return nanoseconds(stamp) // 1000


def goal_to_msg(goal: Goal, names: Sequence[str]) -> FollowJointTrajectory.Goal:
    """Positions and speeds of every point; the trajectory begins at the goal's start."""
    trajectory = JointTrajectory(joint_names=list(names))
    trajectory.header.stamp = stamp_ns(1000 * goal.start_us)
    for t, joints, rates in zip(goal.time, goal.joints, goal.rates, strict=True):
        point = JointTrajectoryPoint(positions=joints.tolist(), velocities=rates.tolist())
        ns = round(float(t) * 1e9)
        point.time_from_start = Duration(sec=ns // 10**9, nanosec=ns % 10**9)
        trajectory.points.append(point)
    return FollowJointTrajectory.Goal(trajectory=trajectory)


def outputs_to_msg(sample: np.void, time_us: int) -> DynamicInterfaceGroupValues:
    """One sample of the controller's outputs."""
    bits = int(sample['outputs'])
    values = [bits & ARC != 0, bits & GAS != 0, sample['wire_cmd'], sample['voltage_set']]
    one = InterfaceValue(interface_names=list(OUTPUTS), values=[float(v) for v in values])
    msg = DynamicInterfaceGroupValues(interface_groups=[WELDING], interface_values=[one])
    msg.header.stamp = stamp_ns(1000 * time_us)
    return msg


def inputs_from_msg(msg: DynamicInterfaceGroupValues) -> WeldReading:
    """ValueError names what is missing."""
    found = _named(msg, INPUTS)
    bits = GAS_OK if found['gas_ok'] > 0.5 else 0
    return WeldReading(bits, found['current'], found['voltage'], found['wire_speed'])


def _named(msg: DynamicInterfaceGroupValues, wanted: Sequence[str]) -> Mapping[str, float]:
    groups = dict(zip(msg.interface_groups, msg.interface_values, strict=False))
    if WELDING not in groups:
        raise ValueError(f"no group '{WELDING}' among {list(msg.interface_groups)}")
    group = groups[WELDING]
    found = dict(zip(group.interface_names, group.values, strict=False))
    for name in wanted:
        if name not in found or not math.isfinite(found[name]):
            raise ValueError(f"group '{WELDING}' has no value '{name}'")
    return found
