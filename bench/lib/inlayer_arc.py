"""What arc sensing could tell of a layer while it is laid: the level that the arc burns to, met before the metal is
there, against what the surface is off by afterwards at the same place.

The level that the simulated arc meets is taken as it is, and with the noise that a contact distance by current, voltage
and wire speed has over SPAN of path. What plan and setpoints foretell of the error is fitted first (metal asked for
around the place in beads before, over four distances, and the thickness of the layer), so that what is left for the arc
is news. Every fit is to the same jobs, so each share is a limit from above.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from .inlayer_known import Calm, run
from .jaw import jaw_job

NOISE = 0.16e-3  # m: 1.5 A, 0.15 V and 0.5 mm/s of reading noise at 3.3 A/mm and 100 Hz, mean over 0.1 s
SPAN = 8  # exchanges of 10 ms between two places that are asked
SPREADS = (0.25, 0.4, 0.6, 0.9)  # bead widths
BESIDE = 4.0  # s: metal laid before is that of other beads
STRUCK = 1.0  # s after a strike that are left out
SPOT = 0.8e-3  # m, of the map before around the arc
METAL = 1.13e-6 * 0.01  # m3 per m/s of wire (1.2 mm) and exchange


class Meeting(Calm):
    """`met`: s, x, y (m), level under the arc (m), wire speed (m/s), one row per exchange with the arc burning."""

    def __init__(self, *args) -> None:
        self.met: list[tuple[float, ...]] = []
        super().__init__(*args)

    def _on_exchange(self, samples, plant) -> None:
        super()._on_exchange(samples, plant)
        if plant.arc_on:
            x, y = (-float(samples[f'table_{axis}'].mean()) for axis in 'xy')
            zero, level = plant.params.work_zero, float(plant.metal.state['surface'][0])
            wire = float(plant.arc.state['wire'][0])
            self.met.append((self.now(), x - zero[0], y - zero[1], level, wire))


def layers_met(seed: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of every layer of the jaw of a seed: what plan and setpoints say (n, 10), level met less the map before (n,) m,
    and what the surface is off by in the end (n,) m, less its mean."""
    from waam_job.store.folder import JobFolder

    with tempfile.TemporaryDirectory() as scratch:
        cell, result = run(jaw_job(seed=seed, keep=True, jobs_dir=Path(scratch)), kind=Meeting)
        folder = JobFolder.open(result.folder)
        maps = [folder.read_map(n) for n in range(folder.last_map() + 1)]
    met = np.array(cell.met)
    pauses = np.sort(np.argsort(np.diff(met[:, 0]))[2 - len(maps) :]) + 1  # the scans
    width = cell.layers[1][0].width or next(s.width for s in cell.layers[1] if s.width)
    pairs = zip(maps[:-1], maps[1:], np.split(met, pauses), strict=True)
    return [_of_layer(*row, width) for row in pairs]


def _at(layer, values: np.ndarray, x, y) -> np.ndarray:
    cell, (x0, y0) = float(layer['resolution']), (float(v) for v in layer['origin'])
    rows = [(y - y0) / cell - 0.5, (x - x0) / cell - 0.5]
    return map_coordinates(np.nan_to_num(values), rows, order=1, mode='nearest')


def _of_layer(before, after, met: np.ndarray, width: float):
    t, places = met[:, 0], met[:, 1:3]
    begins = np.concatenate([[True], np.diff(t) > 0.05])
    since = t - t[np.maximum.accumulate(np.where(begins, np.arange(len(t)), 0))]
    inside = _at(before, after['interior'].astype(float), *places.T) > 0.9
    thick = _at(before, before['planned'], *places.T)
    asked = np.flatnonzero(inside & (since > STRUCK) & (thick > 0))
    asked = asked[asked % SPAN == 0]
    tree, said = cKDTree(places), []
    for k in asked:
        near = np.array(tree.query_ball_point(places[k], 1.6 * width), int)
        near = near[t[near] < t[k] - BESIDE]
        away = np.hypot(*(places[near] - places[k]).T) / width
        fed = METAL * met[near, 4] / width**2
        said.append([(fed * np.exp(-0.5 * (away / s) ** 2)).sum() for s in SPREADS])
    around, h = np.array(said), thick[asked]
    model = np.column_stack([around, around * h[:, None], h, h**2])
    blurred = gaussian_filter(np.nan_to_num(before['z']), SPOT / float(before['resolution']))
    level = met[asked, 3] - _at(before, blurred, *places[asked].T)
    error = _at(before, after['z'] - after['target'], *places[asked].T)
    return model, level, error - error.mean()


def news_share(jobs: list, layer: int, noise: float) -> float:
    """0..1: share of the variance of a layer's error that the level under the arc foretells beside plan and setpoints;
    layer: index; noise: m, of the level."""
    rows = [job[layer] for job in jobs]
    which = np.repeat(np.eye(len(rows)), [len(r[2]) for r in rows], axis=0)
    model, level, error = (np.concatenate([r[k] for r in rows]) for k in range(3))
    level = level + noise * np.random.default_rng(layer).standard_normal(len(level))
    known = np.column_stack([model, which])
    both = np.column_stack([known, level, level * model[:, 8]])
    return _share(both, error) - _share(known, error)


def _share(said: np.ndarray, error: np.ndarray) -> float:
    scale = np.abs(said).max(axis=0)
    said = said / np.where(scale > 0, scale, 1.0)
    left = error - said @ np.linalg.lstsq(said, error, rcond=None)[0]
    return 1 - float((left**2).sum() / (error**2).sum())
