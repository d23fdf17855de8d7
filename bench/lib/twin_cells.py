"""Hidden cells for bench_twin: their parameters, what they do, and what the laboratory keeps of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from waam_lab import restore
from waam_lab.job import LabJob
from waam_lab.parts import Shape
from waam_sim.plant import PlantParams

FIRST = 7100  # of the seeds of hidden cells; no other bench and no training uses them


def hidden(number: int) -> PlantParams:
    """Parameters that only this function knows. They spread about the packaged ones as cells do, in all that
    `waam lab fit` looks for; nothing here reads the priors of the fit."""
    rng = np.random.default_rng([FIRST, number])
    usual = PlantParams()
    metal = replace(
        usual.metal,
        transfer=float(rng.uniform(0.80, 0.96)),
        width_ref=float(np.clip(rng.normal(7e-3, 0.35e-3), 6.2e-3, 7.9e-3)),
        levelling=float(np.clip(rng.normal(0.55, 0.12), 0.25, 0.85)),
        pool_lag=float(np.clip(rng.normal(0.45, 0.15), 0.1, 0.9)),
        crater_depth=float(rng.uniform(0.15, 0.6)),
        start_narrowing=float(rng.uniform(0.05, 0.3)),
        area_noise_layer=float(rng.uniform(0.02, 0.06)),
    )
    heat = replace(
        usual.heat,
        arc_efficiency=float(np.clip(rng.normal(0.8, 0.05), 0.65, 0.92)),
        table_conductance=float(450.0 * np.exp(rng.normal(0.0, 0.35))),
    )
    arc = replace(
        usual.arc,
        current_ref=float(rng.normal(138.0, 7.0)),
        current_exponent=float(np.clip(rng.normal(0.65, 0.05), 0.5, 0.8)),
        current_per_m=float(np.clip(rng.normal(24.0, 4.0), 12.0, 36.0)),
        length_noise=float(rng.uniform(0.25, 0.7)),
        current_noise=float(rng.uniform(4.0, 10.0)),
        sensor_noise=float(rng.uniform(0.8, 2.5)),
    )
    return replace(usual, metal=metal, heat=heat, arc=arc)


def _block(length: float, width: float, wear: np.ndarray, x: np.ndarray, y: np.ndarray) -> Shape:
    plan = np.stack([x, y], axis=2)
    kept = np.ones((x.shape[0] - 1, x.shape[1] - 1), bool)
    return Shape(plan, kept, np.full(x.shape, 18.0), 18.0 - wear)


def shape(number: int) -> Shape:
    """A block of some 45 x 30 mm whose top is worn by 3 to 5 mm, unevenly."""
    rng = np.random.default_rng([FIRST, 1, number])
    length, width = rng.uniform(40, 52), rng.uniform(24, 34)
    x, y = np.meshgrid(
        np.linspace(0, length, round(length) + 1),
        np.linspace(0, width, round(width) + 1),
        indexing='ij',
    )
    wear = rng.uniform(3.2, 4.6) + rng.uniform(-0.6, 0.6) * (x / length - 0.5)
    wear += 0.3 * np.sin(x / rng.uniform(6, 12)) * np.cos(y / rng.uniform(6, 12))
    return _block(length, width, wear, x, y)


def job(folder: Path, part: int, plant: PlantParams | None, seed: int, keep: bool) -> LabJob:
    """The restoration of part `part`; kept in folder/jobs when it is to be kept."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / f'block{part}_nominal.stl', folder / f'block{part}_worn.stl'
    if not paths[1].exists():
        nominal, worn = shape(part).meshes()
        assert worn is not None
        nominal.export(paths[0])
        worn.export(paths[1])
    jobs = folder / 'jobs'
    return restore(*paths, seed, plant=plant, keep=keep, jobs_dir=jobs, tolerance=0.2e-3)
