"""The beads of a job from its telemetry: from the arc's start to its end. Arrays in, plain values out; SI."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

MOVING = 1e-3  # m/s, below which power over speed says nothing
GAP_S = 1.5  # between two rows, from which on a run has ended between them


@dataclass(frozen=True)
class Bead:
    """Arc on to arc off. Means over the time of the arc; NaN = not recorded. start: s from the first sample."""

    layer: int
    start: float
    duration: float
    current: float
    voltage: float
    wire_feed: float
    speed: float
    heat_input: float  # J/m, mean of voltage x current / travel speed, as in the table of layers
    temperature: float  # °C, of the part when the arc started


def _stretches(t: dict[str, np.ndarray]) -> list[tuple[int, int]]:
    """(first, last + 1) sample of each stretch with the arc on."""
    arc = np.asarray(t.get('arc', np.zeros(len(t['t'])))) > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], arc, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _changed(t: dict[str, np.ndarray], row: int) -> float:
    """When the arc changed, s, as exactly as it is recorded."""
    row = min(row, len(t['t']) - 1)
    exact = float(t['arc_changed'][row]) if 'arc_changed' in t else math.nan
    return exact if math.isfinite(exact) else float(t['t'][row])


def beads(t: dict[str, np.ndarray]) -> list[Bead]:
    """All, in the order in which they were laid; [] without telemetry."""
    if not t:
        return []
    found = []
    for a, b in _stretches(t):
        # what was cut off ended with its run, not when the next one began
        start, end = _changed(t, a), min(_changed(t, b), float(t['t'][b - 1]) + GAP_S)

        def column(name: str, a: int = a, b: int = b) -> np.ndarray:
            return np.asarray(t.get(name, np.full(len(t['t']), np.nan)), float)[a:b]

        speed, power = column('speed'), column('current') * column('voltage')
        moving = speed > MOVING
        found.append(
            Bead(
                layer=int(column('layer')[0]) if 'layer' in t else 0,
                start=start - float(t['t'][0]),
                duration=end - start,
                current=_mean(column('current')),
                voltage=_mean(column('voltage')),
                wire_feed=_mean(column('wire_feed')),
                speed=_mean(speed),
                heat_input=_mean(power[moving] / speed[moving]),
                temperature=float(column('temperature')[0]),
            )
        )
    return found


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def arc_ends(t: dict[str, np.ndarray], layer: int) -> list[tuple[str, float, float]]:
    """('arc start' or 'arc end', x, y in m) of a layer, in time."""
    if not {'x', 'y', 'arc', 'layer'} <= t.keys():
        return []
    found = []
    for a, b in _stretches(t):
        if t['layer'][a] == layer:
            found.append(('arc start', float(t['x'][a]), float(t['y'][a])))
            found.append(('arc end', float(t['x'][b - 1]), float(t['y'][b - 1])))
    return found
