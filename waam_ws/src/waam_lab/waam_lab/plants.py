"""Simulated cells that differ as cells and processes differ. Pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_sim.plant import PlantParams


def random_plant(rng: np.random.Generator, usual: PlantParams | None = None) -> PlantParams:
    """A cell whose metal differs from that of `usual` (default: the packaged parameters of waam_sim). Beads scatter as
    they do there, by a factor of its own."""
    packaged = PlantParams()
    usual = usual or packaged
    rougher = usual.metal.area_noise_layer / packaged.metal.area_noise_layer
    metal = replace(
        usual.metal,
        pool_lag=float(np.clip(rng.normal(0.45, 0.15), 0.1, 0.9)),
        levelling=float(np.clip(rng.normal(0.55, 0.12), 0.25, 0.85)),
        width_ref=float(rng.normal(7e-3, 0.3e-3)),
        crater_depth=float(rng.uniform(0.15, 0.6)),
        transfer=float(rng.uniform(0.8, 0.96)),
        area_noise_layer=float(rng.uniform(0.02, 0.06)) * rougher,
    )
    return replace(usual, metal=metal)
