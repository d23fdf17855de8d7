"""Beads out of the telemetry of a job: which bead every sample belongs to, and the means of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .content import Row

STEP = 1e-3  # m between the points that a planned path is searched by


@dataclass(frozen=True)
class Paths:
    """Planned deposition, one entry per segment: layer and bead (n,) int, start and end (n, 3) m."""

    layer: np.ndarray
    bead: np.ndarray
    start: np.ndarray
    end: np.ndarray

    @classmethod
    def none(cls) -> Paths:
        """No plan is known."""
        return cls(np.empty(0, int), np.empty(0, int), np.empty((0, 3)), np.empty((0, 3)))


def bead_rows(job: str, track: dict[str, np.ndarray], paths: Paths) -> list[Row]:
    """Table beads. track: columns (n,) of telemetry as in docs/job_folder.md (t, x, y, z, current, ... SI)."""
    if not track or not len(track['t']):
        return []
    on = np.flatnonzero((track['arc'] > 0.5) & (track['layer'] >= 1))
    rows: list[Row] = []
    for layer in np.unique(track['layer'][on]):
        mine = on[track['layer'][on] == layer]
        numbers, how = _numbered(track, mine, paths, int(layer))
        rows += _layer_rows(job, int(layer), track, mine, numbers, how)
    return rows


def _numbered(
    track: dict[str, np.ndarray], mine: np.ndarray, paths: Paths, layer: int
) -> tuple[np.ndarray, str]:
    """Bead of every sample, from the nearest planned path or by counting arcs."""
    of_layer = np.flatnonzero(paths.layer == layer)
    if not of_layer.size:
        return np.cumsum(np.diff(mine, prepend=mine[0] - 2) > 1), 'arc'
    points, bead = _points(paths, of_layer)
    place = np.stack([track[c][mine] for c in 'xyz'], axis=1)
    _, nearest = cKDTree(points).query(np.nan_to_num(place))
    return bead[nearest], 'plan'


def _points(paths: Paths, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 3) along the segments, at most STEP apart, with the bead of each."""
    start, end = paths.start[chosen], paths.end[chosen]
    count = np.maximum(1, np.ceil(np.linalg.norm(end - start, axis=1) / STEP)).astype(int)
    of = np.repeat(np.arange(len(chosen)), count)
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(len(of)) - first + 0.5) / count[of]
    return start[of] + share[:, None] * (end - start)[of], paths.bead[chosen][of]


def _layer_rows(
    job: str,
    layer: int,
    track: dict[str, np.ndarray],
    mine: np.ndarray,
    numbers: np.ndarray,
    how: str,
) -> list[Row]:
    """One row per bead, in the order of their begin."""
    beads, first, of, count = np.unique(
        numbers, return_index=True, return_inverse=True, return_counts=True
    )
    dt = _period(track['t'])

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(of, np.nan_to_num(values), len(beads))

    power = track['current'][mine] * track['voltage'][mine]
    speed = track['speed'][mine]
    struck = np.diff(mine, prepend=mine[0] - 2) > 1
    means = {
        'current_A': total(track['current'][mine]) / count,
        'voltage_V': total(track['voltage'][mine]) / count,
        'wire_feed_m_s': total(track['wire_feed'][mine]) / count,
        'travel_speed_m_s': total(speed) / count,
        'heat_input_J_m': total(power / np.where(speed > 1e-4, speed, np.inf)) / count,
        'arc_on_s': count * dt,
        'length_m': total(speed) * dt,
        'energy_J': total(power) * dt,
        'wire_m': total(track['wire_feed'][mine]) * dt,
    }
    at = mine[first]
    begin = {'start_s': track['t'][at] - track['t'][0], 'temperature_C': track['temperature'][at]}
    begin |= {f'{c}_m': track[c][at] for c in 'xyz'}
    columns = {k: v.tolist() for k, v in (means | begin).items()}
    columns |= {'bead': beads.tolist(), 'strikes': total(struck).astype(int).tolist()}
    return [
        {'job': job, 'layer': layer, 'numbered': how, **{k: v[i] for k, v in columns.items()}}
        for i in np.argsort(first, kind='stable')
    ]


def _period(t: np.ndarray) -> float:
    """s between samples, 0.1 when there is only one."""
    steps = np.diff(t)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return float(np.median(steps)) if steps.size else 0.1
