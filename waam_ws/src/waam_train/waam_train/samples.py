"""What the U-Net is trained on: what it sees of a layer before it is laid, and what the loop then left of it.

A job is one file `job_<seed>.npz` without pickle with arrays `x<k>`, `y<k>`, `weight<k>`, `figures<k>` of its k-th
layer, its seed and the name of its family.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from waam_adapt.beads import features, plan_geometry
from waam_adapt.grids import CELLS_PER_BEAD, Resampler
from waam_adapt.types import CorrectionInput


@dataclass(frozen=True)
class Sample:
    """x (CHANNELS, rows, cols); y (rows, cols): share of the planned height by which the layer would have ended too
    high by the base law alone; weight (rows, cols): how much a cell counts; figures: `plan_geometry.summary`; seed: of
    the job; family: of the cell that laid it."""

    x: np.ndarray
    y: np.ndarray
    weight: np.ndarray
    figures: np.ndarray
    seed: int
    family: str = ''


def sample(
    request: CorrectionInput,
    prepared: CorrectionInput,
    after: np.ndarray,
    seed: int,
    family: str = '',
) -> Sample | None:
    """One layer; None when too little of it was seen.

    request: before the layer, with its paths; prepared: the same as the law saw it, with the forecast that it was laid
    with. after (rows, cols): m, surface after it.
    """
    width = request.bead_width
    grid = Resampler.of(request.z.shape, request.resolution, width / CELLS_PER_BEAD)
    planned = np.where(request.footprint, request.planned, np.nan)
    left, known = features.known_mean(
        (after - request.target - planned) / features.middle(request), grid
    )
    counted = features.counted(request, grid)
    weight = np.where(known, counted, 0.0)
    if np.count_nonzero(weight) < 50:
        return None
    if prepared.forecast is not None:
        left = left + prepared.forecast.shape + prepared.forecast.level
    y = np.where(weight > 0, left, 0.0)
    x = features.build(prepared, grid, counted)
    figures = plan_geometry.summary(x[: plan_geometry.CHANNELS], width)
    box = plan_geometry.box(x)
    shown = [a[..., *box].astype(np.float32) for a in (x, y, weight)]
    return Sample(shown[0], shown[1], shown[2], figures, seed, family)


def save(folder: Path, seed: int, layers: Sequence[Sample]) -> Path:
    """Writes the layers of one job as `job_<seed>.npz`, complete or not at all. Returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {
        'seed': np.array(seed),
        'family': np.array(layers[0].family if layers else ''),
    }
    for k, s in enumerate(layers):
        arrays |= {
            f'x{k}': s.x.astype(np.float16),
            f'y{k}': s.y,
            f'weight{k}': s.weight,
            f'figures{k}': s.figures,
        }
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
            f'{folder}: holds no job_*.npz; make some with python3 -m waam_lab.training_data'
        )
    for path in files:
        with np.load(path, allow_pickle=False) as f:
            for k in range(sum(n.startswith('x') for n in f.files)):
                x, y, weight, figures = (f[f'{n}{k}'] for n in ('x', 'y', 'weight', 'figures'))
                yield Sample(
                    x.astype(np.float32), y, weight, figures, int(f['seed']), str(f['family'])
                )
