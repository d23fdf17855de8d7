"""The plan: layers with their maps and segments, totals, and the connection from wherever the torch is."""

from __future__ import annotations

import gc
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from waam_plan.harmonic import HarmonicLaw
from waam_plan.settings import PlanSettings
from waam_process.bead import AREA_FACTOR, wire_feed
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Point, Segment

UNLIKE = 0.03  # share by which the metal of the segments of a layer may differ from what is planned


class PlanError(ValueError):
    """A plan that cannot be made; the text says what, where and what to do."""


@dataclass(frozen=True)
class PlannedLayer:
    """One layer. Maps are (rows, cols) on the plan's grid, m."""

    number: int  # from 1, the lowest
    planned: np.ndarray  # metal to add, 0 outside the footprint
    target_before: np.ndarray  # surface wanted before this layer, NaN = do not care
    target_after: np.ndarray  # surface wanted after this layer, NaN = do not care
    segments: list[Segment]  # indices from 0; begin and end at the plan's safe height
    direction: Point  # unit vector of the beads
    footprint: np.ndarray  # bool, cells that get metal in this layer
    beside: float = 0.0  # m3 of metal beyond `planned`: over the sides, and in beads along the edge

    @property
    def deposits(self) -> list[Segment]:
        """Segments that lay metal, in the order in which they are laid."""
        return [s for s in self.segments if s.kind == Kind.DEPOSIT]

    @property
    def beads(self) -> int:
        """How many different beads the layer has; a bead may have several segments."""
        return len({s.bead for s in self.deposits})

    @property
    def arc_starts(self) -> int:
        """How often the arc is lit; fewer than beads where beads are linked with the arc on."""
        return len(self.arc_paths)

    @property
    def arc_paths(self) -> list[np.ndarray]:
        """(n, 2) x, y in m of every stretch from arc on to arc off, in the order they are laid."""
        paths: list[list[tuple[float, float]]] = []
        burning = False
        for s in self.segments:
            if s.arc and not burning:
                paths.append([(s.start[0], s.start[1])])
            if s.arc:
                paths[-1].append((s.end[0], s.end[1]))
            burning = s.arc
        return [np.array(p) for p in paths]

    @property
    def length(self) -> float:
        """Path with the arc on, m."""
        return sum(s.length for s in self.deposits)

    @property
    def arc_time(self) -> float:
        """s at programmed speed"""
        return sum(s.duration for s in self.deposits)

    @property
    def duration(self) -> float:
        """s without acceleration, from the first descent to the last lift"""
        return sum(s.duration for s in self.segments)

    @property
    def volume(self) -> float:
        """Metal that the segments add, m3 (eq 2.16: section = 0.73 * width * height)."""
        return sum(AREA_FACTOR * s.width * s.height * s.length for s in self.deposits)


def metal_of(layer: PlannedLayer, spec: GridSpec, settings: PlanSettings) -> float:
    """Metal (m3) that a layer is planned to have, with what lies over the sides; of a shaft, that of one turn on it."""
    planned, shaft = layer.planned, settings.unrolled
    if shaft:
        middle = np.nan_to_num(layer.target_after) - planned / 2
        planned = (planned * shaft.share(middle))[:, shaft.first_turn(spec)]
    return float(planned.sum() * spec.resolution**2 + layer.beside)


def laid_share(layer: PlannedLayer, spec: GridSpec, settings: PlanSettings) -> float:
    """Metal that the segments of a layer lay over what is planned for it; 1 where the limits of layer height change it
    by less than UNLIKE."""
    wanted = metal_of(layer, spec, settings)
    share = layer.volume / wanted if wanted > 0 else 1.0
    return share if abs(share - 1) > UNLIKE else 1.0


def base_feed(segment: Segment, settings: PlanSettings) -> float:
    """Wire feed speed (m/s) of a segment by eq 2.17, from the programmed speed."""
    return float(wire_feed(segment.width, segment.height, segment.speed_programmed, settings))


@dataclass(frozen=True)
class Plan:
    """A whole program in the work frame."""

    spec: GridSpec
    as_found: HeightGrid  # surface before the first layer, NaN where there is none
    nominal: HeightGrid  # wanted final surface, NaN outside the part
    region: np.ndarray  # bool, cells that get metal
    # bool, of the region what is judged: all but a rim, of thin walls the crown
    interior: np.ndarray
    layers: list[PlannedLayer]
    safe_z: float  # height of idle moves, m
    settings: PlanSettings
    mode: str = 'restore'
    name: str = 'part'
    offset: Point = (0.0, 0.0, 0.0)  # what was added to the part's coordinates, m
    warnings: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)  # what was chosen and why
    # relative layer height that a correction may ask for at most; 0 = the limits of the correction law
    ratio_high: float = 0.0

    @property
    def length(self) -> float:
        """Path with the arc on, m."""
        return sum(layer.length for layer in self.layers)

    @property
    def duration(self) -> float:
        """s at programmed speed, without acceleration, cooling and scans"""
        return sum(layer.duration for layer in self.layers)

    @property
    def arc_time(self) -> float:
        """s with the arc on"""
        return sum(layer.arc_time for layer in self.layers)

    @property
    def volume(self) -> float:
        """Metal added, m3."""
        return sum(layer.volume for layer in self.layers)

    @property
    def wire(self) -> float:
        """Wire melted, m: S_wire * length * efficiency = volume."""
        return self.volume / (self.settings.wire_area * self.settings.efficiency)

    @property
    def beads(self) -> int:
        """Sum over all layers."""
        return sum(layer.beads for layer in self.layers)

    @property
    def arc_starts(self) -> int:
        """Sum over all layers."""
        return sum(layer.arc_starts for layer in self.layers)

    @property
    def final_target(self) -> np.ndarray:
        """Surface that the planned layers end at, (rows, cols) m, NaN outside the region.

        Equals nominal plus allowance where all layers of a restoration are planned.
        """
        out = np.full(self.spec.shape, np.nan)
        for layer in self.layers:
            np.copyto(out, layer.target_after, where=np.isfinite(layer.target_after))
        return out

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the region, m."""
        rows, cols = (
            np.flatnonzero(self.region.any(axis=1)),
            np.flatnonzero(self.region.any(axis=0)),
        )
        if rows.size == 0:
            x0, x1, y0, y1 = self.spec.extent
            return x0, y0, x1, y1
        s = self.spec
        return (
            s.origin_x + cols[0] * s.resolution,
            s.origin_y + rows[0] * s.resolution,
            s.origin_x + (cols[-1] + 1) * s.resolution,
            s.origin_y + (rows[-1] + 1) * s.resolution,
        )


@contextmanager
def collector_paused() -> Iterator[None]:
    """Pauses the cyclic garbage collector: planning makes millions of small objects and no cycles."""
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


def highest(*surfaces: HeightGrid) -> float:
    """Highest known z of some surfaces, m; PlanError when nothing is known."""
    tops = [float(np.nanmax(s.z)) for s in surfaces if np.isfinite(s.z).any()]
    if not tops:
        raise PlanError('no height is known in any of the surfaces: scan first')
    return max(tops)


def idle(start: Point, end: Point, settings: PlanSettings, layer: int = 0) -> Segment:
    """A move with the arc off, index 0."""
    speed = settings.idle_speed
    return Segment(0, Kind.IDLE, start, end, speed, layer=layer, speed_programmed=speed)


def leg(start: Point, end: Point, settings: PlanSettings, layer: int = 0) -> list[Segment]:
    """A straight idle move from rest to rest: pieces with the speeds of the harmonic law (or one, idle_law 'plain')."""
    length = math.dist(start, end)
    if length <= 1e-9:
        return []
    if settings.idle_law == 'plain':
        return [idle(start, end, settings, layer)]
    law = HarmonicLaw.within(length, settings.idle_speed, settings.idle_acceleration)
    at, speeds = law.pieces()
    share = at[1:-1, None] / length
    inner = np.asarray(start) + share * np.subtract(end, start)
    corners = [start, *map(tuple, inner.tolist()), end]
    return [
        Segment(0, Kind.IDLE, a, b, v, layer=layer, speed_programmed=v)
        for a, b, v in zip(corners, corners[1:], speeds.tolist(), strict=False)
    ]


def hop(
    start: Point, end: Point, z: float, settings: PlanSettings, layer: int = 0
) -> list[Segment]:
    """Lift, travel at height z (or higher, where start or end are), descend. Moves of no length are left out."""
    top = max(z, start[2], end[2])
    corners = [start, (start[0], start[1], top), (end[0], end[1], top), end]
    return [
        s for a, b in zip(corners, corners[1:], strict=False) for s in leg(a, b, settings, layer)
    ]


def numbered(segments: list[Segment], first_index: int = 0) -> list[Segment]:
    """The same segments with consecutive indices."""
    return [s.at(index=first_index + i) for i, s in enumerate(segments)]


def renumber(
    segments: list[Segment],
    first_index: int,
    start: Point,
    settings: PlanSettings,
    safe_z: float = -math.inf,
) -> list[Segment]:
    """Segments with the collision-free connection from `start` before them, numbered from first_index.

    The connection lifts, travels and descends. It travels at the highest of: start, every point of the
    segments, safe_z (give Plan.safe_z when the torch may be below the highest part of the surface).
    Segments that begin with an arc (a layer resumed in the middle) are approached from `clearance` above.
    """
    if not segments:
        return []
    top = max(max(s.start[2], s.end[2]) for s in segments)
    if segments[0].kind == Kind.DEPOSIT:
        top += settings.clearance
    moves = hop(start, segments[0].start, max(top, safe_z), settings, segments[0].layer)
    return numbered([*moves, *segments], first_index)


def check_reach(segments: list[Segment], settings: PlanSettings) -> None:
    """Raises PlanError when the torch would leave the machine; names axis, place and limit."""
    if segments:
        check_points(np.array([s.start for s in segments] + [s.end for s in segments]), settings)


def check_points(points: np.ndarray, settings: PlanSettings) -> None:
    """The same for points (n, 3) m."""
    for axis, name in enumerate('xyz'):
        low, high = settings.machine_min[axis], settings.machine_max[axis]
        for value, bad, limit in (
            (points[:, axis].min(), points[:, axis].min() < low - 1e-9, low),
            (points[:, axis].max(), points[:, axis].max() > high + 1e-9, high),
        ):
            if bad:
                raise PlanError(
                    f'outside the machine: the torch would have to go to {name} = {value * 1e3:.1f} mm, '
                    f'its limit in the work frame is {limit * 1e3:.1f} mm; move the part (work zero), '
                    'plan fewer layers or scale it'
                )
