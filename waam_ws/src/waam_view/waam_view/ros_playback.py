"""A recorded job (MCAP) into the scene, finished or torn. Only what is drawn is decoded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rclpy.serialization import deserialize_message

from waam_node import job_folder
from waam_record.salvage import messages

from . import conversions as cv
from .job_data import shaft_in
from .scene import Sample, Scene
from .viewer import ViewError
from .worst_places import error_after

BATCH = 50
ERROR_RANGE = 0.6e-3  # m
Progress = Callable[[int], None]


class Playback:
    """Draws messages as the live dashboard does; the error maps come from the folder of the job."""

    def __init__(self, scene: Scene, folder: Path | None = None) -> None:
        self.scene, self.folder = scene, folder
        self.drawn = 0
        self._samples: list[Sample] = []
        self._thinned = cv.Samples()
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
                after = error_after(self.folder, msg.layer, measured.spec, measured.z)
                if after is not None:
                    self.scene.error_map(measured, after)
            self.drawn += 1

    def flush(self) -> None:
        """Draws the telemetry that waits."""
        self.scene.telemetry(self._samples)
        self._samples = []

    def _telemetry(self, raw: bytes) -> None:
        if sample := self._thinned.of(raw):
            self._samples.append(sample)
            self.drawn += 1
            if len(self._samples) >= BATCH:
                self.flush()


def record_files(folder: Path) -> list[Path]:
    """The MCAP files of a job (all its runs) or of a record folder, in the order of writing."""
    files = [f for run in job_folder.record_folders(folder) for f in _in_order(run)]
    return files or _in_order(folder)


def _in_order(folder: Path) -> list[Path]:
    return sorted(folder.glob('*.mcap'), key=lambda f: (len(f.stem), f.stem))


def record_of(path: Path) -> tuple[list[Path], Path | None]:
    """(MCAP files, folder of the job or None) of a job, a record folder or one file. Raises ViewError."""
    path = Path(path).resolve()
    files = [path] if path.is_file() else record_files(path)
    if not files or any(f.suffix != '.mcap' for f in files):
        raise ViewError(f'{path}: no .mcap there')
    folder = files[0].parent
    folder = folder.parent if job_folder.is_record(folder.name) else folder
    return files, folder if (folder / job_folder.MAPS).is_dir() else None


def size(path: Path) -> int:
    """Bytes of the record, for a progress bar."""
    return sum(f.stat().st_size for f in record_of(path)[0])


def build(path: Path, rrd: Path, progress: Progress = lambda n: None) -> int:
    """A record into a file for the viewer, with our layout; progress gets bytes. Returns how many messages were drawn.
    Raises ViewError."""
    files, folder = record_of(path)
    scene = Scene(ERROR_RANGE)
    scene.new_job()
    scene.shaft = shaft_in(folder) if folder else None
    scene.record(rrd)
    playback = Playback(scene, folder)
    for file in files:
        for channel, _, message in messages(file, []):
            playback.message(channel.topic.rpartition('/')[2], message.data)
            progress(len(message.data))
    playback.flush()
    scene.close()
    if not playback.drawn:
        raise ViewError(f'{path}: nothing of a job is recorded there')
    return playback.drawn
