"""Chains -> pieces: stations along the path on the surface; hatch of a region in any direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from waam_plan.fill import hatch
from waam_plan.masks import fill_unknown
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

MIN_SHARE = 0.25  # a bead goes on while at least this share of its band is in the region

# sharper turns stay where they are, stations are spread between them
CORNER = np.cos(np.radians(30))
BREAK = 1.0  # m, put between lines that are measured along one another
MIN_STATION_DISTANCE = 1e-7  # m, between two stations


@dataclass(frozen=True)
class Pieces:
    """Straight pieces with the arc on, in order: start, end (n, 3) m; bead and chain numbers (n,)."""

    start: np.ndarray
    end: np.ndarray
    bead: np.ndarray
    chain: np.ndarray

    @property
    def length(self) -> np.ndarray:
        """(n,) m."""
        return np.linalg.norm(self.end - self.start, axis=1)


def choose_direction(mask: np.ndarray, settings: PlanSettings, number: int) -> str:
    """'x' or 'y' for layer `number`: as set, or along the longer side; alternation 'cross' turns even layers."""
    direction = settings.direction
    if direction == 'auto':
        rows, cols = mask.any(axis=1).sum(), mask.any(axis=0).sum()
        direction = 'x' if cols >= rows else 'y'
    if settings.alternation == 'cross' and number % 2 == 0:
        direction = 'y' if direction == 'x' else 'x'
    return direction


def hatch_region(
    mask: np.ndarray, spec: GridSpec, settings: PlanSettings, number: int
) -> tuple[list[hatch.Chain], str]:
    """Chains in m (work frame) that cover the mask of layer `number`, and the direction of the beads."""
    direction = choose_direction(mask, settings, number)
    turn = settings.turn_deg * (number - 1) if settings.alternation == 'turn' else 0.0
    if turn % 180.0:
        return _hatch_turned(mask, spec, settings, direction, math.radians(turn)), direction
    second = settings.alternation != 'none' and number % 2 == 0
    return _hatched(mask, spec, settings, direction, second, number), direction


def _hatched(
    mask: np.ndarray,
    spec: GridSpec,
    settings: PlanSettings,
    direction: str,
    second: bool,
    number: int,
) -> list[hatch.Chain]:
    cells = mask if direction == 'x' else mask.T
    pitch = settings.pitch / spec.resolution
    stagger = settings.stagger and number % 2 == 0
    chains = hatch.hatch(cells, pitch, settings.edge_inset * pitch, MIN_SHARE, stagger, second)
    origin = np.array([spec.origin_x, spec.origin_y])

    def to_work(line: np.ndarray) -> np.ndarray:
        line = line if direction == 'x' else line[:, ::-1]
        return origin + line * spec.resolution

    return [[to_work(line) for line in chain] for chain in chains]


def _hatch_turned(
    mask: np.ndarray, spec: GridSpec, settings: PlanSettings, direction: str, turn: float
) -> list[hatch.Chain]:
    """Hatch of the mask as seen on a grid that is turned about the middle by `turn` (rad)."""
    x0, x1, y0, y1 = spec.extent
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    reach = math.hypot(x1 - x0, y1 - y0) / 2
    grid = GridSpec.covering(-reach, -reach, reach, reach, spec.resolution)
    c, s = math.cos(turn), math.sin(turn)
    back = np.array([[c, s], [-s, c]])  # rows times this: turned by +turn
    x, y = np.meshgrid(grid.x, grid.y)
    at = np.column_stack([x.ravel(), y.ravel()]) @ back + middle
    row, col = spec.cell(*at.T)
    on = spec.contains(*at.T)
    turned = np.zeros(row.shape, bool)
    turned[on] = mask[row[on], col[on]]
    chains = _hatched(turned.reshape(grid.shape), grid, settings, direction, False, 1)
    return [[line @ back + middle for line in chain] for chain in chains]


def lay_out(chains: list[hatch.Chain], surface: HeightGrid, settings: PlanSettings) -> Pieces:
    """Stations at most segment_length apart on the surface (unknown cells take the nearest known height).

    A bead is one line of a chain with the link that leads to it. Corners stay corners.
    """
    lines, bead, chain = _lines(chains)
    first = np.concatenate([[0], np.cumsum([len(line) for line in lines])])
    points, line_of = _dense(np.concatenate(lines), first, surface.spec.resolution)
    x = settings.unrolled.folded(points[:, 0]) if settings.unrolled else points[:, 0]
    z = HeightGrid(surface.spec, fill_unknown(surface.z)).sample(x, points[:, 1])
    points = np.column_stack([points, z])
    same = line_of[1:] == line_of[:-1]
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.where(same, step, BREAK))])
    legs = _legs(points[:, :2], same)
    length = along[legs[:, 1]] - along[legs[:, 0]]
    legs, length = legs[length > MIN_STATION_DISTANCE], length[length > MIN_STATION_DISTANCE]
    n = np.maximum(1, np.ceil(length / settings.segment_length - 1e-9)).astype(int)
    leg = np.repeat(np.arange(len(n)), n)
    k = np.arange(len(leg)) - np.repeat(np.cumsum(n) - n, n)
    begin = along[legs[leg, 0]]
    ends = [begin + (k + i) * (length / n)[leg] for i in (0, 1)]
    start, end = (np.column_stack([np.interp(at, along, c) for c in points.T]) for at in ends)
    of = line_of[legs[leg, 0]]
    return Pieces(start, end, bead[of], chain[of])


def _lines(chains: list[hatch.Chain]) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Lines and links in order with the numbers of their beads and chains."""
    lines, beads, owner = [], [], []
    bead = 0
    for number, chain in enumerate(chains):
        last: np.ndarray | None = None
        for line in chain:
            bead += 1
            own = [line] if last is None else [np.array([last, line[0]]), line]
            lines += own
            beads += [bead] * len(own)
            owner += [number] * len(own)
            last = line[-1]
    return lines, np.array(beads), np.array(owner)


def _dense(points: np.ndarray, first: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """The same lines with points at most `step` apart, and the line of every point."""
    line = np.repeat(np.arange(len(first) - 1), np.diff(first))
    gap = np.append(np.linalg.norm(np.diff(points, axis=0), axis=1), 0.0)
    inner = np.append(line[1:] == line[:-1], False)
    n = np.where(inner, np.maximum(1, np.ceil(gap / step - 1e-6)), 1).astype(int)
    at = np.repeat(np.arange(len(points)), n)
    share = (np.arange(len(at)) - np.repeat(np.cumsum(n) - n, n)) / n[at]
    ahead = np.minimum(at + 1, len(points) - 1)
    return points[at] + share[:, None] * (points[ahead] - points[at]), line[at]


def _legs(points: np.ndarray, same: np.ndarray) -> np.ndarray:
    """(n, 2) first and last point of every stretch between ends of lines and corners."""
    step = np.diff(points, axis=0)
    size = np.maximum(np.linalg.norm(step, axis=1), 1e-12)
    cosine = (step[1:] * step[:-1]).sum(axis=1) / (size[1:] * size[:-1])
    corner = np.zeros(len(points), bool)
    corner[1:-1] = (cosine < CORNER) & same[1:] & same[:-1]
    joint = np.flatnonzero(corner | ~np.append(same, False) | ~np.append(False, same))
    legs = np.column_stack([joint[:-1], joint[1:]])
    return legs[same[legs[:, 0]]] if len(legs) else legs


def nearest_piece(
    pieces: Pieces, x: np.ndarray, y: np.ndarray, step: float = 0.5e-3
) -> tuple[np.ndarray, np.ndarray]:
    """Index of and distance (m, in plan view) to the nearest piece for points (m)."""
    n = max(2, int(np.ceil(pieces.length.max(initial=step) / step)) + 1)
    t = (np.arange(n) + 0.5) / n
    samples = (
        pieces.start[:, None, :2] + t[None, :, None] * (pieces.end - pieces.start)[:, None, :2]
    )
    distance, index = cKDTree(samples.reshape(-1, 2)).query(np.column_stack([x, y]))
    return index // n, distance


def coverage(
    segments: list[Segment], mask: np.ndarray, spec: GridSpec, reach: float
) -> tuple[float, float]:
    """Share of the mask's cells within `reach` (m) of a deposit in plan view, and the largest distance (m)."""
    deposits = [s for s in segments if s.kind == Kind.DEPOSIT]
    row, col = np.nonzero(mask)
    if not len(row):
        return 1.0, 0.0
    if not deposits:
        return 0.0, float('inf')
    zero = np.zeros(len(deposits), int)
    pieces = Pieces(
        np.array([s.start for s in deposits]), np.array([s.end for s in deposits]), zero, zero
    )
    _, distance = nearest_piece(pieces, spec.x[col], spec.y[row], spec.resolution / 2)
    return float((distance <= reach).mean()), float(distance.max())
