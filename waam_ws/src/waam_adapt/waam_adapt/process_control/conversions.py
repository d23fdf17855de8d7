"""Messages of the process control."""

from __future__ import annotations

from waam_msgs.msg import ProcessControl as ProcessControlMsg
from waam_msgs.msg import Telemetry
from waam_node.conversions import to_msg

from .control import ProcessControl, Sample
from .params import VALUES


def process_sample(msg: Telemetry) -> Sample:
    """What the process control needs of a telemetry frame."""
    return Sample(
        msg.controller_us * 1e-6,
        msg.arc_current,
        msg.arc_voltage,
        msg.travel_speed,
        msg.wire_feed_commanded,
        msg.arc_established,
        msg.speed_override,
        msg.wire_override,
    )


def process_status(control: ProcessControl, seen: Telemetry) -> ProcessControlMsg:
    """What the process control does; seen: the last telemetry."""
    status, factors, operator = control.status, control.factors, control.operator
    return to_msg(
        ProcessControlMsg, stamp=seen.header.stamp, controller_us=seen.controller_us, reference=status.reference,
        value=VALUES.index(control.params.value), measured=status.measured, frozen=status.reason != '',
        limited=status.limited, reason=status.reason, speed_factor=factors.speed, wire_factor=factors.wire,
        operator_speed_factor=operator.speed, operator_wire_factor=operator.wire,
    )  # fmt: skip
