"""waam_msgs/Telemetry as bytes (CDR), without a message in between: at 1 kHz the conversion costs as much as sending.

The layout is that of XCDR1, little-endian: each value aligned to its size, counted from behind the four bytes of the
header. `test_telemetry_cdr.py` reads it back with rclpy.
"""

from __future__ import annotations

import struct

from .frames import ARC_ENABLED, ARC_ESTABLISHED, GAS, Telemetry

FRAME_ID = b'work\0'
_LAYOUT = struct.Struct(
    '<4s'  # little-endian CDR
    'iII5s7x'  # header: sec, nanosec, frame_id
    'QIIB7x'  # controller_us, boot_id, sequence, state
    '8d'  # position, speeds, current, voltage
    '???xII'  # arc_enabled, arc_established, gas; line_accepted, line_executed
    'H2x3f2I'  # blocks_free; overrides, lease_left; underruns, fault
)


def pack(t: Telemetry, ros_ns: int, boot: int) -> bytes:
    """The serialised message; ros_ns: its stamp."""
    sec, nanosec = divmod(ros_ns, 1_000_000_000)
    flags = t.flags
    return _LAYOUT.pack(
        b'\0\1\0\0', sec, nanosec, len(FRAME_ID), FRAME_ID, t.t_us, boot, t.seq, t.state,
        t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6,
        t.v_um_s * 1e-6, t.wire_cmd_um_s * 1e-6, t.wire_um_s * 1e-6,
        t.current_ma * 1e-3, t.voltage_mv * 1e-3,
        flags & ARC_ENABLED != 0, flags & ARC_ESTABLISHED != 0, flags & GAS != 0,
        t.line_accepted, t.line_executed, t.free_blocks,
        t.speed_permille * 1e-3, t.wire_permille * 1e-3, t.lease_left_ms * 1e-3,
        t.underruns, t.fault,
    )  # fmt: skip
