"""Draws the state of the cell into rerun recordings. Runs in the drawing thread only; knows nothing
of ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from waam_process.grid import GridSpec
from waam_process.names import controller_state
from waam_process.unrolled import Unrolled

from . import blueprint as bp
from .recordings import APPLICATION, end, release, send_layout
from .surface import LayerPath, colours, mesh, picture
from .worst_places import LayerError

LEVELS = {0: 'INFO', 1: 'WARN', 2: 'ERROR', 3: 'CRITICAL'}
# What goes into a file together: the library keeps some kB of every chunk in memory until it is closed.
FILE_TICK, FILE_BYTES = timedelta(seconds=5), 8 << 20  # rows of an entity
FILE_SAMPLES = 600  # telemetry frames
MARK = (255, 0, 255)  # of the worst places: no colour of a map
SEAM = 0.03  # m between two samples with the arc on: over the seam of an unrolled shaft
PIECE = 300  # points of the executed path in one entity: what is drawn again with every batch stays small


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
    speed_override: float = 1.0


@dataclass(frozen=True)
class MapData:
    """A height map; t in ns of ROS time; z (rows, cols) m, NaN = unknown."""

    t: int
    spec: GridSpec
    z: np.ndarray


@dataclass(frozen=True)
class CorrectionData:
    """A correction map, as it is drawn."""

    t: int  # ns, ROS time
    layer: int
    psi: np.ndarray  # (rows, cols) -1..1
    confidence: np.ndarray  # (rows, cols) 0..1


class Scene:
    """Everything drawn goes to all `recordings` (live viewer, file of the job)."""

    def __init__(self, error_range_m: float) -> None:
        self.recordings: dict[str, rr.RecordingStream] = {}
        self.error_range = error_range_m
        self.shaft: Unrolled | None = None  # that turns: drawn unrolled, its first turn
        self._path: LayerPath | None = None
        self._laid: list[tuple[float, float, float]] = []
        self._piece = 0
        self._layer = 0
        self._held: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []  # curves for the file
        self._states: dict[str, str] = {}
        self._span: tuple[int, int] | None = None

    def add(self, name: str, recording: rr.RecordingStream) -> None:
        """Draws into this recording, too, from now on; 'file' is that of the job."""
        self.recordings[name] = recording
        bp.log_styles(recording)

    def remove(self, name: str) -> None:
        """Flushes and closes a recording; its file is complete afterwards."""
        recording = self.recordings.pop(name, None)
        if recording is None:
            return
        if name == 'file':
            self._write_held(recording)
            if self._span is not None:  # whoever opens the file sees the whole job
                send_layout(recording, bp.blueprint(self.error_range, whole_ns=self._span))
        end(recording)
        del recording
        release()

    def new_job(self) -> None:
        """Clears everything of the last part."""
        self.remove('file')
        for live in self.recordings.values():
            live.log('part', rr.Clear(recursive=True))
            live.log('maps', rr.Clear(recursive=True))
        self._laid.clear()
        self._states.clear()
        self._path = self._span = None
        self._piece = self._layer = 0

    def record(self, file: Path) -> None:
        """Everything from now on also goes into a file, until `remove('file')`."""
        batches = rr.ChunkBatcherConfig(flush_tick=FILE_TICK, flush_num_bytes=FILE_BYTES)
        recording = rr.RecordingStream(
            APPLICATION, recording_id=file.parent.name, batcher_config=batches
        )
        recording.set_sinks(rr.FileSink(str(file)))
        send_layout(recording, bp.blueprint(self.error_range), active=False)
        self.add('file', recording)

    def log(self, t: int, entity: str, what: rr.AsComponents) -> None:
        """At t, ns of ROS time, into every recording."""
        self._span = (
            (t, t) if self._span is None else (min(self._span[0], t), max(self._span[1], t))
        )
        for recording in self.recordings.values():
            self._set_time(recording, t)
            recording.log(entity, what)

    def _set_time(self, recording: rr.RecordingStream, t: int) -> None:
        """ROS time and the layer."""
        recording.set_time(bp.TIMELINE, timestamp=np.datetime64(t, 'ns'))
        recording.set_time(bp.LAYERS, sequence=self._layer)

    def layer(self, t: int, number: int) -> None:
        """From now on everything belongs to this layer (0 = before the first)."""
        self._layer = number
        self.state(t, bp.LAYER, f'layer {number}' if number else 'as found')

    def telemetry(self, samples: list[Sample]) -> None:
        """A batch of frames: curves in one call per entity, torch and path of the newest."""
        if not samples:
            return
        samples = [self._shown(s) for s in samples]
        times = np.array([s.t for s in samples], np.int64)
        path = self._path
        planned = [
            path.planned_speed(s.position) * s.speed_override if path and s.arc else math.nan
            for s in samples
        ]
        curves = {
            bp.CURRENT: [[s.current] for s in samples],
            bp.VOLTAGE: [[s.voltage] for s in samples],
            bp.FEED: [[s.feed_commanded * 60, s.feed * 60] for s in samples],
            bp.TRAVEL: [[p * 1e3, s.speed * 1e3] for p, s in zip(planned, samples, strict=True)],
        }
        self._draw_curves(times, {entity: np.array(v) for entity, v in curves.items()})
        last = samples[-1]
        colour = (255, 140, 40) if last.arc else (120, 170, 220)
        self.log(last.t, bp.TORCH, rr.Points3D([last.position], radii=0.0012, colors=[colour]))
        self.state(last.t, bp.MACHINE, controller_state(last.state))
        self._draw_laid(samples)

    def _shown(self, sample: Sample) -> Sample:
        """Where the maps show it."""
        if self.shaft is None:
            return sample
        x, y, z = sample.position
        return replace(sample, position=(float(self.shaft.folded(x)), y, z))

    def _draw_curves(self, times: np.ndarray, curves: dict[str, np.ndarray]) -> None:
        """curves by entity, (n, curves): at once to viewers, in larger parts to a file."""
        for name, recording in self.recordings.items():
            if name != 'file':
                self._send(recording, times, curves)
        if 'file' in self.recordings:
            self._held.append((times, curves))
            if sum(len(t) for t, _ in self._held) >= FILE_SAMPLES:
                self._write_held(self.recordings['file'])

    def _write_held(self, file: rr.RecordingStream) -> None:
        held, self._held = self._held, []
        if held:
            times = np.concatenate([t for t, _ in held])
            curves = {e: np.concatenate([c[e] for _, c in held]) for e in held[0][1]}
            self._send(file, times, curves)

    def _draw_laid(self, samples: list[Sample]) -> None:
        """The path that was welded, in pieces of one layer; only the newest piece grows."""
        points = [s.position for s in samples if s.arc]
        if not points:
            return
        for point in points:
            if self.shaft and self._laid and abs(point[0] - self._laid[-1][0]) > SEAM:
                self._draw_piece(samples[-1].t)
                self._begin_piece(keep=0)
            self._laid.append(point)
        self._draw_piece(samples[-1].t)
        if len(self._laid) >= PIECE:
            self._begin_piece(keep=1)

    def _draw_piece(self, t: int) -> None:
        layer = self._path.layer if self._path else 0
        strip = rr.LineStrips3D([np.array(self._laid)], radii=0.0004, colors=[(255, 140, 40)])
        self.log(t, f'{bp.PATH}/layer_{layer:03d}/{self._piece:04d}', strip)

    def _begin_piece(self, keep: int) -> None:
        del self._laid[: len(self._laid) - keep]
        self._piece += 1

    def plan(self, t: int, path: LayerPath) -> None:
        """Segments of the next layer; a plan without deposition (a scan) is left out."""
        if not len(path.start):
            return
        self._path = path
        self._begin_piece(keep=0)
        strips = np.stack([path.start, path.end], 1)
        self.log(t, bp.PLAN, rr.LineStrips3D(strips, radii=0.0002, colors=[(90, 200, 120)]))

    def height_map(self, data: MapData) -> None:
        """Surface coloured by height."""
        low, high = np.nanpercentile(data.z, [1, 99]) if np.isfinite(data.z).any() else (0.0, 1.0)
        self._draw_surface(data, colours(data.z, low, high, diverging=False))

    def error_map(self, data: MapData, after: LayerError) -> None:
        """The error as a map and as colour of the surface, the worst places on both and in the log."""
        reach, error = self.error_range, after.error
        self.log(data.t, bp.ERROR, rr.Image(picture(error, -reach, reach)))
        low, high = np.nanpercentile(data.z, [1, 99]) if np.isfinite(data.z).any() else (0.0, 1.0)
        judged = np.isfinite(error)[..., None]
        by_height = colours(data.z, low, high, diverging=False)
        self._draw_surface(data, np.where(judged, colours(error, -reach, reach), by_height))
        self._draw_places(data, after)

    def _draw_places(self, data: MapData, after: LayerError) -> None:
        """Points with their error; the log has the worst one in words."""
        spec, places = data.spec, after.places
        if not places:
            return
        labels = [f'{k}: {p.value_mm:+.2f} mm' for k, p in enumerate(places, 1)]
        at = np.array([(p.x_mm, p.y_mm, p.z_mm) for p in places]) * 1e-3
        pixels = (at[:, :2] - (spec.origin_x, spec.origin_y)) / spec.resolution
        pixels[:, 1] = spec.rows - pixels[:, 1]  # y up
        marks: dict[str, Any] = {'colors': [MARK], 'labels': labels, 'show_labels': True}
        self.log(
            data.t, bp.ERROR_PLACES, rr.Points2D(pixels, radii=rr.Radius.ui_points(5), **marks)
        )
        self.log(data.t, bp.PLACES, rr.Points3D(at, radii=rr.Radius.ui_points(5), **marks))
        beyond = after.share_beyond(self.error_range)
        more = (
            f'; {beyond:.0%} of the judged area is beyond ±{self.error_range * 1e3:g} mm'
            if beyond
            else ''
        )
        self.text(data.t, 0, f'worst place: {places[0].words()}{more}')

    def _draw_surface(self, data: MapData, rgb: np.ndarray) -> None:
        m = mesh(data.spec, data.z, rgb)
        if len(m.triangles):
            shape = rr.Mesh3D(
                vertex_positions=m.vertices,
                vertex_normals=m.normals,
                triangle_indices=m.triangles,
                vertex_colors=m.colours,
            )
            self.log(data.t, bp.SURFACE, shape)

    def correction(self, data: CorrectionData) -> None:
        """Psi from -1 to 1 and confidence from 0 to 1 as pictures."""
        self.log(data.t, bp.PSI, rr.Image(picture(data.psi, -1.0, 1.0)))
        self.log(
            data.t, bp.CONFIDENCE, rr.Image(picture(data.confidence, 0.0, 1.0, diverging=False))
        )

    def scalar(self, t: int, entity: str, *values: float) -> None:
        """One value per curve of the entity; not drawn unless all are finite."""
        if all(math.isfinite(v) for v in values):
            self.log(t, entity, rr.Scalars(values))

    def state(self, t: int, entity: str, name: str) -> None:
        """Logged when it changes."""
        if self._states.get(entity) != name:
            self._states[entity] = name
            self.log(t, entity, rr.StateChange(state=name))

    def text(self, t: int, severity: int, text: str) -> None:
        """A line in the log, or among the alarms when severity is above INFO (0). t: ns of ROS time."""
        entry = rr.TextLog(text, level=LEVELS.get(severity, 'INFO'))
        self.log(t, bp.ALARMS if severity else bp.LOG, entry)

    def status(self, t: int, markdown: str) -> None:
        """Replaces the text panel. t: ns of ROS time."""
        self.log(t, bp.STATUS, rr.TextDocument(markdown, media_type='text/markdown'))

    def close(self) -> None:
        """Removes all recordings; their files are complete afterwards."""
        for name in list(self.recordings):
            self.remove(name)

    def _send(
        self, recording: rr.RecordingStream, times: np.ndarray, curves: dict[str, np.ndarray]
    ) -> None:
        """times (n,) ns, curves by entity, (n, curves)."""
        column = rr.TimeColumn(bp.TIMELINE, timestamp=times.astype('datetime64[ns]'))
        for entity, values in curves.items():
            rows = np.full(len(values), values.shape[1])
            scalars = rr.Scalars.columns(scalars=values.ravel()).partition(rows)
            recording.send_columns(entity, indexes=[column], columns=scalars)
