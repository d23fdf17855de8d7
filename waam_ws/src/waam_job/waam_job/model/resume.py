"""Where to resume an interrupted layer: the new scan against the surface before the layer and the checkpoint.

Pure. Segments of a layer are laid in order, so the surface has one change point: metal before it, none after it. The
checkpoint says from where to where it can lie, the scan where in between. A place between rings that are already there
looks half full before its own bead is laid, so the scan alone could take an inner bead for laid: a place that is bare
was not laid, whatever lies behind it.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from waam_plan.plan import PlannedLayer
from waam_process.grid import HeightGrid
from waam_process.segment import Kind, Point, Segment

from .shift import LIMIT, SEARCH, Shift

PRESENT = 0.5  # share of the planned metal above which a place counts as laid
# the same of the last bead that is done and of one that was begun: the neighbour that would fill its side is not there
BEGUN = 0.25
BARE = 0.5  # bead widths of path with less than PRESENT of their metal, on which nothing was laid
END_REACH = 0.75  # bead widths that the end of an interrupted bead goes beyond the place where half of it is there
# least share of its metal that a segment gets, however much is there: the arc needs wire
MIN_METAL_SHARE = 0.3
COLDEST = 0.8  # of its metal that a bead gets on the coldest part
CHECKPOINT_REACH = 3.0  # s of planned travel that may have been laid after a checkpoint was written
MIN_SEGMENTS_OF_BEGUN_BEAD = 5  # segments; the metal of a begun bead is looked for when it has more
MOVED_LIMIT = 0.15e-3  # m, median change of the surface where nothing was to be laid


class ResumeError(ValueError):
    """The surface and what is on disk do not belong together; the text says where and by how much."""


@dataclass(frozen=True)
class Progress:
    """`done` of `total` deposit segments of the layer are on the part; shares: (total,) found of their metal."""

    done: int
    total: int
    bead: int  # the bead with which deposition goes on; 0 = all are done
    shares: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def complete(self) -> bool:
        """All segments of the layer are on the part."""
        return self.done >= self.total


def metal_shares(layer: PlannedLayer, before: HeightGrid, now: HeightGrid) -> np.ndarray:
    """(n,) measured over planned growth along the n deposit segments, NaN where unseen.

    The median over a disc of a quarter of a bead, so that spikes and the crown of the bead do not count.
    """
    deposits, spec = layer.deposits, before.spec
    growth = now.z - before.z
    middle = np.array([s.midpoint[:2] for s in deposits]).reshape(-1, 2)
    reach = max(1, round(0.25 * deposits[0].width / spec.resolution)) if deposits else 1
    offsets = [
        (r, c)
        for r in range(-reach, reach + 1)
        for c in range(-reach, reach + 1)
        if r * r + c * c <= reach * reach
    ]
    rows, cols = spec.cell(middle[:, 0], middle[:, 1])
    seen = np.full((len(offsets), len(deposits)), np.nan)
    for k, (dr, dc) in enumerate(offsets):
        r = np.clip(rows.astype(int) + dr, 0, spec.rows - 1)
        c = np.clip(cols.astype(int) + dc, 0, spec.cols - 1)
        asked = layer.planned[r, c]
        usable = asked > 1e-4
        seen[k, usable] = growth[r, c][usable] / asked[usable]
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # places that were not seen at all stay NaN
        return np.nanmedian(seen, axis=0)


def change_point(
    shares: np.ndarray,
    lengths: np.ndarray,
    middles: np.ndarray,
    bead_width: float,
    within: tuple[int, int] | None = None,
) -> int:
    """k with segments [0, k) laid and [k, n) not, from the (n,) shares of metal found, NaN = unseen.

    within: least and greatest k; None = 0 and n.

    Metal of a segment also lies beside it: with k laid, the share expected at segment i is the part of its
    neighbours' influence (a Gaussian of 0.3 bead widths over the distance of `middles` (n, 2) m) that is laid. k and a
    common efficiency of 0.5 to 1.2 are fitted by least squares, weighted with `lengths`.
    """
    n = len(shares)
    weight = np.where(np.isfinite(shares), lengths, 0.0)
    found = np.clip(np.nan_to_num(shares), -0.2, 1.5)
    tree = cKDTree(middles)
    near = tree.query_ball_point(middles, 1.2 * bead_width)
    reach = [np.exp(-0.5 * _square(middles[j] - middles[i]) / (0.3 * bead_width) ** 2)
             for i, j in enumerate(near)]  # fmt: skip
    total = np.array([r.sum() for r in reach])
    expected = np.zeros(n)
    cross = square = 0.0  # sums of weight * found * expected and weight * expected**2
    least, most = within or (0, n)
    best, best_gain = least, 0.0 if least == 0 else -math.inf
    for k in range(most):
        i, add = near[k], reach[k] / total[near[k]]
        cross += float(np.sum(weight[i] * found[i] * add))
        square += float(np.sum(weight[i] * add * (2 * expected[i] + add)))
        expected[i] += add
        scale = min(max(cross / square, 0.5), 1.2) if square > 0 else 1.0
        gain = 2 * scale * cross - scale**2 * square  # what the sum of squares falls by
        if k + 1 >= least and gain > best_gain:
            best, best_gain = k + 1, gain
    return best


def first_bare(shares: np.ndarray, lengths: np.ndarray, bead_width: float, least: int) -> int:
    """First segment, `least` or a later one, from which on BARE bead widths of the path have less than PRESENT of their
    metal; n when there is none.

    shares (n,): found of the metal, NaN = unseen, which is not bare; lengths (n,): m. Such a place was not laid. One
    that is full may be full of its neighbours: in the middle of a spiral before its own bead comes.
    """
    first, path = least, 0.0
    for i in range(least, len(shares)):
        if shares[i] < PRESENT:
            path += lengths[i]
        else:
            first, path = i + 1, 0.0
        if path >= BARE * bead_width:
            return first
    return len(shares)


def _square(vectors: np.ndarray) -> np.ndarray:
    return np.sum(vectors**2, axis=-1)


def check_unmoved(
    layer: PlannedLayer, before: HeightGrid, now: HeightGrid, keep_off: float
) -> float:
    """Median |change| (m) of the surface farther than `keep_off` m from the layer; ResumeError above the limit."""
    far = distance_transform_edt(~layer.footprint) * before.spec.resolution > keep_off
    known = far & np.isfinite(before.z) & np.isfinite(now.z)
    if known.sum() < 50:
        return math.nan
    change = (now.z - before.z)[known]
    moved = float(np.median(np.abs(change)))
    if moved > MOVED_LIMIT:
        raise ResumeError(
            f'the surface beside layer {layer.number} changed by {np.median(change) * 1e3:+.2f} mm (median of '
            f'{moved * 1e3:.2f} mm, limit {MOVED_LIMIT * 1e3:.2f} mm): the part was moved or another one lies there'
        )
    return moved


def progress_of(
    layer: PlannedLayer,
    before: HeightGrid,
    now: HeightGrid,
    beads_done: int = 0,
    laid: int | None = None,
) -> Progress:
    """How much of the layer is on the part.

    beads_done, laid: beads and deposit segments that the checkpoint calls done; laid None = it does not say, and the
    scan decides alone. ResumeError when metal that the checkpoint calls done is missing.
    """
    deposits = layer.deposits
    if not deposits:
        return Progress(0, 0, 0)
    shares = metal_shares(layer, before, now)
    beads = list(dict.fromkeys(s.bead for s in deposits))
    least, most = laid_range(deposits, beads_done, laid)
    for number, bead in enumerate(beads, 1):
        mine = [i for i, s in enumerate(deposits[:least]) if s.bead == bead]
        if number <= beads_done or len(mine) > MIN_SEGMENTS_OF_BEGUN_BEAD:
            least_share = PRESENT if number < beads_done else BEGUN
            begun = ', begun' if number > beads_done else ''
            which = f'{number} of {len(beads)}{begun}'
            _require(least_share, shares[mine], deposits[mine[0]], which)
    lengths, width = np.array([s.length for s in deposits]), max(s.width for s in deposits)
    if laid is not None:
        most = min(most, first_bare(shares, lengths, width, least))
    middles = np.array([s.midpoint[:2] for s in deposits])
    done = change_point(shares, lengths, middles, width, (least, most))
    bead = deposits[done].bead if done < len(deposits) else 0
    return Progress(done, len(deposits), bead, shares)


def laid_range(deposits: list[Segment], beads_done: int, laid: int | None) -> tuple[int, int]:
    """How many deposits at least, and at most, are on the part; beads_done, laid: as of `progress_of`."""
    done = set(list(dict.fromkeys(s.bead for s in deposits))[:beads_done])
    least = max(sum(s.bead in done for s in deposits), laid or 0)
    return least, len(deposits) if laid is None else _farthest(deposits, least)


def check_place(shift: Shift, layer: int) -> None:
    """ResumeError where the part does not lie in its place, with what to do."""
    if shift.moved:
        raise ResumeError(
            f'the part was moved: layer {layer} lies up to {shift.words} about its middle (limit '
            f'{LIMIT * 1e3:.2f} mm). Move it back and resume again, or start a new job on the part as it lies'
        )
    if shift.other_part:
        raise ResumeError(
            f'another part lies there: {shift.misfit:.0%} of what is seen fits to the map before layer {layer} at no '
            f'place within {SEARCH * 1e3:.0f} mm. Clamp the part of this job where it lay, or start a new job'
        )


def _require(least: float, shares: np.ndarray, first: Segment, which: str) -> None:
    """ResumeError where less than the share `least` of a bead, or of what was laid of it, is on the part."""
    share = np.nanmedian(shares) if np.isfinite(shares).any() else math.nan
    if share < least:
        x, y, _ = first.start
        raise ResumeError(
            f'layer {first.layer}: bead {first.bead} ({which}) at x = {x * 1e3:.1f} mm, y = {y * 1e3:.1f} mm was laid, '
            f'but the scan finds {share:.0%} of its metal'
        )


def _farthest(deposits: list[Segment], laid: int) -> int:
    """Segments that can have been laid when `laid` were at the last checkpoint."""
    spent = np.cumsum([s.duration for s in deposits[laid:]])
    return laid + int(np.searchsorted(spent, CHECKPOINT_REACH, side='right'))


def cold_share(before: float, now: float, per_kelvin: float) -> float:
    """Share of its metal that a bead gets on a part that has cooled from `before` to `now` degC since the layer was
    interrupted: it is narrower there, so less of it ends beside the part. 1 when a temperature is not known (NaN)."""
    share = 1 - per_kelvin * max(before - now, 0.0)
    return max(share, COLDEST) if math.isfinite(share) else 1.0


def rest_of(
    layer: PlannedLayer, progress: Progress, share: float = 1.0, start: float = 1.0
) -> PlannedLayer:
    """The layer from the change point on, with `share` of its metal. Its maps stay those of the whole layer, so the
    correction does too; a path that was begun goes on as `restart` says, with `start` of its metal over the first bead
    width, for metal piles up where an arc starts."""
    if progress.complete:
        return replace(layer, segments=[])
    first, beginning, missing = restart(layer.deposits, progress, start)
    at = next(i for i, s in enumerate(layer.segments) if s is layer.deposits[first])
    rest = [s.at(height=s.height * share * missing.get(s.index, 1.0)) for s in layer.segments[at:]]
    if beginning is not None:
        rest[0] = rest[0].at(start=beginning)
    elif at and layer.segments[at - 1].kind == Kind.DWELL and layer.segments[at - 1].arc:
        rest.insert(0, layer.segments[at - 1])  # the arc burns before the torch moves
    return replace(layer, segments=rest)


def restart(
    deposits: list[Segment], progress: Progress, start: float = 1.0
) -> tuple[int, Point | None, dict[int, float]]:
    """Where deposition goes on: the segment, the point of it (None: its start, a new path), and the share of its metal
    that a segment still needs, by index.

    The end of a bead is round, and the pool that trailed the arc set ahead of its place. A path that was begun goes on
    where half of its metal is there, and what lies within `END_REACH` beyond that point is not laid again. `start` is
    the share of the metal over the first bead width from there.
    """
    done = progress.done
    path = begun_path(deposits, done)
    if not path:
        return done, None, {}
    edges = np.cumsum([0.0] + [deposits[i].length for i in path])  # along the path
    middles, change = 0.5 * (edges[1:] + edges[:-1]), edges[done - path.start]
    reach = END_REACH * deposits[done].width
    found = np.nan_to_num(progress.shares)
    there = share_of_end(found[path.start : path.stop], middles - change, reach, found[:done])

    fine = change + np.linspace(-reach, reach, 201)
    half = fine[np.interp(fine, middles, there) >= 0.5]
    end = min(max(half[-1] if half.size else fine[0], 0.0), edges[-1] - 1e-4)
    k = int(np.searchsorted(edges, end, side='right')) - 1
    s, part = deposits[path[k]], (end - edges[k]) / (edges[k + 1] - edges[k])
    x, y, z = (float(a + (b - a) * part) for a, b in zip(s.start, s.end, strict=True))
    there[k] = np.interp(0.5 * (end + edges[k + 1]), middles, there)
    lacks = np.where(middles < end + reach, 1 - there, 1.0)
    lacks *= np.where(middles < end + s.width, start, 1.0)
    missing = {
        deposits[path[i]].index: float(np.clip(lacks[i], MIN_METAL_SHARE, 1.0))
        for i in range(k, len(path))
    }
    return path[k], (x, y, z), missing


def begun_path(deposits: list[Segment], done: int) -> range:
    """The deposits that the arc lays in one go with segment `done`; none when that is the first of them."""
    joined = [math.dist(a.end, b.start) < 1e-6 for a, b in pairwise(deposits)]
    if done == 0 or not joined[done - 1]:
        return range(done, done)
    begin = next((i for i in range(done, 0, -1) if not joined[i - 1]), 0)
    stop = next((i for i in range(done, len(joined)) if not joined[i]), len(joined)) + 1
    return range(begin, stop)


def share_of_end(
    found: np.ndarray, beyond: np.ndarray, reach: float, laid_before: np.ndarray
) -> np.ndarray:
    """(n,) metal of an interrupted path over that of its laid part, from the shares found (n,).

    beyond: (n,) m from the change point to the middle of each segment. What is found farther than `reach` beyond comes
    from neighbouring beads, as the plan wants it, and is taken off. laid_before: shares of all that was laid, for a
    path that was only just begun.
    """
    before, ahead = (found[(beyond * way > reach) & (beyond * way < 4 * reach)] for way in (-1, 1))
    laid = np.clip(np.median(before if before.size else laid_before), 0.5, 1.2)
    beside = min(np.median(ahead), 0.4) if ahead.size else 0.0
    return (found - beside) / (laid - beside)
