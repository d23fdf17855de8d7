"""Lines and states of the core -> messages."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from sensor_msgs.msg import Range

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
from waam_node.conversions import stamp_ns, to_msg
from waam_process.names import CONTROLLER_STATES
from waam_process.units import mm

from . import frames
from .acceleration import RANGE, SENSOR
from .core import Bridge
from .frames import ARC_ENABLED, ARC_ESTABLISHED, GAS, UNDERFEED
from .outbox import Batch, Notice
from .program import Mark

NAN = float('nan')
SENSOR_RANGE = {  # m that the controller takes for a distance
    Standoff.SOURCE_LASER: (0.005, 0.4), Standoff.SOURCE_INFRARED: (0.035, 0.4),
}  # fmt: skip


def wire_feed(flags: int, commanded_um_s: int, measured_um_s: int) -> int:
    """WIRE_FEED_* of a frame. A wheel that stands still is no sign of a normal feed: there may be none."""
    if flags & UNDERFEED:
        return Telemetry.WIRE_FEED_UNDERFEED
    moves = commanded_um_s > 0 and measured_um_s > 0
    return Telemetry.WIRE_FEED_NORMAL if moves else Telemetry.WIRE_FEED_UNKNOWN


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


def machine_state(bridge: Bridge, port: str, stamp: Time | None = None) -> MachineState:
    """What is known of the controller and of what may use it."""
    who, flags = bridge.link.identity, bridge.flags if bridge.connected else 0
    known: dict[str, Any] = {}
    if who:
        box = [mm(v) for v in who.limits_mm]
        known = {
            'identity': who.name, 'firmware_version': who.firmware, 'capabilities': who.capabilities,
            'boot_id': who.boot, 'limit_min': box[:3], 'limit_max': box[3:],
        }  # fmt: skip
    return to_msg(
        MachineState, stamp=stamp, frame='machine', port=port, connected=bridge.connected, state=bridge.state,
        homed=flags & frames.HOMED, armed=flags & frames.ARMED, arc_on=flags & frames.ARC_ENABLED,
        armed_job=bridge.armed_job, work_offset=bridge.offset, fault=bridge.fault, fault_text=bridge.fault_text,
        silent_nodes=bridge.silent, message=bridge.message, **known,
    )  # fmt: skip


def standoff(s: frames.Standoff, ros_ns: int) -> Standoff:
    """Lengths in m; the measured distance is NaN while it is not known. ros_ns: ROS time of the frame."""
    return to_msg(
        Standoff, stamp=stamp_ns(ros_ns), frame='torch_tcp', controller_us=s.t_us, source=s.source, known=s.known,
        alarm=min(s.alarm, 255), correction=s.correction_um * 1e-6, set_distance=s.set_um * 1e-6,
        measured_distance=s.measured_um * 1e-6 if s.known else NAN,
    )  # fmt: skip


def distance(s: frames.Standoff, ros_ns: int) -> Range | None:
    """The distance sensor for any ROS tool; None where the arc is the sensor. NaN = no reading (REP 117)."""
    if s.source not in SENSOR_RANGE:
        return None
    low, high = SENSOR_RANGE[s.source]
    return to_msg(
        Range, stamp=stamp_ns(ros_ns), frame='standoff_sensor', radiation_type=Range.INFRARED, field_of_view=0.02,
        min_range=low, max_range=high, range=s.measured_um * 1e-6 if s.known else NAN,
    )  # fmt: skip


def segment_done(mark: Mark, stamp: Time) -> SegmentDone:
    """The message for a segment that the controller has executed."""
    return to_msg(SegmentDone, mark, stamp=stamp, frame='work')


def anomaly(bridge: Bridge, notice: Notice, stamp: Time | None = None) -> Anomaly:
    """Layer and bead are those of the segment that is being executed."""
    mark = bridge.running
    layer, bead = (mark.layer, mark.bead) if mark else (0, 0)
    return to_msg(
        Anomaly, notice, stamp=stamp, frame='work', job_id=bridge.job, layer=layer, bead=bead, position=bridge.position
    )  # fmt: skip


def percentile(values: list[float], share: float) -> float:
    """Of sorted values; NaN when there are none."""
    return values[min(len(values) - 1, int(share * len(values)))] if values else NAN


def link_status(bridge: Bridge, rate: float, stamp: Time) -> LinkStatus:
    """rate: telemetry frames per second of controller time."""
    link, sender, t = bridge.link, bridge.link.sender, bridge.link.telemetry
    clock, trips = link.clock, sorted(link.round_trips)
    return to_msg(
        LinkStatus, stamp=stamp, connected=link.ready, telemetry_rate=rate, lines_sent=sender.lines_sent,
        resends=sender.resends, lines_acknowledged=sender.acknowledged, bad_frames=link.bad_frames,
        telemetry_received=link.received, telemetry_lost=link.lost, round_trip_p50=percentile(trips, 0.5),
        round_trip_p99=percentile(trips, 0.99), clock_offset=clock.offset, clock_drift=clock.drift,
        clock_residual=clock.residual, clock_synchronised=clock.synchronised, blocks_free=t.free_blocks if t else 0,
        bytes_free=max(0, min(sender.room, 65535)), segments_queued=sender.unsent,
        underruns=t.underruns if t else 0, reconnects=max(0, link.connects - 1),
    )  # fmt: skip


def diagnostic_values(bridge: Bridge, status: LinkStatus, port: str) -> dict[str, object]:
    """What /diagnostics shows of the link: state, rates, round trips, what was lost or sent again, buffers, clock."""
    part = bridge.temperature.says
    return {
        **({'part_temperature': part} if part else {}),
        **({'gantry': bridge.gantry.problem} if bridge.gantry.problem else {}),
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
    x, y, z = batch.values.T
    return to_msg(
        AccelerationBatch, stamp=stamp_ns(ros_ns), frame='machine', sensor_id=SENSOR, sequence=batch.sequence % 2**32,
        sample_rate=batch.rate, range=RANGE, x=x, y=y, z=z,
    )  # fmt: skip
