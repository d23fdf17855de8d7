"""Which way round a layer is laid, so that the scanner beside the torch sees its finished metal while the arc burns.

The scanner rides at a fixed place beside the torch. It sees a place that is finished only if the torch comes by, at the
scanner's distance, after the last bead there. Where the last beads run away from the scanner it trails behind them.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from waam_plan.fill.hatch import Chain
from waam_plan.settings import PlanSettings

STEP = 1e-3  # m between the points that are compared
MOST = 1500  # of them
NEAR = 0.75  # bead widths from its path within which a bead changes the surface
WORTH = 0.05  # share of the layer that must be seen more


def trailing(chains: list[Chain], below: np.ndarray, settings: PlanSettings) -> list[Chain]:
    """The chains (m, work frame), laid the other way round where the scanner then sees more of them finished.

    below: (n, 2) m, arc starts of the layer below. Neighbouring layers begin on opposite sides of the part as before:
    laid twice in the same order, a part comes out a tenth worse (docs/in_layer.md). Rings stay as they are: from the
    edge inwards is not as good as from the inside outwards.
    """
    if not chains or any(_closed(line) for chain in chains for line in chain):
        return chains
    other = [[line[::-1] for line in chain[::-1]] for chain in chains[::-1]]
    if len(below):
        nearer = _across(chains, below) - _across(other, below)
        if abs(nearer) > settings.pitch:
            return chains if nearer > 0 else other
    more = seen_finished(other, settings) - seen_finished(chains, settings)
    return other if more > WORTH else chains


def seen_finished(chains: list[Chain], settings: PlanSettings) -> float:
    """Share (0..1) of the path that the scanner sees after the last bead beside it."""
    lines = [line for chain in chains for line in chain]
    length = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
    step = max(STEP, length / MOST)
    at = np.concatenate([_points(line, step) for line in lines])
    reach = NEAR * settings.bead_width
    last = np.array([max(near) for near in cKDTree(at).query_ball_point(at, reach)])
    dx, dy, _ = settings.scanner_offset
    along = np.abs(at[None, :, 0] + dx - at[:, None, 0]) <= step
    across = np.abs(at[None, :, 1] + dy - at[:, None, 1]) <= settings.scanner_fov / 2
    later = np.arange(len(at))[None] > last[:, None]
    return float((along & across & later).any(axis=1).mean())


def _points(line: np.ndarray, step: float) -> np.ndarray:
    """(n, 2) m along a line, a step apart."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(step / 2, max(along[-1], step), step)
    return np.column_stack([np.interp(at, along, line[:, k]) for k in (0, 1)])


def _across(chains: list[Chain], below: np.ndarray) -> float:
    """m across the first bead from its start to the nearest arc start of the layer below."""
    line = chains[0][0]
    along = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    return float(np.abs((below - line[0]) @ [-along[1], along[0]]).min())


def _closed(line: np.ndarray) -> bool:
    return bool(np.allclose(line[0], line[-1], atol=1e-9))
