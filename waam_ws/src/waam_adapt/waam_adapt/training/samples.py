"""What a growth network is trained on: the plan's geometry of a layer, and how it grew beside the bead model.

A job is one file `job_<seed>.npz` without pickle with arrays `x<k>`, `y<k>`, `weight<k>` of its k-th layer, and
`moments<k>` where the job was laid with a network.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..beads import plan_geometry, residual
from ..beads.model import MARGIN, bead_model, inner_mean
from ..beads.skill import beside_model
from ..grids import CELLS_PER_BEAD, Resampler
from ..identify.level import level
from ..types import CorrectionInput, Predicted


@dataclass(frozen=True)
class Sample:
    """x (CHANNELS, rows, cols); y (rows, cols): share of the planned height that grew beside what the bead model
    expected of the setpoints, less the layer's level; weight (rows, cols): share of the cells that is known; figures:
    `plan_geometry.summary`; seed: of the job; level: efficiency ratio of the whole layer, NaN where unknown; moments:
    `residual.moments` of a layer that was laid with a network, None of others."""

    x: np.ndarray
    y: np.ndarray
    weight: np.ndarray
    figures: np.ndarray
    seed: int
    level: float = math.nan
    moments: np.ndarray | None = None


def sample(
    request: CorrectionInput,
    asked: np.ndarray,
    after: np.ndarray,
    lag: float,
    seed: int,
    slope: float = 1.0,
    missing: np.ndarray | float = 0.0,
    predicted: Predicted | None = None,
) -> Sample | None:
    """One layer; None when too little of it was seen.

    request: before the layer, with its paths. asked (rows, cols): m of metal that its setpoints asked for, with the
    factors of the feed. after (rows, cols): m, surface after it. lag: bead widths, slope: of growth on metal, both as
    believed before it. predicted: of the network that it was laid with, with the headroom that was asked for.
    """
    width, footprint = request.bead_width, request.footprint
    grid = Resampler.of(request.z.shape, request.resolution, width / CELLS_PER_BEAD)
    model = bead_model(request.paths, grid.shape, width)
    planned = np.where(footprint, request.planned, np.nan)
    relative = model.of_cells(asked / planned, request.resolution) ** slope
    growth = (after - request.z) / planned
    known = footprint & np.isfinite(growth)
    margin = MARGIN * width / request.resolution
    whole = level(
        model, after - request.z, planned, asked, request.resolution, slope, lag * width, missing
    )
    growth, seen = inner_mean(growth, known, footprint, grid, margin)
    found = beside_model(model, relative, growth, seen, lag)
    if found is None:
        return None
    x = plan_geometry.build(request, grid)
    figures = plan_geometry.summary(x, width)
    box = plan_geometry.box(x)
    shown = [a[..., *box].astype(np.float32) for a in (x, found.growth, found.weight)]
    moments = None
    if predicted is not None and predicted.digest:
        surface = residual.surface(request, grid, x, predicted.growth)
        left, seen = residual.known_mean(
            (after - request.target - planned) / residual.middle(request), grid
        )
        left = left + predicted.headroom
        moments = residual.moments(surface, np.where(seen, left, np.nan))
    whole = math.nan if whole is None else whole
    return Sample(shown[0], shown[1], shown[2], figures, seed, whole, moments)


def save(folder: Path, seed: int, layers: Sequence[Sample]) -> Path:
    """Writes the layers of one job as `job_<seed>.npz`, complete or not at all. Returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {'seed': np.array(seed)}
    for k, s in enumerate(layers):
        arrays |= {f'x{k}': s.x, f'y{k}': s.y, f'weight{k}': s.weight, f'figures{k}': s.figures}
        arrays[f'level{k}'] = np.array(s.level)
        if s.moments is not None:
            arrays[f'moments{k}'] = s.moments
    path = folder / f'job_{seed}.npz'
    part = path.with_suffix('.part.npz')
    np.savez_compressed(part, **arrays)
    part.replace(path)
    return path


def load(folder: Path) -> Iterator[Sample]:
    """All layers of a folder, in the order of the file names. ValueError when it has none."""
    files = sorted(p for p in folder.glob('job_*.npz') if not p.stem.endswith('.part'))
    if not files:
        raise ValueError(
            f'{folder}: holds no job_*.npz; make some with python3 -m waam_lab.growth_data'
        )
    for path in files:
        with np.load(path, allow_pickle=False) as f:
            for k in range(sum(n.startswith('x') for n in f.files)):
                x, y, weight, figures = (f[f'{n}{k}'] for n in ('x', 'y', 'weight', 'figures'))
                whole = float(f[f'level{k}']) if f'level{k}' in f.files else math.nan
                moments = f[f'moments{k}'] if f'moments{k}' in f.files else None
                yield Sample(x, y, weight, figures, int(f['seed']), whole, moments)
