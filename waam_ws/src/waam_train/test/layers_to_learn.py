"""Layers to train on: a zig-zag whose turns end too high."""

from __future__ import annotations

import numpy as np

from waam_adapt.beads import plan_geometry
from waam_adapt.grids import CELLS_PER_BEAD, Resampler
from waam_adapt.types import CorrectionInput
from waam_train import samples

RES, WIDTH, H = 0.5e-3, 6e-3, 2e-3
SHAPE = (96, 96)  # 48 mm: a whole number of model cells


def request(shift: float = 0.0) -> CorrectionInput:
    """A layer on a flat plate, its passes moved by `shift` m."""
    inside = np.zeros(SHAPE, bool)
    inside[16:-16, 16:-20] = True
    points: list[tuple[float, float]] = []
    for k in range(8):
        ends = [(9e-3, 10e-3 + k * 4e-3), (36e-3, 10e-3 + k * 4e-3)]
        points += ends if k % 2 == 0 else ends[::-1]
    flat = np.zeros(SHAPE)
    return CorrectionInput(
        flat, flat, np.where(inside, H, 0.0), RES, WIDTH, 0.3, np.full(SHAPE, 2e-5),
        paths=(np.array(points) + shift,), temperature=150.0,
    )  # fmt: skip


def grid_of(r: CorrectionInput) -> Resampler:
    return Resampler.of(r.z.shape, r.resolution, r.bead_width / CELLS_PER_BEAD)


def laid(r: CorrectionInput, too_high: np.ndarray) -> np.ndarray:
    """(rows, cols) m: the surface after a layer that ended too high by a share (on the model's grid) of its height."""
    return np.where(r.footprint, r.target + r.planned + H * grid_of(r).fine(too_high), r.z)


def layer_sample(seed: int, amplitude: float = 0.3) -> samples.Sample:
    """A layer that ends too high where turns are."""
    r = request(1e-3 * (seed % 3))
    grid = grid_of(r)
    turn = plan_geometry.build(r, grid)[plan_geometry.NAMES.index('turn')]
    after = laid(r, amplitude * np.minimum(turn, 1.0))
    found = samples.sample(r, r, after, seed, ('portions', 'film')[seed % 2])
    assert found is not None
    return found
