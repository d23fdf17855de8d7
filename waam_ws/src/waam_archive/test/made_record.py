"""Writes a recording of a small job with the recorder's own writer: what the nodes publish, without nodes."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Temperature

from waam_msgs.msg import (
    Anomaly,
    HeightMap,
    JobStatus,
    LayerPlan,
    LayerReport,
    ProfileBatch,
    Segment,
    Telemetry,
)
from waam_node import cdr
from waam_record.bag_writer import BagWriter, Topic
from waam_record.definitions import ament_prefixes, full_text
from waam_record.log_column import QOS

T0 = 1_700_000_000.0
KINDS = {
    'job_status': JobStatus, 'layer_report': LayerReport, 'anomaly': Anomaly, 'layer_plan': LayerPlan,
    'height_map': HeightMap, 'temperature': Temperature, 'telemetry': Telemetry, 'profiles': ProfileBatch,
}  # fmt: skip


def stamped(message: Any, t: float, /, **fields: Any) -> Any:
    message.header.stamp.sec, message.header.stamp.nanosec = int(t), int(t % 1 * 1e9)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def messages(job: str, seconds: int, profiles: int) -> Iterator[tuple[str, float, bytes]]:
    """(topic, time, bytes): one layer of two beads along x, the arc on in between; `profiles` points per 0.1 s."""
    names = {'job_id': job, 'loop_mode': 'closed_loop'}
    yield (
        'job_status',
        T0,
        pack(stamped(JobStatus(), T0, **names, material='er70s-6', state=6, layer=1)),
    )
    segments = [segment(n) for n in (1, 2)]
    yield 'layer_plan', T0, pack(stamped(LayerPlan(), T0, job_id=job, layer=1, segments=segments))
    yield 'height_map', T0, pack(height_map(job, 0, 0.0))
    yield 'temperature', T0, pack(stamped(Temperature(), T0, temperature=150.0))
    rng = np.random.default_rng(1)
    for n in range(seconds * 100):
        t = T0 + 0.01 * n
        yield 'telemetry', t, frame(n, t, seconds)
        if profiles and n % 10 == 0:
            yield 'profiles', t, batch(rng, profiles)
    end = T0 + seconds
    report = {
        'layer': 1,
        'arc_starts': 2,
        'current_mean': 180.0,
        'arc_on_time': 8.0,
        'wire_used': 0.7,
        'energy': 31680.0,
    }
    yield 'layer_report', end, pack(stamped(LayerReport(), end, **names, **report))
    last = {'layer': 1, 'final': True, 'height_error_rms': 1.2e-4}
    yield 'layer_report', end, pack(stamped(LayerReport(), end, **names, **last))
    words = {'severity': 1, 'class_name': 'arc', 'text': 'lit twice', 'reaction': 'retry'}
    yield 'anomaly', end, pack(stamped(Anomaly(), end, job_id=job, layer=1, **words))
    yield 'height_map', end, pack(height_map(job, 1, 1e-3))
    yield (
        'job_status',
        end,
        pack(
            stamped(JobStatus(), end, **names, material='er70s-6', state=9, layer=1, message='done')
        ),
    )


pack = serialize_message


def batch(rng: np.random.Generator, points: int) -> bytes:
    """Profiles that do not compress, like those of a real scanner."""
    x, z = rng.normal(size=(2, points)).astype(np.float32)
    return pack(
        ProfileBatch(profile_count=1, points_per_profile=points, x=array('f', x), z=array('f', z))
    )


def segment(bead: int) -> Segment:
    s = Segment(index=bead, layer=1, bead=bead, kind=1, arc=True)
    s.start.x, s.end.x = 0.0, 0.04
    s.start.y = s.end.y = 4e-3 * bead
    return s


def height_map(job: str, layer: int, z: float) -> HeightMap:
    m = stamped(HeightMap(), T0, job_id=job, layer=layer, scan_id=layer)
    m.grid.rows, m.grid.cols, m.grid.resolution = 3, 4, 1e-3
    m.z = m.sigma = array('f', [z] * 12)
    m.count = array('H', [1] * 12)
    return m


def frame(n: int, t: float, seconds: int) -> bytes:
    """The torch goes along bead 2 in the first half and along bead 1 in the second; the arc is off in between."""
    half = seconds * 50
    phase = n % half / half
    arc = 0.1 < phase < 0.9
    fields = cdr.TelemetryFields(
        controller_us=n * 10_000, boot_id=1, sequence=n, state=1, x=0.04 * phase, y=4e-3 * (2 if n < half else 1),
        z=0.0, travel_speed=0.01, wire_feed_commanded=0.08, wire_feed_speed=0.08, arc_current=180.0 * arc,
        arc_voltage=22.0 * arc, arc_enabled=arc, arc_established=arc, gas=True, wire_feed=1,
        line_accepted=n, line_executed=n, blocks_free=10, speed_override=1.0, wire_override=1.0, lease_left=1.0,
        underruns=0, fault=0,
    )  # fmt: skip
    return cdr.pack_telemetry(int(t * 1e9), fields)


def make_record(
    folder: Path,
    job: str = '20260201T000000Z_jaw',
    seconds: int = 10,
    profiles: int = 0,
    custom: dict | None = None,
    old_names: bool = False,
) -> Path:
    """A folder with one MCAP file and metadata.yaml. custom: its custom data; old_names: fields as of 0.2.0."""
    writer = BagWriter(folder, custom or {})
    known: dict[str, int] = {}
    for n, (topic, t, data) in enumerate(messages(job, seconds, profiles)):
        if topic not in known:
            kind = f'{KINDS[topic].__module__.split(".")[0]}/msg/{KINDS[topic].__name__}'
            definition = full_text(kind, ament_prefixes())
            if old_names:
                definition = definition.replace('string loop_mode', 'string profile')
            known[topic] = writer.add_topic(Topic(f'/{topic}', kind, definition, 'RIHS01_', [QOS]))
        writer.write(known[topic], int(t * 1e9), int(t * 1e9), n, data)
    writer.close()
    return folder
