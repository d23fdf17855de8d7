"""Random jobs for the training: part, surface as found, beads, process and sensor, each drawn anew from wide ranges.

Pads, walls, rings and blades; worn surfaces; separate beads and zig-zag; layers that repeat,
reverse or cross. Lengths in
cells (a quarter of a bead that the controller believes in), heights in planned layer heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d

from .. import filters
from ..laws import features
from .deposit import Pool, Stations, shares
from .parts import BEAD, RANGES, SIZE, Part, draw, holes, part, worn


@dataclass(frozen=True)
class Recorded:
    """A surface of a recorded job, to start from: error (rows, cols) in layer heights on the
    training cell, and direction.
    """

    error: np.ndarray
    footprint: np.ndarray


@dataclass
class Batch:
    """b scenes. Maps are (b, SIZE, SIZE); pairs hold what belongs to even and to odd layers."""

    z: torch.Tensor  # surface before the first layer, layer heights
    footprint: torch.Tensor  # bool
    planned: torch.Tensor  # layer heights of metal per layer
    judged: torch.Tensor  # bool
    trusted: tuple[np.ndarray, np.ndarray]  # bool, where a scan is believed
    holes: np.ndarray  # bool, what the scan does not show
    transfer: tuple[torch.Tensor, torch.Tensor]  # transfer function of the inverse bead filter
    fixed: tuple[torch.Tensor, torch.Tensor]  # channels that do not change from layer to layer
    layers: tuple[Stations, Stations]  # stations of the beads
    noise: list[torch.Tensor]  # by layer, (n,) relative change of the metal of the stations
    pool: Pool  # the process
    height: np.ndarray  # (b,) m, layer height
    gain: torch.Tensor  # (b,) of the explicit law
    sigma: torch.Tensor  # (b,) layer heights, uncertainty of the scan
    spikes: np.ndarray  # (b,) share of the cells whose height is a spike
    heat: torch.Tensor  # (b,) change of the efficiency per layer
    rng: np.random.Generator


def marks(p: Part, layer: int, known: bool) -> np.ndarray:
    """(2, SIZE, SIZE) nearness of starts and ends, zeros when the paths are not told."""
    if not known:
        return np.zeros((2, SIZE, SIZE))
    beads = p.beads[layer % 2]
    return np.stack(
        [features.fading(np.array([b[i] for b in beads]), (SIZE, SIZE)) for i in (0, -1)]
    )


def _stations(
    parts: Sequence[Part],
    footprint: np.ndarray,
    layer: int,
    width: np.ndarray,
    length: np.ndarray,
) -> Stations:
    columns: list[tuple] = []
    bead = 0
    for scene, p in enumerate(parts):
        for b in p.beads[layer]:
            step = np.hypot(*np.gradient(b, axis=0).T)
            tangent = np.gradient(b, axis=0) / np.maximum(step, 1e-9)[:, None]
            step = np.minimum(step, 2.0)
            s = np.cumsum(step) - 0.5 * step
            columns.append(
                (
                    np.full(len(b), scene),
                    np.full(len(b), bead),
                    b,
                    tangent,
                    step * p.pitch,
                    s,
                    s[-1] - s,
                )
            )
            bead += 1
    scenes, number, where, tangent, metal, start, end = (
        torch.from_numpy(np.concatenate(c)) for c in zip(*columns, strict=True)
    )
    w, n = (torch.from_numpy(a)[scenes] for a in (width, length))
    cells, share = shares(where, tangent, w, n, SIZE)
    cells = cells + scenes[:, None] * SIZE * SIZE
    f = torch.float32
    outside = ~torch.from_numpy(footprint).reshape(-1)[cells]
    return Stations(
        scene=scenes,
        bead=number,
        where=where.to(f),
        cells=cells,
        outside=outside,
        share=share.to(f),
        metal=metal.to(f),
        from_start=start.to(f),
        to_end=end.to(f),
    )


def _noise(rng: np.random.Generator, s: Stations, scenes: int) -> torch.Tensor:
    """Relative noise of the metal, correlated along the bead, and of whole beads."""
    white = rng.standard_normal(len(s.scene))
    out = np.empty(len(white))
    scene = s.scene.numpy()
    for i in range(scenes):
        mine = scene == i
        length = draw(rng, 'noise_length') * BEAD
        spread = np.sqrt(2 * np.sqrt(np.pi) * length)  # white noise after this mean has 1/spread
        out[mine] = draw(rng, 'noise') * spread * gaussian_filter1d(white[mine], length)
    beads = rng.standard_normal(int(s.bead.max()) + 1) * draw(rng, 'bead_noise')
    return torch.from_numpy(np.clip(out + beads[s.bead.numpy()], -0.5, 0.5)).float()


def batch(seed: Sequence[int], size: int, layers: int, recorded: Sequence[Recorded] = ()) -> Batch:
    """`size` scenes for `layers` layers; the same seed gives the same scenes. recorded: surfaces
    that half of them start from.
    """
    rng = np.random.default_rng(list(seed))
    parts = [part(rng) for _ in range(size)]

    def each(name: str) -> np.ndarray:
        return rng.uniform(*RANGES[name], size)

    def tensor(a: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.asarray(a)).float()

    width, length = each('true_width') * BEAD, each('pool_length') * BEAD
    footprint = np.stack([p.footprint for p in parts])
    stations = (
        _stations(parts, footprint, 0, width, length),
        _stations(parts, footprint, 1, width, length),
    )
    walls = np.array([p.wall for p in parts])
    surface = np.stack([worn(rng) for _ in parts])
    for i in range(size if recorded else 0):
        if rng.random() < 0.5:
            r = recorded[int(rng.integers(len(recorded)))]
            surface[i] = r.error[r.footprint].mean() - r.error
    tilt = each('planned_variation') * (rng.random(size) < 0.3)
    ramp = np.linspace(-1, 1, SIZE)
    planned = np.where(footprint, 1 + tilt[:, None, None] * ramp[None, None, :], 0.0)
    planned /= np.array([np.median(p[f]) for p, f in zip(planned, footprint, strict=True)])[
        :, None, None
    ]
    told = rng.random(size) < 0.6
    defects = (rng.random(size) < 0.85).astype(float)
    pool = Pool(*(tensor(a) for a in (
        each('efficiency'), np.where(walls, each('exponent_wall'), each('exponent_pad')),
        each('hump') * defects, each('defect_length') * BEAD, each('crater') * defects,
        each('defect_length') * BEAD, each('filling'), each('levelling'), each('lag'), each('cliff'),
        each('conserved'), each('spill'), each('run_over'),
    )))  # fmt: skip
    fixed = (
        tensor(_fixed(parts, footprint, planned, 0, told, rng)),
        tensor(_fixed(parts, footprint, planned, 1, told, rng)),
    )
    return Batch(
        z=tensor(surface),
        footprint=torch.from_numpy(footprint),
        planned=tensor(planned),
        judged=torch.from_numpy(np.stack([filters.away_from_edges(f, 1.2) for f in footprint])),
        trusted=(_trusted(parts, 0), _trusted(parts, 1)),
        holes=np.stack([holes(rng) for _ in parts]),
        transfer=(_transfers(parts, 0), _transfers(parts, 1)),
        fixed=fixed,
        layers=stations,
        noise=[_noise(rng, stations[k % 2], size) for k in range(layers)],
        pool=pool,
        height=each('layer_height_mm') * 1e-3,
        gain=tensor(each('gain')),
        sigma=tensor(each('scan_sigma')),
        spikes=each('spikes') * (rng.random(size) < 0.3),
        heat=tensor(each('heat')),
        rng=rng,
    )


def _trusted(parts: Sequence[Part], side: int) -> np.ndarray:
    beads = 0.5 * BEAD
    return np.stack([filters.away_from_edges(p.footprint, beads, p.direction[side]) for p in parts])


def _transfers(parts: Sequence[Part], side: int) -> torch.Tensor:
    n = SIZE + 4 * BEAD
    each = [
        filters.inverse_transfer((n, n), 1.0, float(BEAD), p.direction[side], 0.1) for p in parts
    ]
    return torch.from_numpy(np.stack(each)).float()


def _fixed(
    parts: Sequence[Part],
    footprint: np.ndarray,
    planned: np.ndarray,
    layer: int,
    told: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """(b, 9, SIZE, SIZE): features that do not change from scan to scan: footprint, planned,
    angle, marks, told, edge, temperature.
    """
    out = []
    for p, f, h, t in zip(parts, footprint, planned, told, strict=True):
        cos2a, sin2a = features.double_angle(p.direction[layer])
        constant = np.ones(f.shape)
        relative = np.where(f, h / np.median(h[f]) - 1, 0.0)
        warm = features.temperature_feature(rng.uniform(20, 300) if rng.random() < 0.5 else np.nan)
        start, end = marks(p, layer, t)
        out.append(
            np.stack([f, relative, cos2a * constant, sin2a * constant, start, end, constant * t,
                      features.edge_distance(f), constant * warm])
        )  # fmt: skip
    return np.stack(out)
