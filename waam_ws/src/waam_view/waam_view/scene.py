"""Draws the state of the cell into rerun recordings. Runs in the drawing thread only; knows nothing
of ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from waam_process.grid import GridSpec

from . import blueprint as bp
from .surface import LayerPath, colours, mesh, picture

STATES = {0: 'IDLE', 1: 'RUN', 2: 'HOLD', 3: 'ALARM'}
LEVELS = {0: 'INFO', 1: 'WARN', 2: 'ERROR', 3: 'CRITICAL'}


@dataclass(frozen=True)
class Sample:
    """One telemetry frame; t in ns of ROS time, position (3,) m, SI."""

    t: int
    position: tuple[float, float, float]
    speed: float
    feed_commanded: float
    feed: float
    current: float
    voltage: float
    state: int
    arc: bool


@dataclass(frozen=True)
class MapData:
    """A height map; t in ns of ROS time; z (rows, cols) m, NaN = unknown."""

    t: int
    spec: GridSpec
    z: np.ndarray


@dataclass(frozen=True)
class CorrectionData:
    """psi, confidence: (rows, cols)."""

    t: int
    layer: int
    psi: np.ndarray
    confidence: np.ndarray


class Scene:
    """Everything drawn goes to all `recordings` (live viewer, file of the job)."""

    def __init__(self, error_range_m: float) -> None:
        self.recordings: dict[str, rr.RecordingStream] = {}
        self.error_range = error_range_m
        self._path: LayerPath | None = None
        self._laid: dict[int, list[tuple[float, float, float]]] = {}
        self._states: dict[str, str] = {}
        self._span: tuple[int, int] | None = None

    def add(self, name: str, recording: rr.RecordingStream) -> None:
        self.recordings[name] = recording
        bp.log_styles(recording)

    def remove(self, name: str) -> None:
        """Flushes and closes a recording; its file is complete afterwards."""
        recording = self.recordings.pop(name, None)
        if recording is not None:
            if (
                name == 'file' and self._span is not None
            ):  # whoever opens the file sees the whole job
                recording.send_blueprint(bp.blueprint(self.error_range, whole_ns=self._span))
            recording.flush()
            recording.disconnect()

    def new_job(self) -> None:
        """Nothing of the last part stays in view."""
        self.remove('file')
        for live in self.recordings.values():
            live.log('part', rr.Clear(recursive=True))
            live.log('maps', rr.Clear(recursive=True))
        self._laid.clear()
        self._states.clear()
        self._path = self._span = None

    def record(self, file: Path) -> None:
        """Everything from now on also goes into a file, until `remove('file')`."""
        recording = rr.RecordingStream('waam', recording_id=file.parent.name)
        recording.set_sinks(
            rr.FileSink(str(file)), default_blueprint=bp.blueprint(self.error_range)
        )
        self.add('file', recording)

    def _log(self, t: int, entity: str, what: rr.AsComponents) -> None:
        self._span = (
            (t, t) if self._span is None else (min(self._span[0], t), max(self._span[1], t))
        )
        for recording in self.recordings.values():
            recording.set_time(bp.TIMELINE, timestamp=np.datetime64(t, 'ns'))
            recording.log(entity, what)

    def telemetry(self, samples: list[Sample]) -> None:
        """A batch of frames: curves in one call per entity, torch and path of the newest."""
        if not samples:
            return
        times = np.array([s.t for s in samples], 'datetime64[ns]')
        path = self._path
        planned = [path.planned_speed(s.position) if path and s.arc else math.nan for s in samples]
        columns = {
            bp.CURRENT: [[s.current] for s in samples],
            bp.VOLTAGE: [[s.voltage] for s in samples],
            bp.FEED: [[s.feed_commanded * 60, s.feed * 60] for s in samples],
            bp.TRAVEL: [[p * 1e3, s.speed * 1e3] for p, s in zip(planned, samples, strict=True)],
        }
        for recording in self.recordings.values():
            for entity, values in columns.items():
                _send(recording, entity, times, np.array(values))
        last = samples[-1]
        colour = (255, 140, 40) if last.arc else (120, 170, 220)
        self._log(last.t, bp.TORCH, rr.Points3D([last.position], radii=0.0012, colors=[colour]))
        self.state(last.t, bp.MACHINE, STATES.get(last.state, str(last.state)))
        self._draw_laid(samples)

    def _draw_laid(self, samples: list[Sample]) -> None:
        points = [s.position for s in samples if s.arc]
        if points:
            layer = self._path.layer if self._path else 0
            laid = self._laid.setdefault(layer, [])
            laid += points
            strip = rr.LineStrips3D([np.array(laid)], radii=0.0004, colors=[(255, 140, 40)])
            self._log(samples[-1].t, f'{bp.PATH}/layer_{layer:03d}', strip)

    def plan(self, t: int, path: LayerPath) -> None:
        """Segments of the next layer; a plan without deposition (a scan) is left out."""
        if not len(path.start):
            return
        self._path = path
        strips = np.stack([path.start, path.end], 1)
        self._log(t, bp.PLAN, rr.LineStrips3D(strips, radii=0.0002, colors=[(90, 200, 120)]))

    def height_map(self, data: MapData) -> None:
        """Surface coloured by height."""
        low, high = np.nanpercentile(data.z, [1, 99]) if np.isfinite(data.z).any() else (0.0, 1.0)
        self._draw_surface(data, colours(data.z, low, high, diverging=False))

    def error_map(self, data: MapData, error: np.ndarray) -> None:
        """error (rows, cols) m, NaN where nothing is wanted: as a map, and as colour of the surface."""
        reach = self.error_range
        self._log(data.t, bp.ERROR, rr.Image(picture(error, -reach, reach)))
        low, high = np.nanpercentile(data.z, [1, 99]) if np.isfinite(data.z).any() else (0.0, 1.0)
        judged = np.isfinite(error)[..., None]
        by_height = colours(data.z, low, high, diverging=False)
        self._draw_surface(data, np.where(judged, colours(error, -reach, reach), by_height))

    def _draw_surface(self, data: MapData, rgb: np.ndarray) -> None:
        m = mesh(data.spec, data.z, rgb)
        if len(m.triangles):
            shape = rr.Mesh3D(
                vertex_positions=m.vertices,
                vertex_normals=m.normals,
                triangle_indices=m.triangles,
                vertex_colors=m.colours,
            )
            self._log(data.t, bp.SURFACE, shape)

    def correction(self, data: CorrectionData) -> None:
        self._log(data.t, bp.PSI, rr.Image(picture(data.psi, -1.0, 1.0)))
        self._log(
            data.t, bp.CONFIDENCE, rr.Image(picture(data.confidence, 0.0, 1.0, diverging=False))
        )

    def scalar(self, t: int, entity: str, *values: float) -> None:
        """One value per curve of the entity; not drawn unless all are finite."""
        if all(math.isfinite(v) for v in values):
            self._log(t, entity, rr.Scalars(values))

    def state(self, t: int, entity: str, name: str) -> None:
        """Logged when it changes."""
        if self._states.get(entity) != name:
            self._states[entity] = name
            self._log(t, entity, rr.StateChange(state=name))

    def text(self, t: int, severity: int, text: str) -> None:
        self._log(t, bp.LOG, rr.TextLog(text, level=LEVELS.get(severity, 'INFO')))

    def status(self, t: int, markdown: str) -> None:
        self._log(t, bp.STATUS, rr.TextDocument(markdown, media_type='text/markdown'))

    def close(self) -> None:
        for name in list(self.recordings):
            self.remove(name)


def _send(
    recording: rr.RecordingStream, entity: str, times: np.ndarray, values: np.ndarray
) -> None:
    recording.send_columns(
        entity,
        indexes=[rr.TimeColumn(bp.TIMELINE, timestamp=times)],
        columns=rr.Scalars.columns(scalars=values.ravel()).partition(
            np.full(len(values), values.shape[1])
        ),
    )
