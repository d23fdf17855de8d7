"""Whether an override is in force. Nothing answers a topic: telemetry, which shows the factors, is the answer."""

from __future__ import annotations

import math

from waam_msgs.msg import ProcessControl, Telemetry

SLACK = 1e-3  # the controller counts in thousandths
CONTROLLED_SLACK = 0.02  # the factors of a process control go on changing


def in_force(t: Telemetry, control: ProcessControl | None, speed: float, wire: float) -> bool:
    """Whether a frame shows the factors (NaN = as it is), those of a process control taken into account: it multiplies
    them by its own, and must have heard them, or it would take them back."""
    by_speed, by_wire, slack = 1.0, 1.0, SLACK
    if control is not None:
        by_speed, by_wire, slack = control.speed_factor, control.wire_factor, CONTROLLED_SLACK
        heard = ((speed, control.operator_speed_factor), (wire, control.operator_wire_factor))
        if any(abs(a - b) > 1e-6 for a, b in heard if not math.isnan(a)):
            return False
    pairs = ((speed, by_speed, t.speed_override), (wire, by_wire, t.wire_override))
    return all(math.isnan(a) or abs(a * by - b) <= slack for a, by, b in pairs)
