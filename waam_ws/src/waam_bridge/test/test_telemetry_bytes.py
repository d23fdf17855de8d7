"""The bytes that the bridge publishes say what the message would have said."""

from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from waam_bridge import conversions, frames
from waam_msgs.msg import Telemetry

U16, U32, I32 = (
    st.integers(0, 2**16 - 1),
    st.integers(0, 2**32 - 1),
    st.integers(-(2**31), 2**31 - 1),
)
FRAMES = st.builds(
    frames.Telemetry,
    seq=U32, t_us=st.integers(0, 2**63 - 1), state=st.integers(0, 3), flags=st.integers(0, 511),
    x_um=I32, y_um=I32, z_um=I32, v_um_s=I32, wire_cmd_um_s=I32, wire_um_s=I32, current_ma=I32,
    voltage_mv=I32, line_accepted=U32, line_executed=U32, free_blocks=U16, speed_permille=U32,
    wire_permille=U32, lease_left_ms=I32, underruns=U32, fault=U32,
)  # fmt: skip


def message_of(t, ros_ns, boot):
    """Field by field, by name."""
    msg = Telemetry()
    msg.header.frame_id = 'work'
    stamp, p, flags = msg.header.stamp, msg.position, t.flags
    stamp.sec, stamp.nanosec = divmod(ros_ns, 1_000_000_000)
    msg.controller_us, msg.boot_id, msg.sequence, msg.state = t.t_us, boot, t.seq, t.state
    p.x, p.y, p.z = t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6
    msg.travel_speed = t.v_um_s * 1e-6
    msg.wire_feed_commanded, msg.wire_feed_speed = t.wire_cmd_um_s * 1e-6, t.wire_um_s * 1e-6
    msg.arc_current, msg.arc_voltage = t.current_ma * 1e-3, t.voltage_mv * 1e-3
    msg.arc_enabled = flags & frames.ARC_ENABLED != 0
    msg.arc_established = flags & frames.ARC_ESTABLISHED != 0
    msg.gas = flags & frames.GAS != 0
    if flags & frames.UNDERFEED:
        msg.wire_feed = Telemetry.WIRE_FEED_UNDERFEED
    elif t.wire_cmd_um_s > 0 and t.wire_um_s > 0:
        msg.wire_feed = Telemetry.WIRE_FEED_NORMAL
    msg.line_accepted, msg.line_executed, msg.blocks_free = (
        t.line_accepted,
        t.line_executed,
        t.free_blocks,
    )
    msg.speed_override, msg.wire_override = t.speed_permille * 1e-3, t.wire_permille * 1e-3
    msg.lease_left, msg.underruns, msg.fault = t.lease_left_ms * 1e-3, t.underruns, t.fault
    return msg


@settings(deadline=None)
@given(FRAMES, st.integers(0, 2**60), U32)
def test_bytes_are_the_message(frame, ros_ns, boot):
    message = message_of(frame, ros_ns, boot)
    packed = conversions.telemetry_bytes(frame, ros_ns, boot)
    sent = serialize_message(message)
    assert len(packed) == len(sent)  # not compared: the padding, which is not initialised there
    assert deserialize_message(packed, Telemetry) == deserialize_message(sent, Telemetry)
