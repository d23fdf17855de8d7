"""Points that are none: marks of scanners for "no return", and single points far from all others.

Nothing is cut by its value alone: a mark is a value that is repeated and does not fit what lies around it.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

# values that drivers write where no light came back
MARKS = np.array(
    [0.0, 99.99, 999.0, 999.99, 9999.0, 99999.0, 32767.0, 32768.0, 65535.0, 1e6, 1e9, 1e10]
)
MAX_COORDINATE = 1e15  # in any unit
MIN_MARKS, MIN_EQUAL_VALUES = 3, 10  # equal points: of a mark above, and of any other value
LOOKED_AT = 100_000  # points among which neighbours are looked for
ASKED = 2000  # points of one value that are compared with their neighbours
NEIGHBOURS = 8
SCATTERED = 0.25  # share of other neighbours from which on points lie between the others
MIN_OTHERS = 0.05  # share of the other points; fewer are no surface between marks
FLAT = 0.2  # share of the other points at one height: then a plate may be as flat, too
MAX_CELLS = 200_000  # cubes, in which groups are looked for
FARTHEST = 2**20 - 1  # cubes
APART_SHARE = 5e-4  # of all points; a smaller group apart from the others is no surface


def usable(points: np.ndarray, intensity: np.ndarray | None = None) -> tuple[np.ndarray, list[str]]:
    """The points (n, 3) of the surface, in any unit, and what was left out and why. intensity: (n,) or None."""
    notes: list[str] = []
    bad = ~(np.abs(points) < MAX_COORDINATE).all(axis=1)
    if bad.any():
        notes.append(f'{_points(bad)} without a finite number (NaN, infinite, huge) dropped')
        points = points[~bad]
        intensity = None if intensity is None else intensity[~bad]
    drop = np.zeros(len(points), bool)
    for value in _repeated(points[:, 2]):
        _look_at(value, points, intensity, drop, notes)
    points = points[~drop]
    apart, where = _apart(points)
    if apart.any():
        notes.append(
            f'{_points(apart)} far from all others dropped (one at {_text(where)} in units of the file)'
        )
        points = points[~apart]
    return points, notes


def _points(mask: np.ndarray) -> str:
    n = int(mask.sum())
    return f'{n} point{"s" * (n != 1)}'


def _text(point: np.ndarray) -> str:
    return '(' + ', '.join(f'{v:.6g}' for v in point) + ')'


def _repeated(z: np.ndarray) -> list[float]:
    """Heights that occur often, most often first; marks already where they occur a few times."""
    if not len(z):
        return []
    values, count = np.unique(z, return_counts=True)
    marks = np.isclose(np.abs(values)[:, None], MARKS, rtol=1e-6, atol=0).any(axis=1)
    often = count >= np.where(marks, MIN_MARKS, max(MIN_EQUAL_VALUES, 1e-3 * len(z)))
    order = np.argsort(-(count * (1 + 1e9 * marks)), kind='stable')
    return [float(values[i]) for i in order if often[i]][:20]


def _look_at(
    value: float,
    points: np.ndarray,
    intensity: np.ndarray | None,
    drop: np.ndarray,
    notes: list[str],
) -> None:
    """Whether the points of one height are marks; adds them to `drop` and says so."""
    at = (points[:, 2] == value) & ~drop
    mark = bool(np.isclose(abs(value), MARKS, rtol=1e-6, atol=0).any())
    place = _one_place(points[at], mark)
    if place is not None:
        same = at & (points == place).all(axis=1)
        drop |= same
        at &= ~same
        notes.append(f'{_points(same)} at {_text(place)} dropped: a scanner\'s mark for no return')
    n, others = int(at.sum()), ~at & ~drop
    if n < (MIN_MARKS if mark else MIN_EQUAL_VALUES) or not others.any():
        return
    dark = intensity is not None and (intensity[at] == 0).mean() > 0.95
    if dark and intensity is not None and (intensity[others] != 0).mean() > 0.9:
        why = ' and intensity 0'
    else:
        why, judged = '', _judged(points, at, others, mark)
        if judged == 'doubt':
            notes.append(
                f'{_points(at)} with z = {value:.6g} stand out of the others and are kept, as a plate; remove them if '
                'they are marks for no return'
            )
        if judged != 'mark':
            return
    drop |= at
    notes.append(
        f'{_points(at)} with z = {value:.6g}{why} dropped: a scanner\'s mark for no return'
    )


def _one_place(points: np.ndarray, mark: bool) -> np.ndarray | None:
    """The place (3,) that many of these points of one height share, where most places are taken once."""
    if not len(points):
        return None
    places, count = np.unique(points[:, 0] + 1j * points[:, 1], return_counts=True)
    most = int(np.argmax(count))
    typical = float(np.median(np.delete(count, most))) if len(count) > 1 else 1.0
    zero = places[most] == 0 and points[0, 2] == 0
    if (
        count[most] >= (MIN_MARKS if zero or mark else MIN_EQUAL_VALUES)
        and count[most] > 2 * typical
    ):
        return np.array([places[most].real, places[most].imag, points[0, 2]])
    return None


def _judged(points: np.ndarray, at: np.ndarray, others: np.ndarray, mark: bool) -> str:
    """'mark' where points of one height stand out of their neighbours and are no flat face of the part, 'doubt' where
    they stand out and may be one, else ''."""
    rng = np.random.default_rng(1)
    rest = _some(np.flatnonzero(others), LOOKED_AT, rng)
    ask = _some(np.flatnonzero(at), ASKED, rng)
    control = _some(rest, ASKED, rng)
    z = points[:, 2]
    off = np.abs(np.median(z[_near(points, ask, rest)], axis=1) - z[ask])
    rough = np.abs(np.median(z[_near(points, control, rest)], axis=1) - z[control])
    least = max(5 * float(np.quantile(rough, 0.9)), 1e-6 * abs(float(z[ask[0]])))
    span = float(np.ptp(np.quantile(z[rest], (0.02, 0.98))))
    _, count = np.unique(z[rest], return_counts=True)
    stands = (off > max(least, (0.2 if mark else 2.0) * span)).mean() > 0.8
    alone = mark and at.sum() > 20 * count.max() and (off > least).mean() > 0.3
    if not (stands or alone):
        return ''
    share = others.sum() / (others.sum() + at.sum())
    everything = _some(np.flatnonzero(at | others), LOOKED_AT, rng)
    between = (~at[_near(points, ask, everything)]).mean()
    if share > MIN_OTHERS and between > min(SCATTERED, share / 2):
        return 'mark'
    if not (mark and stands):
        return ''
    flat = count.max() / len(rest) > FLAT
    extent = float(np.ptp(np.quantile(points[rest, :2], (0.02, 0.98), axis=0), axis=0).max())
    far = z[ask[0]] != 0 and float(np.median(off)) > 0.5 * extent
    return 'mark' if far or (not flat and at.sum() < 2 * others.sum()) else 'doubt'


def _near(points: np.ndarray, ask: np.ndarray, among: np.ndarray) -> np.ndarray:
    """(len(ask), k) numbers of the nearest of `among`, seen from above."""
    k = min(NEIGHBOURS, len(among))
    found = cKDTree(points[among, :2]).query(points[ask, :2], k)[1]
    return among[found.reshape(len(ask), k)]


def _some(index: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return index if len(index) <= most else rng.choice(index, most, replace=False)


def _apart(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which points (n,) lie in small groups apart from the others, and one of them (3,)."""
    none = np.zeros(len(points), bool), np.zeros(3)
    if len(points) < 2 * MIN_EQUAL_VALUES:
        return none
    low, high = np.quantile(points, (0.01, 0.99), axis=0)
    some = points[_some(np.arange(len(points)), LOOKED_AT, np.random.default_rng(1))]
    near = cKDTree(some).query(some[:ASKED], 5)[0][:, -1]
    cell = max(float((high - low).max()) / 100, 2 * float(np.quantile(near, 0.9)))
    if not np.isfinite(cell) or cell <= 0:
        return none
    first, inverse, count = _cells(points, low, cell)
    while len(first) > MAX_CELLS:
        cell *= 2
        first, inverse, count = _cells(points, low, cell)
    key = np.floor((points[first] - low) / cell)
    pairs = cKDTree(np.clip(key, -FARTHEST, FARTHEST)).query_pairs(
        2.0, p=np.inf, output_type='ndarray'
    )
    links = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(first), len(first)))
    _, label = sparse.csgraph.connected_components(links, directed=False)
    size_of = np.bincount(label, weights=count)
    small = (size_of < max(MIN_MARKS, APART_SHARE * len(points)))[label][inverse]
    if not small.any() or small.mean() > 0.1:
        return none
    return small, points[np.flatnonzero(small)[0]]


def _cells(
    points: np.ndarray, low: np.ndarray, cell: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cubes with points in them: one of its points (k,), the cube of each point (n,), how many points (k,)."""
    key = np.clip(np.floor((points - low) / cell), -FARTHEST, FARTHEST).astype(np.int64)
    packed = (key[:, 0] << 42) + (key[:, 1] << 21) + key[:, 2]
    _, first, inverse, count = np.unique(
        packed, return_index=True, return_inverse=True, return_counts=True
    )
    return first, inverse.ravel(), count
