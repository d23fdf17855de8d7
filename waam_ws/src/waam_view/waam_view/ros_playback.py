"""A recorded job (MCAP) into the scene: finished, torn, or still being written. Only what is drawn is decoded."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Temperature

from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    HeatFactor,
    HeightMap,
    JobStatus,
    LayerPlan,
    LayerReport,
    MachineState,
    Telemetry,
)
from waam_node import cdr, job_folder
from waam_node.conversions import nanoseconds
from waam_process.names import job_state
from waam_record.salvage import BROKEN

from . import blueprint as bp
from . import conversions as cv
from .job_data import error_after
from .scene import Scene

TYPES = {
    'height_map': HeightMap, 'correction_map': CorrectionMap, 'layer_plan': LayerPlan, 'heat_factor': HeatFactor,
    'temperature': Temperature, 'job_status': JobStatus, 'layer_report': LayerReport, 'machine_state': MachineState,
    'anomaly': Anomaly,
}  # fmt: skip
PERIOD_NS = 100_000_000  # of telemetry
BATCH = 50
LARGEST = 1 << 30  # bytes of one record


class Growing:
    """A file that somebody still writes: `read` waits for what is missing until `ended` is true."""

    def __init__(self, stream: BinaryIO, ended: Callable[[], bool], poll: float = 0.2) -> None:
        self._stream, self._ended, self._poll = stream, ended, poll

    def read(self, size: int = -1) -> bytes:
        """Up to `size` bytes, fewer only at the end of a file that is complete; -1: what is there."""
        data = self._stream.read(size)
        while size > 0 and len(data) < size:
            over = self._ended()  # before reading: what was written until then is still read
            more = self._stream.read(size - len(data))
            if over and not more:
                break
            data += more
            if not more:
                time.sleep(self._poll)
        return data

    def readable(self) -> bool:
        """As of io.RawIOBase."""
        return True

    def seekable(self) -> bool:
        """False: what was read does not come again."""
        return False

    def tell(self) -> int:
        """Bytes from the beginning of the file."""
        return self._stream.tell()


def messages(file: Path, follow: Callable[[], bool] | None = None) -> Iterator[tuple[str, bytes]]:
    """(topic without '/', serialized message) in the order of writing, up to the end or the tear of a file.

    follow: returns True when nothing more will be written; None = the file is complete.
    """
    topics: dict[int, str] = {}
    with open(file, 'rb') as raw:
        stream: Any = Growing(raw, follow) if follow else raw
        try:
            for record in StreamReader(stream, record_size_limit=LARGEST).records:
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
        self._errors = (0.0, 0.0)
        self._texts: dict[str, str] = {}

    def message(self, topic: str, raw: bytes) -> None:
        """One recorded message; unknown topics are ignored. Raises what a broken message raises."""
        if topic == 'telemetry':
            self._telemetry(raw)
        elif topic in TYPES:
            self.flush()
            msg = deserialize_message(raw, TYPES[topic])
            getattr(self, f'_on_{topic}')(nanoseconds(msg.header.stamp), msg)
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

    def _on_height_map(self, _t: int, msg: HeightMap) -> None:
        measured = cv.map_data(msg)
        self.scene.height_map(measured)
        if self.folder is None:
            return
        error = error_after(self.folder, msg.layer, measured.spec, measured.z)
        if error is not None:
            self.scene.error_map(measured, error)

    def _on_correction_map(self, _t: int, msg: CorrectionMap) -> None:
        self.scene.correction(cv.correction_data(msg))

    def _on_layer_plan(self, t: int, msg: LayerPlan) -> None:
        self.scene.plan(t, cv.layer_path(msg))

    def _on_heat_factor(self, t: int, msg: HeatFactor) -> None:
        self.scene.scalar(t, bp.HEAT_FACTOR, 100 * msg.factor)
        self.scene.scalar(t, bp.LIMIT, msg.interpass_limit)

    def _on_temperature(self, t: int, msg: Temperature) -> None:
        self.scene.scalar(t, bp.TEMPERATURE, msg.temperature)

    def _on_job_status(self, t: int, msg: JobStatus) -> None:
        self.scene.layer(t, msg.layer)
        self.scene.state(t, bp.JOB, job_state(msg.state))
        self.scene.status(t, cv.status_text(msg))
        errors = (msg.height_error_rms * 1e3, msg.height_error_max * 1e3)
        if errors != self._errors:
            self._errors = errors
            self.scene.scalar(t, bp.RMS, *errors)

    def _on_layer_report(self, t: int, msg: LayerReport) -> None:
        self.scene.text(t, 0, cv.report_text(msg))

    def _on_machine_state(self, t: int, msg: MachineState) -> None:
        if msg.message and msg.message != self._texts.get('machine'):
            self.scene.text(t, 2 if msg.fault else 0, f'machine: {msg.message}')
        self._texts['machine'] = msg.message

    def _on_anomaly(self, t: int, msg: Anomaly) -> None:
        self.scene.text(t, msg.severity, cv.anomaly_text(msg))


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


def follow(folder: Path, scene: Scene, ended: Callable[[], bool], poll: float = 0.2) -> int:
    """Live tail: draws a record while it is written, file after file, until `ended`. Returns messages drawn."""
    playback = Playback(scene, folder)
    done: set[Path] = set()

    def left(file: Path) -> bool:
        return ended() or any(f not in done and f != file for f in record_files(folder))

    while True:
        over = ended()
        waiting = [f for f in record_files(folder) if f not in done]
        if not waiting and over:
            break
        for file in waiting[:1]:
            done.add(file)
            for topic, raw in messages(file, partial(left, file)):
                playback.message(topic, raw)
            playback.flush()
        if not waiting:
            time.sleep(poll)
    return playback.drawn
