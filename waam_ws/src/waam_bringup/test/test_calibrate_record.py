"""The wire's telemetry in a recording, as `waam calibrate lead --record` reads it."""

from __future__ import annotations

import pytest

from waam_bringup.calibrate import wire
from waam_calibrate.evidence import EvidenceError
from waam_node import cdr
from waam_record.bag_writer import BagWriter, Topic
from waam_record.definitions import ament_prefixes, full_text
from waam_record.log_column import QOS

FRAMES = [  # boot, controller time in us, commanded, measured in mm/s, burns
    (1, 900_000, 10, 9, False),
    (2, 10_000, 80, 79, True),
    (2, 30_000, 90, 88, True),
    (2, 20_000, 85, 84, True),  # came late
    (2, 30_000, 90, 88, True),  # came twice
]


def frame(boot: int, us: int, commanded: int, measured: int, burns: bool) -> bytes:
    fields = dict.fromkeys(cdr.TelemetryFields._fields, 0)
    fields |= {'controller_us': us, 'boot_id': boot, 'arc_enabled': burns, 'gas': burns}
    fields |= {'wire_feed_commanded': 1e-3 * commanded, 'wire_feed_speed': 1e-3 * measured}
    fields['arc_established'] = burns
    return cdr.pack_telemetry(us * 1000, tuple(fields.values()))


def written(folder, frames: list[bytes]):
    writer, kind = BagWriter(folder, {}), 'waam_msgs/msg/Telemetry'
    text = full_text(kind, ament_prefixes())
    topic = writer.add_topic(Topic('/telemetry', kind, text, 'RIHS01_', [QOS]))
    for n, data in enumerate(frames):
        writer.write(topic, n, n, n, data)
    writer.close()
    return folder


def test_frames_of_the_last_boot_in_the_order_of_the_controller(tmp_path) -> None:
    folder = written(tmp_path / 'job' / 'record', [frame(*f) for f in FRAMES])
    for path in (tmp_path / 'job', folder, next(folder.glob('*.mcap'))):
        found = wire(path)
        assert found.time == pytest.approx([0.01, 0.02, 0.03])
        assert found.commanded == pytest.approx([0.08, 0.085, 0.09])
        assert found.measured == pytest.approx([0.079, 0.084, 0.088])
        assert found.burns.all()


def test_without_telemetry_there_is_no_evidence(tmp_path) -> None:
    empty = written(tmp_path / 'record', [])
    broken = written(tmp_path / 'broken', [frame(*FRAMES[0])[:40]])
    for path in (empty, broken, tmp_path / 'nothing'):
        with pytest.raises(EvidenceError, match=str(path)):
            wire(path)
