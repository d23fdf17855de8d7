"""`waam view` of records: one job, or several side by side."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import rerun as rr

from waam_node import job_folder

from . import blueprint as bp
from .ros_playback import first_stamp, play, record_files
from .scene import Scene
from .viewer import ViewError

ERROR_RANGE = 0.6e-3  # m
Progress = Callable[[int], None] | None


def record_of(path: Path) -> tuple[list[Path], Path | None]:
    """(MCAP files, folder of the job or None) of a job, a record folder or one file. Raises ViewError."""
    path = Path(path).resolve()
    files = [path] if path.is_file() else record_files(path)
    if not files or any(f.suffix != '.mcap' for f in files):
        raise ViewError(f'{path}: no .mcap there')
    folder = (
        files[0].parent.parent if job_folder.is_record(files[0].parent.name) else files[0].parent
    )
    return files, folder if (folder / job_folder.MAPS).is_dir() else None


def size(paths: list[Path]) -> int:
    """Bytes of all records, for a progress bar."""
    return sum(f.stat().st_size for p in paths for f in record_of(p)[0])


def build(path: Path, rrd: Path, progress: Progress = None) -> int:
    """One record into a file for the viewer, with our layout. Returns messages drawn. Raises ViewError."""
    files, folder = record_of(path)
    scene = Scene(ERROR_RANGE)
    scene.new_job()
    scene.record(rrd)
    drawn = play(files, scene, folder, progress)
    scene.close()
    if not drawn:
        raise ViewError(f'{path}: nothing of a job is recorded there')
    return drawn


def build_comparison(paths: list[Path], rrd: Path, progress: Progress = None) -> int:
    """Several jobs into one file, each in its column, on time since the start of the job. Raises ViewError."""
    names = {f'job_{i}/': _title(p) for i, p in enumerate(paths, 1)}
    recording = rr.RecordingStream('waam', recording_id='comparison')
    layout = bp.side_by_side(names, ERROR_RANGE)
    recording.set_sinks(rr.FileSink(str(rrd)), default_blueprint=layout)
    drawn = 0
    for prefix, path in zip(names, paths, strict=True):
        files, folder = record_of(path)
        zero = first_stamp(files)
        if zero is None:
            raise ViewError(f'{path}: no telemetry is recorded there')
        scene = Scene(ERROR_RANGE, prefix, zero)
        scene.add('both', recording)
        drawn += play(files, scene, folder, progress)
    recording.flush()
    recording.disconnect()
    return drawn


def _title(path: Path) -> str:
    files, folder = record_of(path)
    return (folder or files[0].parent).name
