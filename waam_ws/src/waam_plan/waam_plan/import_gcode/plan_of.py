"""A program of others as a plan: its own path and setpoints, in the layers that a job lays, corrects and scans."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from waam_plan import masks
from waam_plan.import_gcode import targets
from waam_plan.import_gcode.layers import Bead, Layer, layers_of
from waam_plan.import_gcode.level_metal import RATIO_HIGH, levelled
from waam_plan.import_gcode.motion import Motion, Program
from waam_plan.import_gcode.place import check_machine
from waam_plan.import_gcode.regime import doubts
from waam_plan.import_gcode.way import Metal, check_way
from waam_plan.layers.travel import Ceiling, connected
from waam_plan.plan import (
    Plan,
    PlanError,
    PlannedLayer,
    collector_paused,
    hop,
    idle,
    leg,
    numbered,
)
from waam_plan.settings import JUDGED_RIM, PlanSettings
from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Point, Segment


def plan_program(
    program: Program,
    settings: PlanSettings,
    found: HeightGrid,
    nominal: HeightGrid | None = None,
    *,
    layers: int = 0,
    mode: str = 'build',
    level: bool = False,
) -> Plan:
    """The plan whose path with the arc on is that of the program, within motion.CHORD, and whose base feed is its wire.

    found: what the program is laid on, in a build the plate at 0. nominal: the wanted surface on the same grid; without
    it the layers of the program say what is wanted. layers: at most so many from the bottom; 0 = all. level: the metal
    of each layer is shared out along its path so that it comes out level, in place of the program's own wire. Raises
    PlanError or ProgramError.
    """
    kept = layers_of(program)[: layers or None]
    spec, base = found.spec, targets.found_surface(found, settings, mode)
    with collector_paused():
        runs = [[_run(b, layer.number, program, settings) for b in layer.beads] for layer in kept]
        covers = [
            targets.cover_of(_points(r, spec), spec, reach)
            for r, reach in zip(runs, _reaches(kept, runs, settings), strict=True)
        ]
        _check_ground(covers, kept, base)
        _check_thickness(covers, kept)
        top = None if nominal is None else nominal.z
        last = _last(covers, runs, spec, settings)
        wanted = targets.targets_of(covers, base, top, settings, last)
        settings = _fitted(settings, wanted)
        runs = [_with_metal(r, t, spec) for r, t in zip(runs, wanted, strict=True)]
        if level:
            runs = [levelled(r, t, spec, settings) for r, t in zip(runs, wanted, strict=True)]
        planned = _layers(kept, runs, wanted, program, base, spec, settings)
    region = targets.judged_region(wanted, top)
    if not region.any():
        what = 'nothing is missing' if nominal is None else 'the nominal part does not end'
        raise PlanError(f'{program.name}: {what} where it lays metal')
    plan = _assembled(
        program, planned, found, base, nominal, region, settings, mode=mode, level=level
    )
    check_machine(program, [s for layer in planned for s in layer.segments], settings)
    return plan


def _fitted(settings: PlanSettings, wanted: list[targets.Target]) -> PlanSettings:
    """With the layer height of the program, and without what would change its path."""
    means = [float(np.median(t.planned[t.footprint])) for t in wanted if t.footprint.any()]
    height = float(np.clip(np.median(means), 0.3e-3, 5e-3)) if means else settings.layer_height
    return replace(settings, layer_height=height, lead_on=0.0, lead_off=0.0, bead_time=0.0)


# ---- beads -----------------------------------------------------------------------------------


def _run(bead: Bead, number: int, program: Program, settings: PlanSettings) -> list[Segment]:
    """Deposits and waits of one bead; bead numbers follow. Height 0 where the program does not say the wire."""
    out: list[Segment] = []
    for m in bead.motions:
        if m.dwell:
            out.append(_wait(m, number, settings, arc=True))
        else:
            out += _deposits(m, number, program, settings)
    return out


def _wait(m: Motion, number: int, settings: PlanSettings, arc: bool) -> Segment:
    feed = m.wire if arc and math.isfinite(m.wire) else 0.0
    volts = (m.voltage or settings.voltage) if arc else 0.0
    return Segment(
        0, Kind.DWELL, m.start, m.start, settings.idle_speed, layer=number, arc=arc, dwell=m.dwell,
        wire_feed_speed=feed, voltage=volts,
    )  # fmt: skip


def _deposits(m: Motion, number: int, program: Program, settings: PlanSettings) -> list[Segment]:
    """Straight pieces of at most segment_length. Their metal is what the wire leaves behind (eq 2.15)."""
    feed = m.wire
    if program.wire_diameter:
        feed *= (program.wire_diameter / settings.wire_diameter) ** 2
    metal = feed * settings.wire_area * settings.efficiency / m.speed
    height = metal / (AREA_FACTOR * settings.bead_width) if math.isfinite(metal) else 0.0
    first = Segment(
        0, Kind.DEPOSIT, m.start, m.end, m.speed, layer=number, arc=True, height=height,
        width=settings.bead_width, speed_programmed=m.speed,
        wire_feed_speed=feed if height else 0.0, voltage=m.voltage or settings.voltage,
    )  # fmt: skip
    corners = [tuple(c) for c in _divided(m.corners(), settings.segment_length).tolist()]
    corners[0], corners[-1] = m.start, m.end
    return [first.at(start=a, end=b) for a, b in zip(corners, corners[1:], strict=False)]


def _divided(corners: np.ndarray, longest: float) -> np.ndarray:
    """(n, 3) corners of the same path with no piece above `longest` (m)."""
    pieces = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    counts = np.maximum(1, np.ceil(pieces / longest - 1e-9)).astype(int)
    if (counts == 1).all():
        return corners
    first = np.repeat(np.arange(len(counts)), counts)
    at = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (at / counts[first])[:, None]
    inner = corners[first] + share * (corners[first + 1] - corners[first])
    return np.vstack([inner, corners[-1:]])


def _points(runs: list[list[Segment]], spec: GridSpec) -> np.ndarray:
    """(n, 3) along the beads of a layer, half a cell apart."""
    ends = [(s.start, s.end) for run in runs for s in run if s.kind == Kind.DEPOSIT]
    return np.vstack([_divided(np.array(e), spec.resolution / 2) for e in ends])


def _reaches(
    layers: list[Layer], runs: list[list[list[Segment]]], settings: PlanSettings
) -> list[float]:
    """How far the metal of each layer lies beside its path (m), so that it is as thick as the layer: between a quarter
    and half of a bead."""
    z = [layer.z for layer in layers]
    steps = [b - a for a, b in zip(z, z[1:], strict=False)]
    out = []
    for step, beads in zip([*steps, steps[-1] if steps else 0.0], runs, strict=True):
        deposits = [s for run in beads for s in run if s.kind == Kind.DEPOSIT]
        metal = sum(AREA_FACTOR * s.width * s.height * s.length for s in deposits)
        section = metal / sum(s.length for s in deposits)
        wide = section / (2 * step) if section > 0 and step > 0 else 0.5 * settings.pitch
        out.append(float(np.clip(wide, 0.25 * settings.bead_width, 0.5 * settings.bead_width)))
    return out


def _last(
    covers: list[targets.Cover],
    runs: list[list[list[Segment]]],
    spec: GridSpec,
    settings: PlanSettings,
) -> float:
    """Thickness (m) of the last layer by its metal; that of the one below where the program does not say the wire."""
    metal = sum(AREA_FACTOR * s.width * s.height * s.length for run in runs[-1] for s in run)
    if metal > 0:
        cells = max(1, int(covers[-1].footprint.sum()))
        return metal / (cells * spec.resolution**2)
    if len(covers) > 1:
        return targets.thickness(covers[-2], covers[-1])
    return settings.layer_height


def _with_metal(
    runs: list[list[Segment]], wanted: targets.Target, spec: GridSpec
) -> list[list[Segment]]:
    """Where the program does not say the wire, every bead gets an even share of the metal of its layer."""
    bare = [s for run in runs for s in run if s.kind == Kind.DEPOSIT and s.height == 0]
    if not bare:
        return runs
    metal = float(wanted.planned.sum()) * spec.resolution**2
    section = metal / sum(s.length for s in bare)
    height = section / (AREA_FACTOR * bare[0].width)
    return [
        [s.at(height=height) if s.kind == Kind.DEPOSIT and s.height == 0 else s for s in run]
        for run in runs
    ]


def _check_ground(covers: list[targets.Cover], layers: list[Layer], base: np.ndarray) -> None:
    """The lowest layer lies on what is there. PlanError with its line."""
    off = (covers[0].ground - base)[covers[0].footprint]
    off = off[np.isfinite(off)]
    line = layers[0].beads[0].line
    if not off.size:
        raise PlanError(f'line {line}: the first layer lies beside everything that was scanned')
    if abs(middle := float(np.median(off))) > targets.OFF_GROUND:
        raise PlanError(
            f'line {line}: the first layer runs {abs(middle) * 1e3:.1f} mm '
            f'{"above" if middle > 0 else "below"} the surface that it is laid on; shift the program or choose a '
            'dialect that takes its z otherwise (key `height`)'
        )


def _check_thickness(covers: list[targets.Cover], layers: list[Layer]) -> None:
    """A layer over another one is thick enough to be one of metal. PlanError with its line."""
    for lower, upper, layer in zip(covers, covers[1:], layers[1:], strict=False):
        both = lower.footprint & upper.footprint
        if both.sum() <= 0.5 * min(lower.footprint.sum(), upper.footprint.sum()):
            continue  # beside it
        step = targets.thickness(lower, upper)
        if step < targets.MIN_THICKNESS:
            raise PlanError(
                f'line {layer.beads[0].line}: layer {layer.number} lies {step * 1e3:.2f} mm above the one before; a '
                f'layer of metal is at least {targets.MIN_THICKNESS * 1e3:.1f} mm thick'
            )


# ---- layers ----------------------------------------------------------------------------------


def _layers(
    kept: list[Layer],
    runs: list[list[list[Segment]]],
    wanted: list[targets.Target],
    program: Program,
    base: np.ndarray,
    spec: GridSpec,
    settings: PlanSettings,
) -> list[PlannedLayer]:
    """Layers that lay something, with the moves between their beads."""
    tops = [np.nanmax(t.after) for t in wanted if t.footprint.any()]
    top = max([float(np.nanmax(base)), *map(float, tops)])
    safe_z = top + settings.clearance
    metal = Metal.on(spec, base)
    out, below = [], base
    for layer, beads, target in zip(kept, runs, wanted, strict=True):
        below = np.where(target.footprint, target.after, below)
        numbered_runs = _numbered_beads(beads)
        if program.idle == 'lift':
            ceiling = Ceiling.over(spec, below, settings.torch_radius)
            segments = connected(numbered_runs, layer.number, ceiling, safe_z, settings)
        else:
            check_way(layer, numbered_runs, metal, settings)
            segments = _with_ways(layer, numbered_runs, safe_z, settings)
        out.append(
            PlannedLayer(
                number=layer.number,
                planned=target.planned,
                target_before=target.before,
                target_after=target.after,
                segments=segments,
                direction=_direction(segments),
                footprint=target.footprint,
            )
        )
    return out


def _numbered_beads(runs: list[list[Segment]]) -> list[list[Segment]]:
    return [[s.at(bead=i) for s in run] for i, run in enumerate(runs, 1)]


def _with_ways(
    layer: Layer, runs: list[list[Segment]], safe_z: float, settings: PlanSettings
) -> list[Segment]:
    """The beads with the program's own moves between them; before the first and after the last those of a job, which
    scans there. Where the program leaves the work frame in between (G28, G53), the way is a hop."""
    number = layer.number
    start, end = runs[0][0].start, runs[-1][-1].end
    out = leg((*start[:2], safe_z), start, settings, number) + runs[0]
    for bead, run in zip(layer.beads[1:], runs[1:], strict=True):
        out += _way(bead, out[-1].end, run[0].start, number, safe_z, settings) + run
    return numbered([*out, *leg(end, (*end[:2], max(safe_z, end[2])), settings, number)])


def _way(
    bead: Bead, start: Point, end: Point, number: int, safe_z: float, settings: PlanSettings
) -> list[Segment]:
    if any(math.isnan(v) for m in bead.way for v in (*m.start, *m.end)):
        return hop(start, end, safe_z, settings, number)
    out: list[Segment] = []
    for m in bead.way:
        if m.dwell:
            out.append(_wait(m, number, settings, arc=False))
            continue
        speed = settings.idle_speed if m.rapid else min(m.speed, settings.idle_speed)
        corners = list(map(tuple, m.corners().tolist()))
        corners[0], corners[-1] = m.start, m.end
        out += [
            idle(a, b, settings, number).at(speed=speed, speed_programmed=speed)
            for a, b in zip(corners, corners[1:], strict=False)
        ]
    return out


def _direction(segments: list[Segment]) -> Point:
    """Unit vector along which most of the path runs."""
    along = np.array([np.subtract(s.end, s.start)[:2] for s in segments if s.kind == Kind.DEPOSIT])
    angle, length = np.arctan2(along[:, 1], along[:, 0]), np.hypot(*along.T)
    turn = 0.5 * math.atan2(
        float((length * np.sin(2 * angle)).sum()), float((length * np.cos(2 * angle)).sum())
    )
    return math.cos(turn), math.sin(turn), 0.0


def _assembled(
    program: Program,
    planned: list[PlannedLayer],
    found: HeightGrid,
    base: np.ndarray,
    nominal: HeightGrid | None,
    region: np.ndarray,
    settings: PlanSettings,
    *,
    mode: str,
    level: bool,
) -> Plan:
    spec, res = found.spec, found.spec.resolution
    top = np.full(spec.shape, np.nan)
    for layer in planned:
        top = np.where(layer.footprint, layer.target_after, top)
    highest = max(float(np.nanmax(top)), float(np.nanmax(base)))
    starts = sum(p.arc_starts for p in planned)
    shared = ', its metal is shared out along it' if level else ''
    said = f'program {program.name}: {len(planned)} layers, {starts} beads; its path stays{shared}'
    return Plan(
        spec,
        HeightGrid(spec, base),
        nominal or HeightGrid(spec, top),
        region,
        masks.judged(region, JUDGED_RIM / res, settings.bead_width / res),
        planned,
        highest + settings.clearance,
        settings,
        mode=mode,
        name=program.name,
        warnings=[*program.warnings, *doubts(program), *_misfits(program, top, nominal)],
        remarks=[said, *program.remarks],
        ratio_high=RATIO_HIGH,
    )


def _misfits(program: Program, top: np.ndarray, nominal: HeightGrid | None) -> list[str]:
    """Where program and nominal part do not belong together."""
    if nominal is None:
        return []
    laid = np.isfinite(top)
    off = (top - nominal.z)[laid & np.isfinite(nominal.z)]
    beside = float((laid & ~np.isfinite(nominal.z)).sum() / max(1, laid.sum()))
    said = []
    if off.size and abs(float(np.median(off))) > 0.5e-3:
        said.append(
            f'{program.name} ends {np.median(off) * 1e3:+.1f} mm from the top of the nominal part (median)'
        )
    if beside > 0.25:
        said.append(f'{beside:.0%} of what {program.name} covers lies beside the nominal part')
    return said
