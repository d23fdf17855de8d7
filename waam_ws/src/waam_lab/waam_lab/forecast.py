"""What a job will give, foretold from the same job on simulated cells. Pure; SI unless a name says otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats
from scipy.special import expit, logit

from . import bands, causes
from .job import LabJob, LabResult
from .layouts import Trial, options

BAND = 0.9  # share of jobs that should lie in a band
SURE = 0.5  # least chance of success that is no warning
# Spread that is assumed before cells have shown theirs, and with the weight of how many of them. Of six kinds of
# restorations on three metal models each, preset `recorded`: the standard deviation of ln(RMS) was 0.12 to 0.4.
PRIOR_WEIGHT = 4
LEAST_SHARE = 1e-3  # 0 and 1 have no logit


class Kind(NamedTuple):
    """How figures of a kind scatter: on the scale on which they are normal, with this standard deviation beforehand."""

    to_scale: Callable[[Any], Any]
    back: Callable[[Any], Any]
    sigma: float


LOG = Kind(lambda v: np.log(np.maximum(v, 1e-9)), np.exp, 0.25)
SHARE = Kind(lambda v: logit(np.clip(v, LEAST_SHARE, 1 - LEAST_SHARE)), expit, 0.6)
STEADY = Kind(LOG.to_scale, np.exp, 0.05)  # machine time and wire hardly depend on the cell


class Row(NamedTuple):
    """A figure of LabResult that is foretold: label, key and unit in files, factor from SI, decimals."""

    name: str
    label: str
    key: str
    unit: str
    factor: float
    digits: int
    kind: Kind


RMS = Row('rms', 'RMS height error', 'rms_mm', 'mm', 1e3, 3, LOG)
SHARE_ROW = Row(
    'share_in_tolerance', 'within the tolerance', 'share_in_tolerance', '%', 100, 1, SHARE
)
CLEAN = Row('clean_share', 'needed area at or above nominal', 'clean_share', '%', 100, 2, SHARE)
STOCK = Row('stock_mean', 'stock to machine, mean', 'stock_mean_mm', 'mm', 1e3, 2, LOG)
HIGH = Row('stock_high', 'stock to machine, 99 %', 'stock_99_mm', 'mm', 1e3, 2, LOG)
TIME = Row('time', 'machine time', 'time_s', 's', 1, 0, STEADY)
WIRE = Row('wire', 'wire', 'wire_m', 'm', 1, 2, STEADY)
AS_LAID, MACHINED = (RMS, SHARE_ROW, TIME, WIRE), (CLEAN, STOCK, HIGH, TIME, WIRE)


class Expected(NamedTuple):
    """A mean, and the band that the next job lies in with BAND."""

    value: float
    low: float
    high: float


def expected(values: Sequence[float], kind: Kind) -> Expected:
    """Prediction interval of one more value, Student's t on the scale of its kind; the variance is that of the values
    and of PRIOR_WEIGHT more with the spread that the kind has (a conjugate prior: Gelman et al. 2013, 3.3)."""
    x = kind.to_scale(np.asarray(values, float))
    n = len(x)
    freedom = PRIOR_WEIGHT + n - 1
    variance = (PRIOR_WEIGHT * kind.sigma**2 + float(((x - x.mean()) ** 2).sum())) / freedom
    reach = stats.t.ppf(0.5 + BAND / 2, freedom) * math.sqrt(variance * (1 + 1 / n))
    low, high = (float(kind.back(x.mean() + side * reach)) for side in (-1, 1))
    if kind is SHARE:  # beyond that the scale has no end
        low, high = (0.0 if low < LEAST_SHARE else low), (1.0 if high > 1 - LEAST_SHARE else high)
    return Expected(float(np.mean(values)), low, high)


def chance(good: int, of: int) -> Expected:
    """Of success, when so many cells were good, with its credible interval (Jeffreys' prior: Brown et al. 2001)."""
    a, b = good + 0.5, of - good + 0.5
    low, high = (float(stats.beta.ppf(0.5 + side * BAND / 2, a, b)) for side in (-1, 1))
    return Expected(a / (a + b), low, high)


@dataclass(frozen=True)
class Forecast:
    """The job on some cells, and what else was tried of it."""

    job: LabJob
    results: tuple[LabResult, ...]  # one per cell
    trials: tuple[Trial, ...] = ()  # other layouts on some of the same cells
    best: Trial | None = None  # the one of them that is worth it
    seconds: float = math.nan  # s that it took

    @property
    def done(self) -> list[LabResult]:
        """Those that came to their end."""
        return [r for r in self.results if not r.failed]

    @property
    def machined(self) -> bool:
        """Whether it is judged by what is below nominal after machining."""
        return self.job.machined

    @property
    def rows(self) -> dict[Row, Expected]:
        """The figures of its finish, without those that no cell has."""
        found = {}
        for row in MACHINED if self.machined else AS_LAID:
            values = [v for r in self.done if math.isfinite(v := getattr(r, row.name))]
            if values:
                found[row] = expected(values, row.kind)
        return found

    @property
    def good(self) -> int:
        """Cells on which it is in tolerance, or cleans up."""
        return sum(r.in_tolerance for r in self.results)

    @property
    def chance(self) -> Expected:
        """Of success."""
        return chance(self.good, len(self.results))

    @property
    def fails(self) -> bool:
        """Whether it is told that it will not succeed."""
        return self.chance.value < SURE

    @property
    def volume(self) -> float:
        """m3 that is planned, mean; NaN when nothing was."""
        known = [r.volume for r in self.results if math.isfinite(r.volume)]
        return float(np.mean(known)) if known else math.nan

    @property
    def causes(self) -> dict[str, float]:
        """Where the failure is made (`causes.shares`)."""
        return causes.shares(r.maps for r in self.results if r.maps is not None)

    @property
    def maps(self) -> bands.Maps | None:
        """Over the cells; None when none came to its end."""
        return bands.maps(self.results, self.job.goal.tolerance)

    @property
    def stops(self) -> list[str]:
        """Why cells failed or paused, one text each."""
        held = [
            str(a.get('text'))
            for r in self.results
            for a in r.anomalies
            if not r.failed
            and 'job paused' in str(a.get('reaction'))
            and a.get('class') == 'height'
        ]
        return [r.message for r in self.results if r.failed] + held


def verdict(f: Forecast) -> str:
    """One sentence: how many cells succeeded, and whether it is worth laying."""
    word = 'clean up' if f.machined else 'be in tolerance'
    said = f'{f.good} of {len(f.results)} cells'
    if not f.done:
        return f'it fails: {f.stops[0]}'
    if f.fails:
        return f'will not {word}: {said}'
    if f.chance.low < SURE:
        return f'may {word}: {said}, not enough to be sure'
    return f'will {word}: {said}'


def words(f: Forecast) -> list[str]:
    """What is said of a part that fails: where it is made, what stopped jobs, and what would do better."""
    out = []
    if f.fails and (found := f.causes):
        what = 'area below nominal' if f.machined else 'squared error'
        told = [f'{name} {share:.0%}' for name, share in list(found.items())[:3]]
        out.append(f'cause, share of the {what}: {", ".join(told)}')
    for text in dict.fromkeys(f.stops if f.done else ()):
        out.append(f'stopped on a cell: {text}')
    if f.best is not None:
        out.append(f'best of {len(f.trials)} others: {alternative(f, f.best)}')
    elif f.trials:
        tried = ', '.join(t.layout.name for t in f.trials)
        out.append(f'none of the others that were tried does better: {tried}')
    return out


def alternative(f: Forecast, t: Trial) -> str:
    """A layout in words, with the options that give it and what came out."""
    how = ' '.join(options(f.job, t.layout))
    count = f'{t.good} of {len(t.results)} cells'
    if t.machined:
        gives = f'cleans up on {count}, stock {t.mean("stock_mean") * 1e3:.2f} mm'
    else:
        gives = f'in tolerance on {count}, RMS {t.mean("rms") * 1e3:.3f} mm'
    return f'{t.layout.name} ({how}): {gives}, {t.mean("time"):.0f} s'


def facts(f: Forecast, told: str = '') -> dict[str, Any]:
    """forecast.json; figures in the units of their keys, shares from 0 to 1. told: the command line."""
    goal = f.job.goal
    figures = {
        row.key: {k: v * _factor(row) for k, v in e._asdict().items()} for row, e in f.rows.items()
    }
    return {
        'part': goal.file.name,
        'as_found': f.job.as_found.name if f.job.as_found else None,
        'tolerance_mm': goal.tolerance * 1e3,
        'finish': 'machined' if f.machined else 'as-laid',
        'preset': f.job.preset,
        'band': BAND,
        'cells': len(f.results),
        'seeds': [r.seed for r in f.results],
        'good': f.good,
        'chance': f.chance._asdict(),
        'fails': f.fails,
        'verdict': verdict(f),
        'figures': figures,
        'causes': f.causes,
        'stops': list(dict.fromkeys(f.stops)),
        'tried': [
            {
                'layout': t.layout.name,
                'options': options(f.job, t.layout),
                'cells': len(t.results),
                'good': t.good,
                'rms_mm': t.mean('rms') * 1e3,
                'stock_mean_mm': t.mean('stock_mean') * 1e3,
                'time_s': t.mean('time'),
                'best': t is f.best,
            }
            for t in f.trials
        ],
        'volume_cm3': f.volume * 1e6,
        'seconds': f.seconds,
        'command': told,
    }


def _factor(row: Row) -> float:
    return 1.0 if row.unit == '%' else row.factor
