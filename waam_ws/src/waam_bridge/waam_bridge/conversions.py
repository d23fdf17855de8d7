"""Lines and states of the core -> messages."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from sensor_msgs.msg import Range
from std_msgs.msg import Header

from waam_msgs.msg import (
    AccelerationBatch,
    Anomaly,
    LinkStatus,
    MachineState,
    SegmentDone,
    Standoff,
    Telemetry,
)
from waam_node import cdr
from waam_process.names import CONTROLLER_STATES
from waam_process.units import mm

from . import frames
from .acceleration import RANGE, SENSOR
from .core import Bridge
from .frames import ARC_ENABLED, ARC_ESTABLISHED, GAS, UNDERFEED
from .outbox import Batch, Notice
from .program import Mark

NAN = float('nan')
LASER, INFRARED = 1, 2
UNKNOWN, NORMAL, UNDERFED = (
    Telemetry.WIRE_FEED_UNKNOWN,
    Telemetry.WIRE_FEED_NORMAL,
    Telemetry.WIRE_FEED_UNDERFEED,
)
SENSOR_RANGE = {
    LASER: (0.005, 0.4),
    INFRARED: (0.035, 0.4),
}  # m that the controller takes for a distance


def stamp_ns(ns: int) -> Time:
    """ROS time in ns."""
    sec, nanosec = divmod(ns, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def _point(values: Sequence[float] | None) -> Point:
    x, y, z = values or (NAN, NAN, NAN)
    return Point(x=x, y=y, z=z)


def wire_feed(flags: int, commanded_um_s: int, measured_um_s: int) -> int:
    """WIRE_FEED_* of a frame. A wheel that stands still is no sign of a normal feed: there may be none."""
    if flags & UNDERFEED:
        return UNDERFED
    return NORMAL if commanded_um_s > 0 and measured_um_s > 0 else UNKNOWN


def telemetry_bytes(t: frames.Telemetry, ros_ns: int, boot: int) -> bytes:
    """A serialised waam_msgs/Telemetry with the stamp ros_ns. At 1 kHz the time counts: the frame is taken apart at
    once, and the values are a plain tuple in the order of cdr.TelemetryFields."""
    (
        seq, t_us, state, flags, x_um, y_um, z_um, v_um_s, wire_cmd_um_s, wire_um_s, current_ma, voltage_mv,
        line_accepted, line_executed, free_blocks, speed_permille, wire_permille, lease_left_ms, underruns, fault,
    ) = t  # fmt: skip
    fields = (
        t_us, boot, seq, state,
        x_um * 1e-6, y_um * 1e-6, z_um * 1e-6,
        v_um_s * 1e-6, wire_cmd_um_s * 1e-6, wire_um_s * 1e-6,
        current_ma * 1e-3, voltage_mv * 1e-3,
        flags & ARC_ENABLED != 0, flags & ARC_ESTABLISHED != 0, flags & GAS != 0,
        wire_feed(flags, wire_cmd_um_s, wire_um_s), line_accepted, line_executed, free_blocks,
        speed_permille * 1e-3, wire_permille * 1e-3, lease_left_ms * 1e-3,
        underruns, fault,
    )  # fmt: skip
    return cdr.pack_telemetry(ros_ns, fields)


def machine_state(bridge: Bridge, port: str) -> MachineState:
    """Everything but the stamp."""
    who, flags = bridge.link.identity, bridge.flags if bridge.connected else 0
    msg = MachineState(connected=bridge.connected, port=port, state=bridge.state)
    if who:
        msg.identity, msg.firmware_version = who.name, who.firmware
        msg.capabilities, msg.boot_id = list(who.capabilities), who.boot
        box = [mm(v) for v in who.limits_mm]
        msg.limit_min, msg.limit_max = _point(box[:3]), _point(box[3:])
    msg.homed, msg.armed = flags & frames.HOMED != 0, flags & frames.ARMED != 0
    msg.arc_on = flags & frames.ARC_ENABLED != 0
    msg.armed_job, msg.work_offset = bridge.armed_job, _point(bridge.offset)
    msg.fault, msg.fault_text = bridge.fault, bridge.fault_text
    msg.silent_nodes, msg.message = list(bridge.silent), bridge.message
    return msg


def standoff(s: frames.Standoff, ros_ns: int) -> Standoff:
    """Lengths in m; the measured distance is NaN while it is not known. ros_ns: ROS time of the frame."""
    header = Header(stamp=stamp_ns(ros_ns), frame_id='torch_tcp')
    msg = Standoff(header=header, controller_us=s.t_us, source=s.source, known=s.known != 0)
    msg.alarm, msg.correction = min(s.alarm, 255), s.correction_um * 1e-6
    msg.set_distance = s.set_um * 1e-6
    msg.measured_distance = s.measured_um * 1e-6 if s.known else NAN
    return msg


def distance(s: frames.Standoff, ros_ns: int) -> Range | None:
    """The distance sensor for any ROS tool; None where the arc is the sensor. NaN = no reading (REP 117)."""
    if s.source not in SENSOR_RANGE:
        return None
    header = Header(stamp=stamp_ns(ros_ns), frame_id='standoff_sensor')
    msg = Range(header=header, radiation_type=Range.INFRARED, field_of_view=0.02)
    msg.min_range, msg.max_range = SENSOR_RANGE[s.source]
    msg.range = s.measured_um * 1e-6 if s.known else NAN
    return msg


def segment_done(mark: Mark) -> SegmentDone:
    """The message for a segment that the controller has executed."""
    return SegmentDone(job_id=mark.job, index=mark.index, layer=mark.layer, bead=mark.bead)


def anomaly(bridge: Bridge, notice: Notice) -> Anomaly:
    """Everything but the header; layer and bead are those of the segment that is being executed."""
    mark = bridge.running
    return Anomaly(
        job_id=bridge.job,
        severity=notice.severity,
        class_name=notice.class_name,
        text=notice.text,
        reaction=notice.reaction,
        layer=mark.layer if mark else 0,
        bead=mark.bead if mark else 0,
        position=_point(bridge.position),
    )


def percentile(values: list[float], share: float) -> float:
    """Of sorted values; NaN when there are none."""
    return values[min(len(values) - 1, int(share * len(values)))] if values else NAN


def link_status(bridge: Bridge, rate: float) -> LinkStatus:
    """Everything but the stamp. rate: telemetry frames per second of controller time."""
    link, sender, t = bridge.link, bridge.link.sender, bridge.link.telemetry
    trips = sorted(link.round_trips)
    msg = LinkStatus(connected=link.ready, telemetry_rate=rate)
    msg.lines_sent, msg.resends = sender.lines_sent, sender.resends
    msg.lines_acknowledged = sender.acknowledged
    msg.bad_frames, msg.telemetry_received, msg.telemetry_lost = (
        link.bad_frames,
        link.received,
        link.lost,
    )
    msg.round_trip_p50, msg.round_trip_p99 = percentile(trips, 0.5), percentile(trips, 0.99)
    clock = link.clock
    msg.clock_offset, msg.clock_drift, msg.clock_residual = (
        clock.offset,
        clock.drift,
        clock.residual,
    )
    msg.clock_synchronised = clock.synchronised
    msg.blocks_free, msg.bytes_free = (t.free_blocks if t else 0), max(0, min(sender.room, 65535))
    msg.segments_queued, msg.underruns = sender.unsent, t.underruns if t else 0
    msg.reconnects = max(0, link.connects - 1)
    return msg


def diagnostic_values(bridge: Bridge, status: LinkStatus, port: str) -> dict[str, object]:
    """What /diagnostics shows of the link: state, rates, round trips, what was lost or sent again, buffers, clock."""
    return {
        'port': port,
        'state': CONTROLLER_STATES[bridge.state],
        'fault': bridge.fault_text or 'none',
        'telemetry_hz': f'{status.telemetry_rate:.1f}',
        'telemetry_lost': status.telemetry_lost,
        'lines_sent': status.lines_sent,
        'resends': status.resends,
        'bad_frames': status.bad_frames,
        'reconnects': status.reconnects,
        'round_trip_p50_ms': f'{status.round_trip_p50 * 1e3:.2f}',
        'round_trip_p99_ms': f'{status.round_trip_p99 * 1e3:.2f}',
        'underruns': status.underruns,
        'blocks_free': status.blocks_free,
        'bytes_free': status.bytes_free,
        'segments_queued': status.segments_queued,
        'clock_drift_ppm': f'{status.clock_drift * 1e6:.1f}',
        'clock_residual_ms': f'{status.clock_residual * 1e3:.3f}',
    }


def acceleration(batch: Batch, ros_ns: int) -> AccelerationBatch:
    """ros_ns: ROS time of the first sample."""
    msg = AccelerationBatch(sensor_id=SENSOR, sequence=batch.sequence % 2**32)
    msg.header = Header(stamp=stamp_ns(ros_ns), frame_id='machine')
    msg.sample_rate, msg.range = batch.rate, RANGE
    msg.x, msg.y, msg.z = (array('f', v.astype('f4').tobytes()) for v in batch.values.T)
    return msg
