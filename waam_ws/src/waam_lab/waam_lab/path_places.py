"""Places of a layer's path where metal piles up or is missing: turns, gaps between turns, corners, starts and ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_process.segment import Segment

CORNER = math.radians(30)  # smaller bends are none
TURNED = math.radians(150)  # two corners on a short leg that bend the path by so much are one turn
LEG = 1.5  # bead widths: longest way between the two corners of a turn
NEXT = 2.6  # bead widths: turns on one side that are farther apart have no gap between them


@dataclass(frozen=True)
class Places:
    """Middles (n, 2) m by kind: turn, gap (between two turns on one side), corner, start, end."""

    of: dict[str, np.ndarray]

    def masks(self, x: np.ndarray, y: np.ndarray, radius: float) -> dict[str, list[np.ndarray]]:
        """Cells (rows, cols) within `radius` (m) of every place; x (cols,), y (rows,) m."""
        return {
            kind: [np.hypot(x[None] - p[0], y[:, None] - p[1]) <= radius for p in middles]
            for kind, middles in self.of.items()
        }


def places(segments: list[Segment], width: float) -> Places:
    """segments of a layer in the order they are laid, m; width: of a bead, m."""
    runs = _runs(segments)
    turns, corners = [], []
    for run in runs:
        t, c = _turns_and_corners(run, LEG * width)
        turns += t
        corners += c
    gaps = [
        (a + b) / 2
        for a, b in zip(turns, turns[2:], strict=False)
        if np.linalg.norm(b - a) < NEXT * width
    ]
    ends = {'start': [r[0] for r in runs], 'end': [r[-1] for r in runs]}
    found = {'turn': turns, 'gap': gaps, 'corner': corners, **ends}
    return Places({kind: np.array(at, float).reshape(-1, 2) for kind, at in found.items()})


def _runs(segments: list[Segment]) -> list[np.ndarray]:
    """(n, 2) m points of every stretch with the arc on."""
    runs: list[list[tuple[float, float]]] = []
    burning = False
    for s in segments:
        moves = s.arc and s.length > 0
        if moves and not burning:
            runs.append([s.start[:2]])
        if moves:
            runs[-1].append(s.end[:2])
        burning = s.arc and (burning or moves)
    return [np.array(r) for r in runs]


def _turns_and_corners(run: np.ndarray, leg: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    step = np.diff(run, axis=0)
    angle = np.arctan2(step[:, 1], step[:, 0])
    bend = (np.diff(angle) + np.pi) % (2 * np.pi) - np.pi
    sharp = np.flatnonzero(np.abs(bend) > CORNER) + 1
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
    turns, corners = [], []
    i = 0
    while i < len(sharp):
        j = i
        while j + 1 < len(sharp) and along[sharp[j + 1]] - along[sharp[i]] <= leg:
            j += 1
        if j > i and abs(bend[sharp[i : j + 1] - 1].sum()) > TURNED:
            turns.append((run[sharp[i]] + run[sharp[j]]) / 2)
            i = j + 1
        else:
            corners.append(run[sharp[i]])
            i += 1
    return turns, corners
