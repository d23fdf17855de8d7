"""A plan as a rerun recording: surfaces, beads layer by layer, idle moves, arc starts. Knows nothing of ROS."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from . import blueprint as bp
from .plan_file import PlanFile, Run, read_plan
from .surface import colours, mesh

MAX_POINTS = 300_000  # drawn; longer programs are thinned out
PIECE = 200  # points that appear at once on the timeline of the program
ROD = 0.365  # half the distance of neighbouring beads over their width: the lines of a layer can be told apart
STEPS = 16  # colours of a scale
IDLE, START = (120, 150, 190), (240, 70, 190)
FOUND, NOMINAL = (122, 128, 136), (90, 170, 120, 70)


def write_recording(plan_file: Path | str, target: Path | str) -> PlanFile:
    """plan.npz into a file for the viewer, whole or not at all. Raises PlanFileError."""
    plan = read_plan(plan_file)
    own = Path(target).with_name(f'.{os.getpid()}_{Path(target).name}')
    try:
        _write(plan, own, Path(target).parent.resolve().name)
        os.replace(own, target)
    finally:
        own.unlink(missing_ok=True)
    return plan


def _write(plan: PlanFile, file: Path, recording_id: str) -> None:
    recording = rr.RecordingStream('waam plan', recording_id=f'{recording_id}/{plan.name}')
    layout = bp.plan_blueprint(_highest(plan) * 1e3, _fastest(plan) * 1e3)
    recording.set_sinks(rr.FileSink(str(file)), default_blueprint=layout)
    recording.log('part', rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log(
        bp.PLAN_TEXT, rr.TextDocument(summary(plan), media_type='text/markdown'), static=True
    )
    for entity, title in ((bp.PLAN_SPEED, 'travel, mm/s'), (bp.PLAN_HEIGHT, 'metal, mm')):
        recording.log(entity, rr.SeriesLines(names=[title]), static=True)
    _draw_surfaces(recording, plan)
    every = max(1, -(-sum(len(r.height) for r in plan.runs) // MAX_POINTS))
    for run in plan.runs:
        _draw_run(recording, plan, run.thinned(every))
    _draw_means(recording, plan)
    recording.flush()
    recording.disconnect()


def _draw_surfaces(recording: rr.RecordingStream, plan: PlanFile) -> None:
    for entity, z, colour in ((bp.FOUND, plan.found, FOUND), (bp.NOMINAL, plan.nominal, NOMINAL)):
        m = mesh(plan.spec, z, np.broadcast_to(np.array(colour[:3], np.uint8), (*z.shape, 3)))
        if len(m.triangles):
            shape = rr.Mesh3D(
                vertex_positions=m.vertices,
                vertex_normals=m.normals,
                triangle_indices=m.triangles,
                albedo_factor=colour,
            )
            recording.log(entity, shape, static=True)


def _at(recording: rr.RecordingStream, layer: int, seconds: float) -> None:
    recording.set_time(bp.LAYERS, sequence=layer)
    recording.set_time(bp.PROGRAM_TIME, duration=seconds)


def _draw_run(recording: rr.RecordingStream, plan: PlanFile, run: Run) -> None:
    """A run appears piece by piece as it is laid; its arc start with its first point."""
    if run.arc:
        _at(recording, run.layer, float(run.times[0]))
        radius = 0.6 * run.width  # stands out of the bead
        recording.log(bp.STARTS, rr.Points3D([run.points[0]], radii=radius, colors=[START]))
        _draw_curves(recording, run)
    for a in range(0, len(run.height), PIECE):
        b = min(a + PIECE, len(run.height))
        points = run.points[a : b + 1]
        if np.ptp(points, axis=0).max() <= 0:
            continue
        _at(recording, run.layer, float(run.times[b]))
        if run.arc:
            _draw_beads(recording, bp.BEADS_METAL, points, run.height[a:b], _highest(plan), run)
            _draw_beads(recording, bp.BEADS_SPEED, points, run.speed[a:b], _fastest(plan), run)
        else:
            recording.log(bp.IDLE, rr.LineStrips3D([points], radii=0.0002, colors=[IDLE]))


def _draw_beads(
    recording: rr.RecordingStream,
    entity: str,
    points: np.ndarray,
    values: np.ndarray,
    top: float,
    run: Run,
) -> None:
    """Strips as wide as a bead is where the next one begins, one for every stretch of one colour."""
    steps = (np.clip(values / top, 0.0, 1.0) * (STEPS - 1)).round().astype(int)
    pieces = list(_equal(steps))
    strips = [points[a : b + 1] for a, b in pieces]
    rgb = colours(np.array([steps[a] for a, _ in pieces], float), 0, STEPS - 1, diverging=False)
    recording.log(entity, rr.LineStrips3D(strips, radii=ROD * run.width, colors=rgb))


def _equal(steps: np.ndarray) -> Iterator[tuple[int, int]]:
    """(first, last + 1) of stretches of equal numbers."""
    edges = [0, *(np.flatnonzero(np.diff(steps)) + 1).tolist(), len(steps)]
    return zip(edges, edges[1:], strict=False)


def _draw_curves(recording: rr.RecordingStream, run: Run) -> None:
    """Speed and metal of every segment, and a gap after the run: seen on the timeline of the program."""
    column = rr.TimeColumn(bp.PROGRAM_TIME, duration=run.times)
    for entity, values in ((bp.PLAN_SPEED, run.speed), (bp.PLAN_HEIGHT, run.height)):
        scalars = rr.Scalars.columns(scalars=np.append(values * 1e3, np.nan))
        recording.send_columns(entity, indexes=[column], columns=scalars)


def _draw_means(recording: rr.RecordingStream, plan: PlanFile) -> None:
    """The same curves, one value a layer: seen on the timeline of the layers."""
    totals = layer_totals(plan)
    column = rr.TimeColumn(bp.LAYERS, sequence=[t.layer for t in totals])
    for entity, values in (
        (bp.PLAN_SPEED, [t.speed for t in totals]),
        (bp.PLAN_HEIGHT, [t.height for t in totals]),
    ):
        scalars = rr.Scalars.columns(scalars=np.array(values) * 1e3)
        recording.send_columns(entity, indexes=[column], columns=scalars)


def _highest(plan: PlanFile) -> float:
    """Thickest metal of a bead, m."""
    return max((float(r.height.max()) for r in plan.beads), default=1e-3)


def _fastest(plan: PlanFile) -> float:
    """Fastest travel with the arc on, m/s."""
    return max((float(r.speed.max()) for r in plan.beads), default=1e-3)


@dataclass(frozen=True)
class LayerTotal:
    """length m and burning s with the arc on; means over the length: speed m/s, height of the metal m."""

    layer: int
    starts: int
    length: float
    burning: float
    speed: float
    height: float


def layer_totals(plan: PlanFile) -> list[LayerTotal]:
    """One for every layer with metal, in their order."""
    by_layer: dict[int, list[Run]] = {}
    for run in plan.beads:
        by_layer.setdefault(run.layer, []).append(run)
    return [_total(layer, runs) for layer, runs in sorted(by_layer.items())]


def _total(layer: int, runs: list[Run]) -> LayerTotal:
    steps = np.concatenate([np.linalg.norm(np.diff(r.points, axis=0), axis=1) for r in runs])
    speed = np.concatenate([r.speed for r in runs])
    height = np.concatenate([r.height for r in runs])
    length = max(float(steps.sum()), 1e-9)
    burning = sum(float(r.times[-1] - r.times[0]) for r in runs)
    means = (float(steps @ values) / length for values in (speed, height))
    return LayerTotal(layer, len(runs), length, burning, *means)


def summary(plan: PlanFile) -> str:
    """Text beside the picture, Markdown."""
    head = [
        f'# {plan.name}',
        f'{plan.mode}, {plan.layers} layers, {len(plan.beads)} arc starts, '
        f'{plan.duration / 60:.1f} min without cooling and scans',
        '',
        *(f'- **{text}**' for text in plan.warnings or ['no warnings']),
        '',
        '| layer | arc starts | bead m | arc s | metal mm |',
        '|---|---|---|---|---|',
    ]
    rows = [
        f'| {t.layer} | {t.starts} | {t.length:.2f} | {t.burning:.0f} | {t.height * 1e3:.2f} |'
        for t in layer_totals(plan)
    ]
    return '\n'.join([*head, *rows])
