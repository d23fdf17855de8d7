"""A recorded job (MCAP) into the scene, finished or torn. Only what is drawn is decoded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from rclpy.serialization import deserialize_message

from waam_msgs.msg import Telemetry
from waam_node import cdr, job_folder
from waam_record.salvage import BROKEN

from . import conversions as cv
from .job_data import error_after
from .scene import Scene

PERIOD_NS = 100_000_000  # of telemetry
BATCH = 50
MAX_RECORD_BYTES = 1 << 30  # bytes of one record


def messages(file: Path) -> Iterator[tuple[str, bytes]]:
    """(topic without '/', serialized message) in the order of writing, up to the end or the tear of a file."""
    topics: dict[int, str] = {}
    with open(file, 'rb') as stream:
        try:
            for record in StreamReader(stream, record_size_limit=MAX_RECORD_BYTES).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic.rsplit('/', 1)[-1]
                elif isinstance(record, Message):
                    yield topics.get(record.channel_id, ''), record.data
        except BROKEN:  # everything intact has been returned
            return


class Playback:
    """Draws messages as the live dashboard does; the error maps come from the folder of the job."""

    def __init__(self, scene: Scene, folder: Path | None = None) -> None:
        self.scene, self.folder = scene, folder
        self.drawn = 0
        self._samples: list[Any] = []
        self._next_ns = 0
        self._drawing = cv.MessageDrawing()

    def message(self, topic: str, raw: bytes) -> None:
        """One recorded message; unknown topics are ignored. Raises what a broken message raises."""
        if topic == 'telemetry':
            self._telemetry(raw)
        elif topic in cv.TYPES:
            self.flush()
            msg = deserialize_message(raw, cv.TYPES[topic])
            self._drawing.of(topic, msg)(self.scene)
            if topic == 'height_map' and self.folder is not None:
                measured = cv.map_data(msg)
                error = error_after(self.folder, msg.layer, measured.spec, measured.z)
                if error is not None:
                    self.scene.error_map(measured, error)
            self.drawn += 1

    def flush(self) -> None:
        """Draws the telemetry that waits."""
        self.scene.telemetry(self._samples)
        self._samples = []

    def _telemetry(self, raw: bytes) -> None:
        t = cdr.stamp_ns(raw)
        if t >= self._next_ns or t < self._next_ns - 2 * PERIOD_NS:
            self._next_ns = t + PERIOD_NS
            self._samples.append(cv.sample(deserialize_message(raw, Telemetry)))
            self.drawn += 1
            if len(self._samples) >= BATCH:
                self.flush()


def record_files(folder: Path) -> list[Path]:
    """The MCAP files of a job (all its runs) or of a record folder, in the order of writing."""
    files = [f for run in job_folder.record_folders(folder) for f in _in_order(run)]
    return files or _in_order(folder)


def _in_order(folder: Path) -> list[Path]:
    return sorted(folder.glob('*.mcap'), key=lambda f: (len(f.stem), f.stem))


def play(files: list[Path], scene: Scene, folder: Path | None, progress: Any = None) -> int:
    """Draws complete files; returns how many messages were drawn."""
    playback = Playback(scene, folder)
    for file in files:
        for topic, raw in messages(file):
            playback.message(topic, raw)
            if progress is not None:
                progress(len(raw))
    playback.flush()
    return playback.drawn


def first_stamp(files: list[Path]) -> int | None:
    """ns of the first telemetry frame, None without any."""
    for file in files:
        for topic, raw in messages(file):
            if topic == 'telemetry':
                return cdr.stamp_ns(raw)
    return None
