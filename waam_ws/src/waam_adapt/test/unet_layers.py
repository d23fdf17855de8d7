"""Layers to ask the U-Net about, and files of weights that were never trained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from net_weights import card, random_weights

from waam_adapt.grids import CELLS_PER_BEAD, Resampler
from waam_adapt.laws import net_file
from waam_adapt.laws.checks import MapOrigin
from waam_adapt.types import CorrectionInput

RES, WIDTH, H = 0.5e-3, 6e-3, 2e-3
SHAPE = (96, 96)  # 48 mm: a whole number of model cells
PITCH = 4e-3


def zigzag() -> np.ndarray:
    """(n, 2) m: passes along x with links between, not symmetric."""
    points: list[tuple[float, float]] = []
    for k in range(8):
        ends = [(9e-3, 10e-3 + k * PITCH), (36e-3, 10e-3 + k * PITCH)]
        points += ends if k % 2 == 0 else ends[::-1]
    return np.array(points)


def request(paths: tuple[np.ndarray, ...] | None = None, **changes) -> CorrectionInput:
    inside = np.zeros(SHAPE, bool)
    inside[16:-16, 16:-20] = True
    values = {
        'z': np.zeros(SHAPE), 'target': np.zeros(SHAPE), 'planned': np.where(inside, H, 0.0),
        'resolution': RES, 'bead_width': WIDTH, 'k_gain': 0.3, 'sigma': np.full(SHAPE, 2e-5),
        'paths': (zigzag(),) if paths is None else paths, 'temperature': 150.0,
    }  # fmt: skip
    return CorrectionInput(**(values | changes))


def grid_of(r: CorrectionInput) -> Resampler:
    return Resampler.of(r.z.shape, r.resolution, r.bead_width / CELLS_PER_BEAD)


def weights_file(path, scale=1.0, low=-1e9, high=1e9, level=1.0):
    """level: weight of what it says of the level, in a job that has laid nothing."""
    weights = random_weights(head=3.0)
    weights['enc1a.weight'] *= np.float32(scale)
    net_file.save(path, weights, {**card(low, high), 'weights': {'shape': 1.0, 'level': level}})
    return path


def turned(r: CorrectionInput) -> CorrectionInput:
    """The same layer mirrored at the diagonal: x and y change places."""
    return replace(
        r,
        planned=r.planned.T.copy(),
        paths=tuple(np.ascontiguousarray(p[:, ::-1]) for p in r.paths),
    )


def mirrored(r: CorrectionInput) -> CorrectionInput:
    side = SHAPE[1] * RES
    return replace(
        r, planned=r.planned[:, ::-1].copy(), paths=tuple(p * (-1, 1) + (side, 0) for p in r.paths)
    )


def origin(layers: int) -> MapOrigin:
    return MapOrigin(0.0, 'job', 'job', layers, layers, True, ())


def laid(r: CorrectionInput, too_high: np.ndarray) -> np.ndarray:
    """(rows, cols) m: the surface after a layer that ended too high by a share (on the model's grid) of its height."""
    fine = grid_of(r).fine(too_high)
    return np.where(r.footprint, r.target + r.planned + H * fine, r.z)
