"""Which turning of the positioner keeps the arm away from its limits and from singularities where a part is laid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .arm_choice import Way
from .station import Place, Station, StationError, best_way, box_path
from .turning import Turning

STARTS = np.radians(np.arange(-150.0, 181.0, 30.0))
OVER = np.radians(
    [-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0]
)  # of C, from one end of the part to the other
FINER = np.radians([-15.0, 0.0, 15.0])
MAX_TURNING_COST_SHARE = (
    0.9  # share of the cost of standing still from which on turning is worth it
)
STEP, PLACES = 25e-3, 40  # m between the places that are looked at, and about how many
TRIES = 8


@dataclass(frozen=True)
class Choice:
    """turning: the best, still where nothing is worth it; way: of the arm then; still: of the arm with the part at
    rest, None = it cannot serve the part or the box."""

    turning: Turning
    way: Way
    still: Way | None

    @property
    def text(self) -> str:
        """For people."""
        if self.turning.still:
            return f'the part need not turn: the arm uses {self.way.text}'
        before = f'{self.still.text} at rest' if self.still else 'at rest it cannot be reached'
        return f'the positioner turns the part by {self.turning.text}: the arm uses {self.way.text} ({before})'


def choose(place: Place, low: np.ndarray, high: np.ndarray) -> Choice:
    """For a part between low and high (3,) m, machine coordinates, in the box of the place, which has to be served too.

    StationError where no turning serves both.
    """
    size = np.maximum(np.asarray(high, float) - low, STEP)
    around = 4 * float(size[:2].sum())
    path = box_path(np.asarray(low, float), np.asarray(high, float), max(STEP, around / PLACES))
    still = best_way(replace(place, turning=Turning()), path, np.inf)
    if still and not _serves(replace(place, turning=Turning())):
        still = None
    found = _sorted(place, path, _candidates(size))
    finer = [t for _, t, _ in found[:2] for t in _beside(t, size)]
    found = sorted([*found, *_sorted(place, path, iter(finer))], key=lambda f: f[0])
    for cost, turning, way in found[:TRIES]:
        if still and cost > MAX_TURNING_COST_SHARE * still.cost:
            break
        if _serves(replace(place, turning=turning)):
            return Choice(turning, way, still)
    if still is None:
        raise StationError('the robot does not reach all of its box, however the part is turned')
    return Choice(Turning(), still, still)


def _sorted(
    place: Place, path: np.ndarray, turnings: Iterator[Turning]
) -> list[tuple[float, Turning, Way]]:
    found = []
    for turning in turnings:
        way = best_way(replace(place, turning=turning), path, np.inf)
        if way is not None:
            found.append((way.cost, turning, way))
    return sorted(found, key=lambda f: f[0])


def _candidates(size: np.ndarray) -> Iterator[Turning]:
    for x, y, start in product(OVER, OVER, STARTS):
        if x or y or start:
            yield Turning(float(start), (float(x / size[0]), float(y / size[1])))


def _beside(turning: Turning, size: np.ndarray) -> Iterator[Turning]:
    x, y = turning.along
    for a, b, start in product(FINER, FINER, FINER):
        if a or b or start:
            along = (float(x + a / size[0]), float(y + b / size[1]))
            yield Turning(float(turning.start + start), along)


def _serves(place: Place) -> bool:
    try:
        Station(place)
    except StationError:
        return False
    return True
