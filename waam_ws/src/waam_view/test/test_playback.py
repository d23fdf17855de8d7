"""A record becomes the same view as the live dashboard: whole or torn anywhere."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from waam_msgs.msg import JobStatus
from waam_record.salvage import messages
from waam_view import blueprint as bp
from waam_view.ros_playback import Playback, build, record_files
from waam_view.scene import Scene
from waam_view.viewer import ViewError

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_cell import Cell  # noqa: E402
from synthetic_job import write_job  # noqa: E402
from test_drawing import entities  # noqa: E402


class Recording:
    """Takes what the synthetic cell publishes and writes it as the recorder does: small zstd chunks."""

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self.writer = Writer(str(file), chunk_size=4096, compression=CompressionType.ZSTD)
        self.writer.start('ros2')
        self.channels: dict[str, int] = {}
        self.count = 0

    def create_publisher(self, kind: type, topic: str, _qos):
        schema = self.writer.register_schema(kind.__name__, 'ros2msg', b'')
        self.channels[topic] = self.writer.register_channel('/' + topic, 'cdr', schema)
        outer = self

        class Publisher:
            def publish(self, message) -> None:
                data = serialize_message(message)
                outer.writer.add_message(outer.channels[topic], outer.count, data, outer.count)
                outer.count += 1

        return Publisher()

    def close(self) -> None:
        self.writer.finish()


def play(cell: Cell, folder: Path, frames: int = 200) -> None:
    cell.status(0.0, JobStatus.SCANNING, str(folder))
    cell.height_map(0.1, 0)
    cell.plan(1.0, 1)
    cell.correction(1.1, 1)
    cell.events(1.2)
    cell.status(1.3, JobStatus.DEPOSITING, str(folder), 1)
    for i in range(frames):
        cell.telemetry(2.0 + i * 0.05)
        if i % 10 == 0:
            cell.slow(2.0 + i * 0.05)
    cell.height_map(60.0, 1)
    cell.status(61.0, JobStatus.DONE, str(folder), 1)


@pytest.fixture(scope='module')
def job(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('job')
    write_job(folder / 'as_written', layers=1)
    (folder / 'as_written/layers').rename(folder / 'layers')
    recording = Recording(folder / 'record/record_0.mcap')
    play(Cell(recording), folder)
    recording.close()
    return folder


EVERYTHING = {
    bp.SURFACE, bp.PLAN, f'{bp.PATH}/layer_001/0001', bp.TORCH, bp.ERROR, bp.PSI, bp.CONFIDENCE, bp.CURRENT,
    bp.VOLTAGE, bp.FEED, bp.TRAVEL, bp.TEMPERATURE, bp.LIMIT, bp.HEAT_FACTOR, bp.MACHINE, bp.JOB, bp.LAYER,
    bp.RMS, bp.STATUS, bp.LOG, bp.ALARMS,
}  # fmt: skip


def test_a_record_shows_everything_that_the_dashboard_shows(job, tmp_path):
    assert build(job, tmp_path / 'x.rrd') > 100
    found = entities(tmp_path / 'x.rrd')
    assert found >= EVERYTHING, EVERYTHING - found


class Counting(Scene):
    """Counts telemetry instead of drawing it."""

    def __init__(self) -> None:
        super().__init__(6e-4)
        self.samples = 0

    def telemetry(self, samples) -> None:
        self.samples += len(samples)


def test_a_torn_record_shows_what_is_whole(job, tmp_path):
    data = (job / 'record/record_0.mcap').read_bytes()
    counts = []
    for share in range(0, 101, 4):
        torn = tmp_path / 'torn.mcap'
        torn.write_bytes(data[: len(data) * share // 100])
        playback = Playback(Counting())
        for channel, _, message in messages(torn, []):
            playback.message(channel.topic[1:], message.data)
        playback.flush()
        counts.append(playback.scene.samples)
    assert counts == sorted(counts) and counts[0] == 0
    assert counts[-1] > 50 and any(0 < c < counts[-1] for c in counts)


def test_what_cannot_be_shown_is_said(tmp_path):
    with pytest.raises(ViewError, match='no .mcap'):
        build(tmp_path, tmp_path / 'x.rrd')
    recording = Recording(tmp_path / 'record_0.mcap')
    recording.close()
    with pytest.raises(ViewError, match='nothing of a job'):
        build(tmp_path, tmp_path / 'x.rrd')


def test_files_of_a_split_record_come_in_order(tmp_path):
    for n in (10, 2, 0, 1):
        (tmp_path / f'record_{n}.mcap').touch()
    assert [f.stem for f in record_files(tmp_path)] == ['record_0', 'record_1', 'record_2', 'record_10']  # fmt: skip
