"""The order of lines in a region: nearest next, linked with the arc on where the link is short and inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from shapely import LineString, Point, Polygon, prepare
from shapely.ops import substring

from waam_plan.fill.hatch import Chain
from waam_plan.fill.rings import begun_at
from waam_plan.fill.seam import seam_shift
from waam_process.segment import Segment

MAX_LINK_PITCHES = 2.0  # pitches: longest link with the arc on
OPEN = 0.6  # pitches: a ring that is linked to the next one ends so much before its start, for the link lays metal, too
SEAMS = 20  # places along a ring that are tried for its seam


@dataclass(frozen=True)
class StartsBelow:
    """Arc starts of the layer below, (n, 2) m, and how far (m) those of this layer keep from them."""

    at: np.ndarray
    least: float

    def room(self, point: np.ndarray) -> float:
        """From a point (2,) m to the nearest of the starts, m."""
        return float(np.linalg.norm(self.at - point, axis=1).min(initial=np.inf))


NONE_BELOW = StartsBelow(np.zeros((0, 2)), 0.0)


def linked(
    runs: list[Chain],
    polygon: Polygon,
    pitch: float,
    number: int,
    open_first: bool = False,
    below: StartsBelow = NONE_BELOW,
) -> list[Chain]:
    """Chains that begin with the first run and go on to the nearest one left.

    runs: chains of lines (n, 2) m inside the polygon, a single closed line may begin anywhere. Even layers run
    the other way; rings that need an arc start of their own begin at the layer's seam. open_first: whether the first
    ring of a chain may end before its start as the others do; a gap in it shows on the side of the part. below: what
    seams keep away from; a chain that had to be turned round for it would be laid from the inside out.
    """
    left = [_turned(run) for run in runs] if number % 2 == 0 else list(runs)
    out: list[Chain] = []
    prepare(polygon)
    while left:
        here = out[-1][-1][-1] if out else None
        away = [_distance(run, here) for run in left]
        k = int(np.argmin(away))
        run = left.pop(k)
        if out and away[k] <= MAX_LINK_PITCHES * pitch:
            gap = OPEN * pitch if open_first or len(out[-1]) > 1 else 0.0
            if _went_on(out[-1], run, polygon, gap):
                continue
        if _closed(run):
            out.append([_begun_with_room(run[0], seam_shift(number), below)])
        else:
            out.append(run if here is None else _begun_near(run, here))
    return out


def _went_on(chain: Chain, run: Chain, polygon: Polygon, gap: float) -> bool:
    """Appends a run to a chain where the link to it stays inside. A ring before a ring ends `gap` (m) before its start
    where that link stays inside, too."""
    last = chain[-1]
    if gap and _closed(run) and _closed([last]):
        opened, beside = _opened(last, gap), _begun_near(run, last[0])
        if _inside(opened[-1], beside[0][0], polygon):
            chain[-1] = opened
            chain.extend(beside)
            return True
    near = _begun_near(run, last[-1])
    if not _inside(last[-1], near[0][0], polygon):
        return False
    chain.extend(near)
    return True


def _opened(ring: np.ndarray, gap: float) -> np.ndarray:
    """A closed line that ends `gap` (m) before its start, at most a quarter of its length."""
    line = LineString(ring)
    return np.asarray(substring(line, 0.0, line.length - min(gap, line.length / 4)).coords)


def _turned(run: Chain) -> Chain:
    return [line[::-1] for line in run[::-1]]


def _closed(run: Chain) -> bool:
    return len(run) == 1 and bool(np.allclose(run[0][0], run[0][-1], atol=1e-9))


def _distance(run: Chain, here: np.ndarray | None) -> float:
    if here is None:
        return 0.0
    if _closed(run):
        return LineString(run[0]).distance(Point(here))
    return float(min(np.linalg.norm(run[0][0] - here), np.linalg.norm(run[-1][-1] - here)))


def _begun_near(run: Chain, here: np.ndarray) -> Chain:
    if _closed(run):
        return [begun_at(run[0], LineString(run[0]).project(Point(here)))]
    first, last = (np.linalg.norm(p - here) for p in (run[0][0], run[-1][-1]))
    return run if first <= last else _turned(run)


def _begun_with_room(ring: np.ndarray, first: float, below: StartsBelow) -> np.ndarray:
    """A closed line that begins at `first` (share of its length) or at the nearest of SEAMS places with room, and where
    there is most when none has."""
    line = LineString(ring)
    steps = sorted(range(SEAMS), key=lambda k: min(k, SEAMS - k))
    places = [(first + k / SEAMS) % 1.0 * line.length for k in steps]

    def room(place: float) -> float:
        return below.room(np.array(line.interpolate(place).coords[0]))

    found = next((p for p in places if room(p) >= below.least), None)
    return begun_at(ring, max(places, key=room) if found is None else found)


def _inside(a: np.ndarray, b: np.ndarray, polygon: Polygon) -> bool:
    return bool(np.linalg.norm(b - a) < 1e-9 or polygon.covers(LineString([a, b])))


def spread_starts(chains: list[Chain], before: np.ndarray, least: float) -> list[Chain]:
    """Chains whose arc starts lie `least` (m) from those of the layer below where turning them round allows it.

    before: (n, 2) m, starts of the layer below. A ring of its own moves its seam, any other chain may begin at its
    other end.
    """
    below = StartsBelow(before, least)
    return [_spread(chain, below) for chain in chains]


def _spread(chain: Chain, below: StartsBelow) -> Chain:
    if below.room(chain[0][0]) >= below.least:
        return chain
    if _closed(chain):
        return [_begun_with_room(chain[0], 0.0, below)]
    both = [chain, _turned(chain)]
    choices = both + [c for way in both for c in _shifted(way, below.least)]
    rooms = [below.room(c[0][0]) for c in choices]
    good = next((k for k, room in enumerate(rooms) if room >= below.least), int(np.argmax(rooms)))
    return choices[good]


def _shifted(chain: Chain, least: float) -> list[Chain]:
    """The same chain with the seam of its first ring moved a little, for the chain goes on beside it."""
    ring = chain[0]
    if not _closed([ring]):
        return []
    at = np.array([1.2, -1.2, 2, -2]) * least
    return [[begun_at(ring, float(d)), *chain[1:]] for d in at]


def near_starts(starts: list[np.ndarray], least: float, first: int = 1) -> list[str]:
    """A warning where arc starts lie nearer than `least` (m) to those of the layer below.

    starts: (n, 2) m per layer, from layer `first` upwards. A shorter bead has no other end to begin at.
    """
    count, nearest, where = 0, least, ''
    for number, (below, here) in enumerate(zip(starts, starts[1:], strict=False), first + 1):
        if len(below) and len(here):
            away = cKDTree(below).query(here)[0]
            count += int((away < least * (1 - 1e-6)).sum())
            if away.min() < nearest:
                nearest, (x, y) = away.min(), 1e3 * here[away.argmin()]
                where = f'{1e3 * nearest:.1f} mm in layer {number} at ({x:.1f}, {y:.1f}) mm'
    if not count:
        return []
    return [
        f'{count} arc starts lie nearer than {1e3 * least:g} mm to one of the layer below: {where}'
    ]


def arc_starts(segments: list[Segment]) -> np.ndarray:
    """(n, 2) m: where the arc is lit."""
    lit = [s.arc for s in segments]
    at = [
        s.start[:2]
        for s, now, was in zip(segments, lit, [False, *lit], strict=False)
        if now and not was
    ]
    return np.array(at, float).reshape(-1, 2)
