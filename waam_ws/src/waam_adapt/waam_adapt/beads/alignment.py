"""How the passes of a layer lie on those of the layer below, and how much of an error they should answer.

A pass that lies on one of the layer below meets what that one has left, and can answer it. Where passes lie between
those below, or across them, what is finer than a bead belongs to two of them, and an answer makes a new wave.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from .bead_path import as_bytes, beads_of

# Offsets (bead widths) up to which passes lie on those below, and from which on they do not; between them the factor
# changes linearly. Chosen on 26 jobs (docs/adaptation.md).
ON, OFF = 0.05, 0.15
MOST = 1.2  # factor of the gain of passes that lie on those below


def offset(paths: Sequence[np.ndarray], below: Sequence[np.ndarray], width: float) -> float:
    """Mean distance of the passes from the nearest ones below, across those, in bead widths.

    paths, below: beads from arc on to arc off, (n, 2) m in one frame, at least one each; width: m.
    """
    here, there = (beads_of(as_bytes(p), width) for p in (paths, below))
    points = np.concatenate([b.where for b in here])
    where = np.concatenate([b.where for b in there])
    tangent = np.concatenate([b.tangent for b in there])
    nearest = cKDTree(where).query(points)[1]
    away, along = points - where[nearest], tangent[nearest]
    across = np.abs(away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0])
    return float(across.mean()) / width


def gain(passes_off: float) -> float:
    """Factor of the gain of a law, 1 .. MOST; passes_off: `offset`, bead widths."""
    return float(np.interp(passes_off, (ON, OFF), (MOST, 1.0)))
