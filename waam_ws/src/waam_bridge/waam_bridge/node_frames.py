"""The frames of the machine as ROS knows them: robot_description, /tf_static, /tf, and joint_states of a gantry."""

from __future__ import annotations

from array import array
from typing import Protocol

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from waam_node import qos
from waam_node.conversions import stamp_ns, transform_to_msg
from waam_process.units import mm

from .core import Bridge
from .frame_tree import AXES, Placed, Tree, gantry_urdf, work_frames


class Body(Protocol):
    """What carries the torch. `drives`: something else publishes its joint_states."""

    drives: bool

    def urdf(self) -> str:
        """Of the machine, '' = not known yet."""

    def fixed(self) -> list[Placed]:
        """Frames that are not in the URDF."""

    def joints(self) -> tuple[int, dict[str, float]] | None:
        """ROS time, ns, and positions, m or rad, by the names of the joints; None = not known."""


class Gantry:
    """Three axes; envelope and positions as the controller tells them."""

    drives = False

    def __init__(self, core: Bridge) -> None:
        self._core = core

    def urdf(self) -> str:
        """As `Body.urdf`."""
        who = self._core.link.identity
        if who is None:
            return ''
        x, y, z, *high = map(mm, who.limits_mm)
        return gantry_urdf((x, y, z), (high[0], high[1], high[2]), self._core.params.speed_max)

    def fixed(self) -> list[Placed]:
        """None."""
        return []

    def joints(self) -> tuple[int, dict[str, float]] | None:
        """Of the last telemetry, in machine coordinates."""
        core = self._core
        telemetry, tip, zero = core.link.telemetry, core.position, core.offset
        if not (core.connected and telemetry and tip and zero and core.link.clock.ready):
            return None
        at = (a + b for a, b in zip(tip, zero, strict=True))
        return core.link.clock.to_ros_ns(telemetry.t_us), dict(zip(AXES, at, strict=True))


class FramePublishers:
    """`publish` is called some 25 times a second; what has not changed is not said again."""

    def __init__(self, node: Node, core: Bridge, body: Body) -> None:
        self._node, self._core, self._body = node, core, body
        self._described = node.create_publisher(String, 'robot_description', qos.LATCHED)
        self._static = node.create_publisher(TFMessage, '/tf_static', qos.LATCHED)
        self._moving = node.create_publisher(TFMessage, '/tf', qos.EVENTS)
        self._states = (
            None if body.drives else node.create_publisher(JointState, 'joint_states', qos.BEAT)
        )
        self._tree, self._urdf, self._fixed, self._ns = Tree('<robot/>'), '', list[Placed](), 0

    def publish(self) -> None:
        """Description and fixed frames when they are new, moving ones when the machine was heard of."""
        urdf = self._body.urdf()
        if not urdf:
            return
        if urdf != self._urdf:
            self._tree, self._urdf = Tree(urdf), urdf
            self._described.publish(String(data=urdf))
        work = work_frames(self._core.offset, self._core.standoff.distance)
        fixed = [*self._tree.fixed, *self._body.fixed(), *work]
        if fixed != self._fixed:
            self._fixed = fixed
            self._static.publish(_message(fixed, self._node.get_clock().now().to_msg()))
        known = self._body.joints()
        if known is None or known[0] == self._ns:
            return
        self._ns, joints = known
        stamp = stamp_ns(self._ns)
        self._moving.publish(_message(self._tree.at(joints), stamp))
        if self._states:
            state = JointState(name=list(joints), position=array('d', joints.values()))
            state.header.stamp = stamp
            self._states.publish(state)


def _message(placed: list[Placed], stamp: Time) -> TFMessage:
    return TFMessage(transforms=[transform_to_msg(*one, stamp) for one in placed])
