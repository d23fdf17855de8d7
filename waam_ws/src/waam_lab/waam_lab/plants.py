"""Simulated cells that differ as cells and processes differ. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from waam_sim.config import GROUPS, plant_params
from waam_sim.metal_models import number
from waam_sim.plant import PlantParams

from .job import LabJob
from .params import Overrides, make

# Where the random cells of a family begin: what is chosen or trained on the one is reported on the other.
CHOOSING, REPORTING = 4701, 4702
FIRST_CELL = 9001  # seed of the first cell of a forecast; reports are on other seeds


# Ranges of what each model has of its own; the first three are every model's. Those of the scatter reach from the
# packaged one to 1.1 times what a recorded wall shows (2.3 times it).
_COMMON = {'width_ref': (6.4e-3, 7.6e-3), 'transfer': (0.8, 0.96), 'scatter': (1.0, 2.5)}
_OWN = {
    'portions': {
        'pool_lag': (0.1, 0.9), 'levelling': (0.25, 0.85), 'crater_depth': (0.15, 0.6),
        'start_narrowing': (0.05, 0.3), 'slump_slope': (2.5, 6.0),
    },
    'sections': {
        'sections_pool_length': (0.1, 0.35), 'sections_narrowing': (0.05, 0.35),
        'sections_narrow_path': (2e-3, 8e-3), 'sections_sag': (0.4, 1.0), 'sections_fillet': (0.6, 1.0),
    },
    'film': {
        'film_mobility': (4e-6, 1e-5), 'film_bump': (0.45, 0.75), 'film_trail': (0.15, 0.6),
        'film_remelt': (1e-4, 5e-4), 'film_pressure': (0.1, 0.5), 'film_hot_start': (0.05, 0.3),
    },
}  # fmt: skip
MODELS = tuple(_OWN)
_SCATTER = ('area_noise_fixed', 'area_noise_layer', 'width_noise')


def training_plant(
    rng: np.random.Generator, preset: str, model: str = '', overrides: Overrides | None = None
) -> PlantParams:
    """A cell of a random metal model ('') or of this one about the cell of a preset, one in three with a drift of the
    efficiency. What is trained on such cells is reported on `family_plant`, whose cells none of them is."""
    usual = plant_params(make(overrides or {}, preset=preset).cell)
    model = model or str(rng.choice(list(_OWN)))
    ranges = {**_COMMON, **_OWN[model], 'scatter': (0.7, 1.3)}
    drawn = {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}
    scatter = drawn.pop('scatter')
    noise = {name: scatter * getattr(usual.metal, name) for name in _SCATTER}
    variation = usual.variation
    if rng.random() < 1 / 3:
        variation = replace(
            variation,
            efficiency_per_layer=float(rng.uniform(-0.012, 0.006)),
            efficiency_walk=float(rng.uniform(0.0, 0.03)),
        )
    metal = replace(usual.metal, model=model, **noise, **drawn)
    return replace(usual, metal=metal, variation=variation)


def own_physics(job: LabJob) -> bool:
    """Whether the job says which cell it wants. Where the part is clamped (by a cell file) is no physics."""
    groups = tuple(f'{group}_' for group in GROUPS)
    return job.plant is not None or any(n.startswith(groups) for n in job.overrides.get('cell', {}))


def on_cells(job: LabJob, cells: int, models: Sequence[str] = MODELS) -> list[LabJob]:
    """The job on so many cells for a forecast: each has physics of its own about those of the job's preset, the metal
    models take turns. A job that says which cell it wants gets that one, with other seeds."""
    seeds = range(FIRST_CELL, FIRST_CELL + cells)
    if own_physics(job):
        return [replace(job, seed=seed) for seed in seeds]
    return [
        replace(
            job,
            seed=seed,
            plant=training_plant(
                np.random.default_rng(seed), job.preset, models[i % len(models)], job.overrides
            ),
        )
        for i, seed in enumerate(seeds)
    ]


def family_plant(model: str, cell: int, seeds: int = CHOOSING) -> PlantParams:
    """Random cell `cell` (0, 1, ...) of a metal model, the same in every call. seeds: CHOOSING or REPORTING.

    ValueError: an unknown model, other seeds."""
    if seeds not in (CHOOSING, REPORTING):
        raise ValueError(f'seeds is {seeds}, must be {CHOOSING} (choosing) or {REPORTING}')
    rng = np.random.default_rng([seeds, number(model), cell])
    drawn = {
        name: float(rng.uniform(*limits)) for name, limits in {**_COMMON, **_OWN[model]}.items()
    }
    usual, scatter = PlantParams(), drawn.pop('scatter')
    noise = {name: scatter * getattr(usual.metal, name) for name in _SCATTER}
    return replace(usual, metal=replace(usual.metal, model=model, **noise, **drawn))
