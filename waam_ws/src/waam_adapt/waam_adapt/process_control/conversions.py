"""Messages of the process control."""

from __future__ import annotations

from waam_msgs.msg import ProcessControl as ProcessControlMsg
from waam_msgs.msg import Telemetry

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
    status = control.status
    msg = ProcessControlMsg(
        controller_us=seen.controller_us,
        value=VALUES.index(control.params.value),
        reference=status.reference,
        measured=status.measured,
        frozen=bool(status.reason),
        limited=status.limited,
        reason=status.reason,
    )
    msg.header.stamp = seen.header.stamp
    msg.speed_factor, msg.wire_factor = control.factors
    msg.operator_speed_factor, msg.operator_wire_factor = control.operator
    return msg
