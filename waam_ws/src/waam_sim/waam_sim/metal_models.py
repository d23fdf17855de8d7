"""The metal models by name, behind one interface: `metal` (portions), `metal_sections`, `metal_film`.

All of them keep a height field and the same records, and each has a compiled `advance` that lives through one sample
(`metal.advance`); `step` calls the one that is asked for. A new model is added here and in the branches there.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from .metal import Metal
from .metal_params import MetalParams

PORTIONS, SECTIONS, FILM = 0, 1, 2
MODELS = {'portions': PORTIONS, 'sections': SECTIONS, 'film': FILM}


class MetalModel(Protocol):
    """What the cell needs of its metal. z, solid, touched (rows, cols): surface and what was solid below the melt, m in
    the work frame; s of the last melt. params, state (1,): records; of the state others read `active`, `surface` (m,
    under the pool), `head_x`, `head_y`, `pool_x`, `pool_y`, `width` (m), `portion` (m^3 since it was last set to 0) at
    `portion_x`, `portion_y`, `deposited` and `lost` (m^3)."""

    spec: GridSpec
    z: np.ndarray
    params: np.ndarray
    state: np.ndarray
    solid: np.ndarray
    touched: np.ndarray

    def grid(self) -> HeightGrid:
        """A copy of the true surface."""

    @property
    def volume(self) -> float:
        """Metal above the table, m^3."""

    @property
    def deposited(self) -> float:
        """Metal that was laid on the field so far, m^3."""


def number(model: str) -> int:
    """Of a model, as `step.live` takes it; ValueError that names the known ones."""
    if model not in MODELS:
        raise ValueError(f"metal_model is '{model}', known are {', '.join(MODELS)}")
    return MODELS[model]


def make(part: HeightGrid, params: MetalParams) -> MetalModel:
    """A cold part of the model that the parameters name. ValueError: unknown."""
    number(params.model)
    return Metal.on(part, params)
