"""Ways into and out of a bead along its own direction, and beads that are laid again. Off by default.

S3 section 4.4: approach and retract are straight, along the tangent of the path, 10 mm long, at the speed of the bead.
Repeated passes are those of the same section: an overhanging bead that gets too little metal is laid again rather than
with more wire.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Point, Segment

STEP = 0.5e-3  # m between the places of a way that are looked at
SHORTEST = 1e-3  # m; shorter ones are left out
LOOSE = 0.5  # share of a bead beside what carries it, from which on it is laid again


class Ground:
    """What a torch at the height of a layer may run into: metal beside the layer, and beads of the layer so far."""

    def __init__(self, spec: GridSpec, beside: np.ndarray, settings: PlanSettings) -> None:
        # beside: (rows, cols) m, metal outside the layer's footprint, -inf inside and where nothing is known
        self.spec, self.beside, self.settings = spec, beside, settings
        self._starts: list[tuple[float, float]] = []
        self._ends: list[tuple[float, float]] = []

    def lay(self, run: Sequence[Segment]) -> None:
        """Adds a bead that now lies there."""
        for s in run:
            if s.kind == Kind.DEPOSIT:
                self._starts.append(s.start[:2])
                self._ends.append(s.end[:2])

    def lead(self, place: Point, along: np.ndarray, length: float, own: float = 0.0) -> float:
        """m: how far from `place` the torch can go level along a unit vector (2,), at most `length`.

        own: m after which beads count that end at `place`. Less than SHORTEST is 0.
        """
        n = max(1, math.ceil(length / STEP))
        way = length * np.arange(1, n + 1) / n
        points = np.array(place[:2]) + way[:, None] * along
        free = self._inside(points, place[2]) & self._clear(points, way, own)
        reach = length if free.all() else float(way[int(np.argmin(free))] - length / n)
        return reach if reach >= SHORTEST else 0.0

    def _inside(self, points: np.ndarray, z: float) -> np.ndarray:
        """Inside the machine and not in metal beside the layer."""
        low, high = self.settings.machine_min, self.settings.machine_max
        inside = (points >= low[:2]).all(axis=1) & (points <= high[:2]).all(axis=1)
        row, col = self.spec.cell(points[:, 0], points[:, 1])
        rows, cols = self.spec.shape
        on = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        height = np.full(len(points), -math.inf)
        height[on] = self.beside[row[on], col[on]]
        return np.asarray(inside & (height <= z + 1e-6))

    def _clear(self, points: np.ndarray, way: np.ndarray, own: float) -> np.ndarray:
        """A bead's width away from all beads of the layer so far; nearer than `own` they do not count."""
        if not self._starts:
            return np.ones(len(points), bool)
        a, b = np.array(self._starts), np.array(self._ends)
        along = b - a
        square = np.maximum(np.einsum('ij,ij->i', along, along), 1e-18)
        t = np.einsum('pij,ij->pi', points[:, None] - a, along) / square
        nearest = a + np.clip(t, 0, 1)[..., None] * along
        gap = np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)
        return np.asarray((gap >= 0.75 * self.settings.bead_width) | (way <= own))


def lead_in(run: Sequence[Segment], ground: Ground, settings: PlanSettings) -> list[Segment]:
    """The level way to the start of a bead, arc off; empty where there is no room or none is asked for."""
    first = run[0]
    back = -_direction([s for s in run if s.length > 0][0])
    length = ground.lead(first.start, back, settings.tangent_in) if settings.tangent_in else 0.0
    return [_way(_at(first.start, back, length), first.start, first)] if length else []


def lead_out(run: Sequence[Segment], ground: Ground, settings: PlanSettings) -> list[Segment]:
    """The level way on from the end of a bead, arc off."""
    last = [s for s in run if s.length > 0][-1]
    on = _direction(last)
    own = settings.bead_width
    length = ground.lead(last.end, on, settings.tangent_out, own) if settings.tangent_out else 0.0
    return [_way(last.end, _at(last.end, on, length), last)] if length else []


def _direction(s: Segment) -> np.ndarray:
    along = np.subtract(s.end, s.start)[:2]
    return np.asarray(along / max(float(np.linalg.norm(along)), 1e-12))


def _at(place: Point, along: np.ndarray, length: float) -> Point:
    return (place[0] + length * float(along[0]), place[1] + length * float(along[1]), place[2])


def _way(a: Point, b: Point, bead: Segment) -> Segment:
    return Segment(
        0, Kind.IDLE, a, b, bead.speed, layer=bead.layer, speed_programmed=bead.speed_programmed
    )


def laid_again(
    runs: list[list[Segment]], carried: np.ndarray, spec: GridSpec, passes: int
) -> list[list[Segment]]:
    """Runs in order; those that lie beside what carries them follow again, there and back, `passes` times in all.

    carried: (rows, cols) bool, cells with metal below.
    """
    out = []
    for run in runs:
        out.append(run)
        if passes > 1 and _loose_share(run, carried, spec) > LOOSE:
            for n in range(1, passes):
                out.append(_reversed(run) if n % 2 else run)
    return out


def _loose_share(run: list[Segment], carried: np.ndarray, spec: GridSpec) -> float:
    """Share of the length of a run over cells that nothing carries."""
    middle = np.array([s.midpoint[:2] for s in run])
    length = np.array([s.length for s in run])
    row, col = spec.cell(middle[:, 0], middle[:, 1])
    rows, cols = spec.shape
    on = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    loose = ~on
    loose[on] = ~carried[row[on], col[on]]
    return float(length[loose].sum() / max(length.sum(), 1e-12))


def _reversed(run: list[Segment]) -> list[Segment]:
    return [s.at(start=s.end, end=s.start) for s in reversed(run)]
