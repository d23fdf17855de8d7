"""Hatch -> segments: stations along the path, metal per segment, idle moves between chains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from waam_plan import hatch
from waam_plan.masks import fill_unknown
from waam_plan.plan import hop, idle, numbered
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment


@dataclass(frozen=True)
class Pieces:
    """Straight pieces with the arc on, in order: start, end (n, 3) m; bead and chain numbers (n,)."""

    start: np.ndarray
    end: np.ndarray
    bead: np.ndarray
    chain: np.ndarray

    @property
    def length(self) -> np.ndarray:
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
    cells = mask if direction == 'x' else mask.T
    second = settings.alternation != 'none' and number % 2 == 0
    pitch = settings.pitch / spec.resolution
    stagger = settings.stagger and number % 2 == 0
    chains = hatch.hatch(
        cells, pitch, settings.edge_inset * pitch, settings.min_share, stagger, second
    )
    origin = np.array([spec.origin_x, spec.origin_y])

    def to_work(line: np.ndarray) -> np.ndarray:
        line = line if direction == 'x' else line[:, ::-1]
        return origin + line * spec.resolution

    return [[to_work(line) for line in chain] for chain in chains], direction


def lay_out(chains: list[hatch.Chain], surface: HeightGrid, settings: PlanSettings) -> Pieces:
    """Stations at most segment_length apart on the surface (unknown cells take the nearest known height).

    A bead is one line of a chain with the link that leads to it.
    """
    filled = HeightGrid(surface.spec, fill_unknown(surface.z))
    start, end, bead_of, chain_of = [], [], [], []
    bead = 0
    for number, chain in enumerate(chains):
        last: np.ndarray | None = None
        for line in chain:
            bead += 1
            for piece in (line,) if last is None else (np.array([last, line[0]]), line):
                points = _stations(piece, filled, settings)
                start.append(points[:-1])
                end.append(points[1:])
                bead_of.append(np.full(len(points) - 1, bead))
                chain_of.append(np.full(len(points) - 1, number))
            last = line[-1]
    return Pieces(*(np.concatenate(part) for part in (start, end, bead_of, chain_of)))


def _stations(line: np.ndarray, surface: HeightGrid, settings: PlanSettings) -> np.ndarray:
    """Points (n, 3) along a polyline (k, 2), equally spaced along the surface."""
    fine = _densify(line, surface.spec.resolution)
    points = np.column_stack([fine, surface.sample(fine[:, 0], fine[:, 1])])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    n = max(1, int(np.ceil(along[-1] / settings.segment_length - 1e-9)))
    at = np.linspace(0, along[-1], n + 1)
    return np.column_stack([np.interp(at, along, points[:, i]) for i in range(3)])


def _densify(line: np.ndarray, step: float) -> np.ndarray:
    """The same polyline with points at most `step` apart."""
    gaps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    parts = [
        a + np.linspace(0, 1, max(1, int(np.ceil(gap / step))), endpoint=False)[:, None] * (b - a)
        for a, b, gap in zip(line, line[1:], gaps, strict=False)
    ]
    return np.concatenate([*parts, line[-1:]])


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


def programmed_speed(height: np.ndarray, settings: PlanSettings) -> np.ndarray:
    """Travel speed (n,) m/s: nominal, faster where the deposition rate would fall below the floor."""
    share = height / settings.layer_height
    faster = np.maximum(1.0, settings.feed_floor / np.maximum(share, 1e-6))
    return np.minimum(settings.speed * faster, settings.speed_max)


def to_segments(
    pieces: Pieces, height: np.ndarray, layer: int, safe_z: float, settings: PlanSettings
) -> list[Segment]:
    """Segments of one layer from safe height to safe height, indices from 0."""
    speed = programmed_speed(height, settings)
    out: list[Segment] = []
    rows = zip(
        map(tuple, pieces.start.tolist()),
        map(tuple, pieces.end.tolist()),
        pieces.bead.tolist(),
        pieces.chain.tolist(),
        height.tolist(),
        speed.tolist(),
        strict=True,
    )
    chain_before = -1
    for start, end, bead, chain, h, v in rows:
        if chain != chain_before:
            from_ = out[-1].end if out else (start[0], start[1], safe_z)
            out.extend(hop(from_, start, safe_z, settings, layer))
            chain_before = chain
        out.append(
            Segment(
                0,
                Kind.DEPOSIT,
                start,
                end,
                v,
                layer=layer,
                bead=bead,
                arc=True,
                height=h,
                width=settings.bead_width,
                speed_programmed=v,
            )
        )
    if out:
        x, y, _ = out[-1].end
        out.append(idle(out[-1].end, (x, y, safe_z), settings, layer))
    return numbered(out)


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
