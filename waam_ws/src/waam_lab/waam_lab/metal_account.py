"""Where the metal of a layer comes from, place by place: what was planned, and what every stage behind it added.

The layer is laid again in thought, each time with one more thing as it really was. Every stage is a map of metal (m3
per cell); the difference between two of them is what the newer one is to blame for. The last stage is the true growth
of the surface, so the differences add up to it exactly, in every cell and in every window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

from .metal_trace import LayerTrace
from .path_places import Places

EXCHANGE = 0.01  # s, of waam_lab.machine
STEP = 2e-4  # m, between the places that a segment lays its metal from
AHEAD = 12  # segments among which the torch is looked for
WIDTHS = 2e-4  # m, classes of the pool's width

PARTS = {  # what a stage adds: short name and what it is
    'plan': 'plan: path, metal per piece and overlap of footprints',
    'setpoint': 'setpoints: correction and flow factor',
    'motion': 'controller: slowing down in corners, standing at ends',
    'wire': 'wire: what ran instead of the setpoint',
    'transfer': 'melt: scatter of transfer',
    'trail': 'pool: melt lies behind the torch',
    'width': 'pool: wider or narrower than planned',
    'flow': 'melt on its neighbours: levelling, slump, craters',
}


@dataclass(frozen=True)
class Row:
    """Mean over the windows of one kind of place. metal: 'wanted', the names of PARTS and 'grown' -> m3 per window."""

    kind: str
    count: int
    metal: dict[str, float]


@dataclass(frozen=True)
class Account:
    """Where the metal of a layer came from."""

    spec: GridSpec
    wanted: np.ndarray  # (rows, cols) m3 that was to be added
    parts: dict[str, np.ndarray]  # name of PARTS -> (rows, cols) m3 that it adds to that

    @property
    def grown(self) -> np.ndarray:
        """(rows, cols) m3 by which the true surface has grown."""
        return self.wanted + sum(self.parts.values())

    def within(self, mask: np.ndarray) -> dict[str, float]:
        """Metal (m3) in the cells of a mask: wanted, every part, grown."""
        found = {name: float(part[mask].sum()) for name, part in self.parts.items()}
        return {
            'wanted': float(self.wanted[mask].sum()),
            **found,
            'grown': float(self.grown[mask].sum()),
        }


def table(found: Account, at: Places, radius: float) -> list[Row]:
    """One row per kind of place with windows of `radius` (m), and 'elsewhere': as much area where none of them is."""
    spec = found.spec
    elsewhere, rows = found.wanted > 0, []
    for kind, masks in at.masks(spec.x, spec.y, radius).items():
        if masks:
            sums = [found.within(mask) for mask in masks]
            rows.append(
                Row(kind, len(masks), {k: float(np.mean([s[k] for s in sums])) for k in sums[0]})
            )
            elsewhere &= ~np.any(masks, axis=0)
    if elsewhere.any():
        share = np.pi * radius**2 / (elsewhere.sum() * spec.resolution**2)
        rows.append(Row('elsewhere', 0, {k: v * share for k, v in found.within(elsewhere).items()}))
    return rows


def account(layer: LayerTrace) -> Account:
    """The account of a layer that was traced. ValueError when nothing was laid or the trace is not whole."""
    spec, planned = layer.spec, layer.planned
    if spec is None or planned is None or layer.before is None or layer.after is None:
        raise ValueError('the trace of the layer is not whole: the job ended before the layer did')
    t = layer.columns()
    deposits = [s for s in layer.segments if s.kind == Kind.DEPOSIT]
    lit = t['lit'] > 0
    if not deposits or not lit.any() or t['melt'].sum() <= 0:
        raise ValueError('no metal was laid in this layer')
    width = layer.bead_width

    torch, pool = (np.column_stack([t[a], t[b]]) for a, b in (('x', 'y'), ('pool_x', 'pool_y')))
    told = feeds_at(torch, deposits) * lit
    per_wire = t['melt'].sum() / (told.sum() * EXCHANGE)  # m3 per m, of the whole layer
    told = told * per_wire * EXCHANGE
    ran = t['wire'] * lit
    ran = ran * told.sum() / max(ran.sum(), 1e-12)  # what the drive's scale lacks counts as level
    stages = [
        _spread_segments(deposits, [planned_metal(s) for s in deposits], spec, width),
        _spread_segments(deposits, [per_wire * _wire(s) for s in deposits], spec, width),
        spread(torch[lit], told[lit], np.full(lit.sum(), width), spec),
        spread(torch[lit], ran[lit], np.full(lit.sum(), width), spec),
        spread(torch, t['melt'], np.full(len(lit), width), spec),
        spread(pool, t['melt'], np.full(len(lit), width), spec),
        spread(pool, t['melt'], t['width'], spec),
        (layer.after - layer.before) * spec.resolution**2,
    ]
    wanted = _wanted(planned, spec)
    differences = np.diff(np.array([wanted, *stages]), axis=0)
    return Account(spec, wanted, dict(zip(PARTS, differences, strict=True)))


def planned_metal(s: Segment) -> float:
    """m3 that the plan gives a segment (eq 2.16)."""
    return AREA_FACTOR * s.width * s.height * s.length


def _wire(s: Segment) -> float:
    """m of wire that the setpoints of a segment ask for."""
    return s.wire_feed_speed * s.length / s.speed


def _wanted(planned: HeightGrid, spec: GridSpec) -> np.ndarray:
    x, y = np.meshgrid(spec.x, spec.y)
    return np.nan_to_num(planned.sample(x, y)) * spec.resolution**2


def feeds_at(torch: np.ndarray, deposits: list[Segment]) -> np.ndarray:
    """Wire feed (n,) m/s that is set where the torch is, torch (n, 2) m in the order of time.

    The torch follows the segments, so only those soon after the last one are looked at.
    """
    a = np.array([s.start[:2] for s in deposits])
    b = np.array([s.end[:2] for s in deposits])
    feed = np.array([s.wire_feed_speed for s in deposits])
    way = b - a
    square = np.maximum((way**2).sum(axis=1), 1e-18)
    out, here = np.zeros(len(torch)), 0
    for i, p in enumerate(torch):
        near = slice(here, here + AHEAD)
        share = np.clip(((p - a[near]) * way[near]).sum(axis=1) / square[near], 0, 1)
        away = np.hypot(*(a[near] + share[:, None] * way[near] - p).T)
        best = int(np.argmin(away - 1e-6 * np.arange(len(away))))
        if away[best] < 1e-3:
            here += best
        out[i] = feed[here]
    return out


def _spread_segments(
    deposits: list[Segment], volume: list[float], spec: GridSpec, width: float
) -> np.ndarray:
    """Metal (rows, cols) m3 of segments whose footprint goes along them at an even pace."""
    places, shares = [], []
    for s, v in zip(deposits, volume, strict=True):
        n = max(1, int(np.ceil(s.length / STEP)))
        t = (np.arange(n) + 0.5)[:, None] / n
        places.append(np.array(s.start[:2]) + t * (np.array(s.end[:2]) - np.array(s.start[:2])))
        shares.append(np.full(n, v / n))
    at, metal = np.concatenate(places), np.concatenate(shares)
    return spread(at, metal, np.full(len(at), width), spec)


def spread(at: np.ndarray, volume: np.ndarray, width: np.ndarray, spec: GridSpec) -> np.ndarray:
    """Metal (rows, cols) m3 of portions `volume` (n,) m3 at (n, 2) m, each a half ellipsoid `width` (n,) m wide."""
    classes = np.round(width / WIDTHS).astype(int)
    out = np.zeros(spec.shape)
    for k in np.unique(classes[volume != 0]):
        pick = (classes == k) & (volume != 0)
        points = _points(at[pick], volume[pick], spec)
        out += fftconvolve(points, _footprint(k * WIDTHS / 2 / spec.resolution), mode='same')
    return out


def _points(at: np.ndarray, volume: np.ndarray, spec: GridSpec) -> np.ndarray:
    """Metal (rows, cols) m3 of portions at points, each shared out among the four nearest cells."""
    u = (at[:, 0] - spec.origin_x) / spec.resolution - 0.5
    v = (at[:, 1] - spec.origin_y) / spec.resolution - 0.5
    out = np.zeros(spec.shape)
    col, row = np.floor(u).astype(int), np.floor(v).astype(int)
    for r, part_v in ((row, row + 1 - v), (row + 1, v - row)):
        for c, part_u in ((col, col + 1 - u), (col + 1, u - col)):
            on = (r >= 0) & (r < spec.rows) & (c >= 0) & (c < spec.cols)
            np.add.at(out, (r[on], c[on]), (volume * part_v * part_u)[on])
    return out


def _footprint(radius: float) -> np.ndarray:
    """Shares of a half ellipsoid of `radius` cells around the middle one; they add up to 1."""
    half = max(1, int(np.ceil(radius)))
    u = np.arange(-half, half + 1) / max(radius, 1e-9)
    pool = np.sqrt(np.maximum(1 - u[:, None] ** 2 - u[None] ** 2, 0.0))
    return pool / pool.sum()
