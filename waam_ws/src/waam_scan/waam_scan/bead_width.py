"""The width of the beads that a layer was laid with, from the maps before and after it, with its uncertainty.

A section across a bead shows its width where the bead, or its outer side, stands free: nothing was laid beside it, and
what lies below goes on evenly. There the growth is a parabola (the section of a bead, source 000), and the bead ends at
its foot. The first beads of a layer are laid on colder metal than most of it; sections of later ones are taken where
there are any. Sides of walls, and beads between others, have no foot of their own and give nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

STEP = 1e-3  # m of path between sections
BLOCK = 10e-3  # m of path over which sections go together
ENDS = 10e-3  # m of every stretch that do not count at either end: start hump, crater
STRAIGHT = (
    6e-3,
    0.998,
)  # m to either side within which the path must not turn, and cosine of what is no turn
SECTION_WIDTHS = 1.05  # bead widths to either side that a section covers
FOOT = 0.75  # bead widths from the path beyond which a free side shows no growth
CAP = 0.25  # share of the crown's height above which cells belong to the section
LOWEST = 0.3e-3  # m: lower crowns are no bead
BESIDE = 0.12  # share of the crown's height that may have grown beside a free side
UNEVEN = (
    0.5  # share of the crown's height by which the metal below may rise or fall towards the foot
)
MISFIT = 0.15  # share of the crown's height that the section may differ from its parabola, RMS
FEWEST = 5  # cells of a section
SECTIONS, BLOCKS = 5, 2  # that a width needs
COLD = 0.2  # of a layer's path, at its begin: laid on cold metal, narrower than the rest
ALIKE = (
    0.03  # share of the width by which sections may always differ: the scatter of a few says little
)


@dataclass(frozen=True)
class BeadWidth:
    """Mean over all sections that show one. NaN and 0 sections where none does."""

    width: float = math.nan  # m
    u: float = math.nan  # m, standard uncertainty of the mean
    expected: float = math.nan  # m, mean over the same sections of what was expected
    sections: int = 0


@dataclass(frozen=True)
class Sections:
    """n places along the paths, and m points across each. Lengths m."""

    block: np.ndarray  # (n,) number of the stretch of BLOCK
    expected: np.ndarray  # (n,)
    across: np.ndarray  # (m,) from the path, to the left of the travel positive
    x: np.ndarray  # (n, m)
    y: np.ndarray  # (n, m)


def bead_width(
    before: np.ndarray,
    after: np.ndarray,
    spec: GridSpec,
    paths: Sequence[np.ndarray],
    expected: Sequence[np.ndarray],
) -> BeadWidth:
    """before, after: (rows, cols) m, NaN = not seen. paths: each (n, 2) m, work frame, from arc on to arc off.

    expected: of each path (n,) m, width that is expected of the piece that ends at that point.
    """
    places = sections(paths, expected, spec.resolution)
    if places is None:
        return BeadWidth()
    below = HeightGrid(spec, before).sample(places.x, places.y)
    growth = HeightGrid(spec, after).sample(places.x, places.y) - below
    widths = section_widths(growth, below, places.across, places.expected)
    warm = np.arange(len(widths)) >= COLD * len(widths)
    found = _mean(np.where(warm, widths, np.nan), places)
    return found if found.sections else _mean(widths, places)


def sections(
    paths: Sequence[np.ndarray], expected: Sequence[np.ndarray], resolution: float
) -> Sections | None:
    """Of the straight parts of the paths, `resolution` (m) between the points of each; None = there are none."""
    found = [_stations(p, w, i) for i, (p, w) in enumerate(zip(paths, expected, strict=True))]
    rows = np.concatenate([np.empty((0, 6)), *found])
    if not len(rows):
        return None
    at, unit, width, block = rows[:, :2], rows[:, 2:4], rows[:, 4], rows[:, 5]
    half = math.ceil(SECTION_WIDTHS * float(width.max()) / resolution)
    across = resolution * np.arange(-half, half + 1)
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    x, y = (at[:, i, None] + across * normal[:, i, None] for i in (0, 1))
    return Sections(block.astype(int), width, across, x, y)


def _stations(path: np.ndarray, expected: np.ndarray, number: int) -> np.ndarray:
    """(n, 6): x, y, direction of travel (x, y), expected width, number of the block."""
    steps = np.diff(path, axis=0)
    lengths = np.hypot(*steps.T)
    keep = lengths > 1e-9
    steps, lengths, width = steps[keep], lengths[keep], np.asarray(expected, float)[1:][keep]
    ends = np.cumsum(lengths)
    if not len(ends) or ends[-1] <= 2 * ENDS:
        return np.empty((0, 6))
    units = steps / lengths[:, None]

    def piece(s: np.ndarray) -> np.ndarray:
        return np.minimum(np.searchsorted(ends, s, side='left'), len(ends) - 1)

    s = np.arange(ENDS, ends[-1] - ENDS, STEP)
    here = piece(s)
    unit = units[here]
    reach, cosine = STRAIGHT
    straight = np.ones(len(s), bool)
    for aside in np.linspace(-reach, reach, 9):
        straight &= (units[piece(s + aside)] * unit).sum(axis=1) >= cosine
    at = path[0] + np.stack(
        [
            np.interp(s, np.append(0.0, ends), np.append(0.0, np.cumsum(steps[:, i])))
            for i in (0, 1)
        ],
        axis=1,
    )
    block = 10_000 * number + np.floor(s / BLOCK)
    return np.column_stack([at, unit, width[here], block])[straight]


def section_widths(
    growth: np.ndarray, below: np.ndarray, across: np.ndarray, expected: np.ndarray
) -> np.ndarray:
    """(n,) m, NaN where no side is free. growth, below: (n, m) m, NaN = not seen; across (m,), expected (n,) m."""
    share = across / expected[:, None]  # (n, m) bead widths from the path
    known = np.isfinite(growth)
    grown = np.where(known, growth, 0.0)
    top = np.where(np.abs(share) < 0.5, grown, 0.0).max(axis=1)
    free = {
        side: _free(side * share, known, grown, top) & _even(side * share, below, top)
        for side in (-1, 1)
    }
    high = known & (growth > CAP * top[:, None])
    both = free[-1] & free[1] & (top > LOWEST)
    found = np.where(both, _two_sides(across, grown, high & (np.abs(share) < 0.75), top), np.nan)
    for side, other in ((-1, 1), (1, -1)):
        use = high & (side * share > -0.1) & (side * share < 0.75)
        one = free[side] & ~free[other] & (top > LOWEST)
        found = np.where(one, _one_side(across, grown, use, top), found)
    return np.where((found > 0.4 * expected) & (found < 1.6 * expected), found, np.nan)


def _free(share: np.ndarray, known: np.ndarray, grown: np.ndarray, top: np.ndarray) -> np.ndarray:
    """(n,) bool: nothing has grown beside the bead on the side of positive `share`."""
    there = (share > FOOT) & (share < SECTION_WIDTHS)
    seen = (there & known).sum(axis=1)
    much = (there & known & (np.abs(grown) > BESIDE * top[:, None])).sum(axis=1)
    return (seen >= 0.5 * there.sum(axis=1)) & (seen > 0) & (much <= 0.2 * seen)


def _even(share: np.ndarray, below: np.ndarray, top: np.ndarray) -> np.ndarray:
    """(n,) bool: the metal below goes on, from the middle of the bead to beyond its foot."""
    there = (share > -0.1) & (share < FOOT)
    seen = there & np.isfinite(below)
    low, high = (
        np.where(seen, below, np.inf).min(axis=1),
        np.where(seen, below, -np.inf).max(axis=1),
    )
    return (seen.sum(axis=1) >= FEWEST) & (high - low <= UNEVEN * top)


def _two_sides(
    across: np.ndarray, grown: np.ndarray, use: np.ndarray, top: np.ndarray
) -> np.ndarray:
    """Distance of the zeros of a x^2 + b x + c through the cells in use, (n,) m."""
    scale = 1e-3
    powers = np.stack([np.ones_like(across), across / scale, (across / scale) ** 2], axis=1)
    c, b, a = _fit(powers, grown, use, top)
    square = b * b - 4 * a * c
    good = (a < 0) & (square > 0)
    return np.where(
        good, scale * np.sqrt(np.where(good, square, 1.0)) / -np.where(good, a, -1), np.nan
    )


def _one_side(
    across: np.ndarray, grown: np.ndarray, use: np.ndarray, top: np.ndarray
) -> np.ndarray:
    """Twice the distance from the path to the zero of a x^2 + c, (n,) m: the bead lies in the middle of its path."""
    scale = 1e-3
    powers = np.stack([np.ones_like(across), (across / scale) ** 2], axis=1)
    c, a = _fit(powers, grown, use, top)
    good = (a < 0) & (c > 0)
    return np.where(
        good, 2 * scale * np.sqrt(np.where(good, c / -np.where(good, a, -1), 1.0)), np.nan
    )


def _fit(powers: np.ndarray, grown: np.ndarray, use: np.ndarray, top: np.ndarray) -> np.ndarray:
    """(k, n) coefficients of the least squares of each of n sections; NaN where it is not met or has too few cells."""
    weight = use.astype(float)
    normal = np.einsum('nm,mi,mj->nij', weight, powers, powers)
    right = np.einsum('nm,mi->ni', weight * grown, powers)
    count = weight.sum(axis=1)
    good = (count >= FEWEST) & (np.linalg.cond(normal) < 1e10)
    normal[~good] = np.eye(powers.shape[1])
    found = np.linalg.solve(normal, right[..., None])[..., 0]
    off = weight * (grown - found @ powers.T)
    rms = np.sqrt((off**2).sum(axis=1) / np.maximum(count, 1))
    good &= rms <= MISFIT * top
    return np.where(good[:, None], found, np.nan).T


def _mean(widths: np.ndarray, places: Sections) -> BeadWidth:
    """Over the sections that agree. Those of a block go together, so the scatter is that of the blocks."""
    seen = np.isfinite(widths)
    if seen.sum() < SECTIONS:
        return BeadWidth()
    relative = np.where(seen, widths / places.expected, np.nan)
    off = np.abs(relative - np.median(relative[seen]))
    seen &= off <= max(4 * 1.4826 * np.median(off[seen]), ALIKE)
    numbers = places.block[seen]
    means = np.array([widths[seen][numbers == b].mean() for b in np.unique(numbers)])
    if seen.sum() < SECTIONS or len(means) < BLOCKS:
        return BeadWidth()
    u = means.std(ddof=1) / math.sqrt(len(means))
    expected = float(places.expected[seen].mean())
    return BeadWidth(float(widths[seen].mean()), float(u), expected, int(seen.sum()))
