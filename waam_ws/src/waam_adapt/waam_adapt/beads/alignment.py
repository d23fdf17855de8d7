"""How the passes of a layer lie on those of the layer below, and how much of an error they should answer.

A pass that lies on one of the layer below meets what that one has left, and can answer it. Where passes lie between
those below, or across them, what is finer than a bead belongs to two of them, and an answer makes a new wave.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from .bead_path import beads_of

# Offsets (bead widths) up to which passes lie on those below, and from which on they do not, and what multiplies the
# gain of a law there; between them it changes linearly. Chosen on 26 jobs (docs/adaptation.md).
ON, OFF = 0.05, 0.15
GAIN_ON, GAIN_OFF = 1.2, 1.0


def offset(paths: Sequence[np.ndarray], below: Sequence[np.ndarray], width: float) -> float:
    """Mean distance of the passes from the nearest ones below, across those, in bead widths.

    paths, below: beads from arc on to arc off, (n, 2) m in one frame, at least one each; width: m.
    """
    here, there = (beads_of(_as_bytes(p), width) for p in (paths, below))
    points = np.concatenate([b.where for b in here])
    where, tangent = (
        np.concatenate(found) for found in zip(*((b.where, b.tangent) for b in there), strict=True)
    )
    nearest = cKDTree(where).query(points)[1]
    away, along = points - where[nearest], tangent[nearest]
    across = np.abs(away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0])
    return float(across.mean()) / width


def gain(passes_off: float) -> float:
    """Factor of the gain of a law; passes_off: `offset`, bead widths."""
    return float(np.interp(passes_off, (ON, OFF), (GAIN_ON, GAIN_OFF)))


def _as_bytes(paths: Sequence[np.ndarray]) -> tuple[bytes, ...]:
    return tuple(np.ascontiguousarray(p, float).tobytes() for p in paths)
