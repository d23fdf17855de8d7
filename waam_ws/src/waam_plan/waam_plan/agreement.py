"""Does a scan show the part, where the program expects it? What does not is refused with what was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.grid import HeightGrid

UNKNOWN_LIMIT = 0.3  # share of the part's cells that may be missing in the scan
MAX_DISTANCE = (
    10e-3  # m, a cell that is farther off counts as this far: what is worn off must not decide
)
MISFIT = 2e-3  # m, mean distance below which nothing is asked
BETTER = 0.3  # of the mean distance, for another way round to be the right one
BARE = 0.5e-3  # m above the bottom of the part: nothing stands there
REMEDY = (
    'check that the part lies where the program expects it: part and scan in the same coordinates'
)


@dataclass(frozen=True)
class Agreement:
    """How a scan lies to the part. Heights in m, downwards positive: metal that is missing."""

    seen: float  # share of the part's cells, 0..1
    median: float  # NaN where nothing was seen
    low: float  # 5 % of the cells miss less
    high: float  # 5 % of the cells miss more
    turned: str  # the way round in which the scan would fit, '' = as it is

    def __str__(self) -> str:
        """For a person."""
        if not np.isfinite(self.median):
            return 'the scan and the part have no cell in common'
        side = 'below' if self.median >= 0 else 'above'
        ends = sorted(1e3 * (v if self.median >= 0 else -v) for v in (self.low, self.high))
        return (
            f'it covers {self.seen:.0%} of the part and lies {abs(self.median) * 1e3:.1f} mm {side} nominal '
            f'(median; 90 % of it {ends[0]:.1f} to {ends[1]:.1f} mm)'
        )


def agreement(found: np.ndarray, wanted: np.ndarray) -> Agreement:
    """Of two maps (rows, cols) m; NaN = not seen, and not a part of the part."""
    part = np.isfinite(wanted)
    missing = (wanted - found)[part & np.isfinite(found)]
    if not missing.size:
        return Agreement(0.0, np.nan, np.nan, np.nan, '')
    low, median, high = (float(v) for v in np.percentile(missing, (5, 50, 95)))
    return Agreement(missing.size / part.sum(), median, low, high, _turned(found, wanted))


def check(
    found: HeightGrid, nominal: HeightGrid, settings: PlanSettings, bottom: float | None = None
) -> None:
    """PlanError where the scan cannot be one of this part in this place: hardly any overlap, wholly below or above it,
    mirrored or upside down.

    bottom: m, of the part, where that is known: a scan that lies there shows nothing of it.
    """
    wanted = nominal.z + settings.allowance
    seen = agreement(found.z, wanted)
    turned = f'; it would fit {seen.turned}' if seen.turned else ''
    if 1.0 - seen.seen > UNKNOWN_LIMIT:
        raise PlanError(
            f'the scan misses {1 - seen.seen:.0%} of the part (limit {UNKNOWN_LIMIT:.0%}): {seen}{turned}; {REMEDY}, '
            'or scan again'
        )
    if seen.turned:
        raise PlanError(f'the scan does not lie on the part: {seen}{turned}; {REMEDY}')
    if seen.low > settings.wear_limit:
        raise PlanError(
            f'the scan lies wholly below the part: {seen}; {REMEDY}. Where so much is really missing, set wear_limit '
            f'(now {settings.wear_limit * 1e3:g} mm)'
        )
    if seen.high < -settings.layer_height:
        raise PlanError(f'the scan lies wholly above the part: {seen}; {REMEDY}')
    stands = found.z[np.isfinite(wanted) & np.isfinite(found.z)] - (bottom or 0.0)
    if bottom is not None and np.percentile(stands, 95) < BARE < seen.low:
        raise PlanError(
            f'nothing of the part stands in the scan: {seen}, at the bottom of the part (is it upside down?); {REMEDY}'
        )


def _turned(found: np.ndarray, wanted: np.ndarray) -> str:
    """The way round in which the scan fits the part clearly better than as it is; '' = none."""
    rows, cols = np.nonzero(np.isfinite(wanted))
    box = slice(rows.min(), rows.max() + 1), slice(cols.min(), cols.max() + 1)
    wanted, found = wanted[box], found[box]
    part = np.isfinite(wanted)
    ways = {
        'mirrored in x': found[:, ::-1],
        'mirrored in y': found[::-1],
        'turned by 180 deg': found[::-1, ::-1],
    }
    away = {way: _distance((wanted - z)[part]) for way, z in ways.items()}
    away['with z inverted'] = _distance((wanted + found)[part])
    as_it_is = _distance((wanted - found)[part])
    way = min(away, key=lambda w: away[w])
    if as_it_is < MISFIT or away[way] > BETTER * as_it_is:
        return ''
    return f'{way} (to {away[way] * 1e3:.1f} mm instead of {as_it_is * 1e3:.1f} mm on average)'


def _distance(missing: np.ndarray) -> float:
    """m, mean over the cells of the part, from the median: wear is no misfit. Not seen (NaN) counts as MAX_DISTANCE."""
    if not np.isfinite(missing).any():
        return MAX_DISTANCE
    off = np.abs(missing - np.nanmedian(missing))
    return float(np.minimum(np.nan_to_num(off, nan=MAX_DISTANCE), MAX_DISTANCE).mean())
