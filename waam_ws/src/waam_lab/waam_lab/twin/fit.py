"""From records to a cell: arc, metal and heat, with intervals and with what the records cannot tell."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from waam_sim.plant import PlantParams

from .compare import Comparison
from .electric import Steady, fit_current, scatter, steady
from .records import JobRecord, RecordError
from .replay import Laid, Replay
from .solve import Case, Each, Solver
from .strike import Strikes, strikes
from .unknowns import ELECTRIC, REPLAYED, SCATTER, Unknown, physics

NINETY = 1.6449  # standard deviations to either side that hold 90 % of a normal distribution
TELLS = 0.7  # a parameter is told when so much of what was believed before is left at most


@dataclass(frozen=True)
class Estimate:
    """One parameter: value and 90 % interval. `left`: standard deviation over that of what was believed before."""

    unknown: Unknown
    value: float
    low: float
    high: float
    left: float

    @property
    def told(self) -> bool:
        """Whether the records say it; otherwise the interval is little more than what was believed before."""
        return self.left <= TELLS


@dataclass(frozen=True)
class Misfit:
    """Of one recorded job, with the cell as it was and as found. Heights m (RMS), metal laid over metal measured,
    temperatures K (RMS; NaN without readings)."""

    job: str
    layers: int
    height: tuple[float, float]
    metal: tuple[float, float]
    celsius: tuple[float, float]


@dataclass(frozen=True)
class Fitted:
    """The cell, what was estimated, and how well it does. `current`: misfit A before and after, or None. `strikes`:
    whether its arcs strike at the beads of the records."""

    cell: PlantParams
    estimates: tuple[Estimate, ...]
    misfits: tuple[Misfit, ...]
    current: tuple[float, float] | None
    ambient: float | None
    replays: tuple[Replay, ...]
    before: tuple[Laid, ...]
    after: tuple[Laid, ...]
    strikes: Strikes | None = None

    def values(self) -> dict[str, float]:
        """Parameters that differ from the cell that the fit began with, as in a cell file."""
        found = {e.unknown.name: e.value for e in self.estimates if e.told}
        if self.ambient is not None:
            found['heat_ambient'] = found['heat_initial'] = round(self.ambient, 1)
        return found


def fit(
    records: list[JobRecord],
    base: PlantParams,
    tick: Callable[[int], None] = lambda total: None,
    each: Each = map,
) -> Fitted:
    """base: the cell that stays wherever the records tell nothing. tick: called with the number of steps that there
    will be, after every step. each: does the tasks, `map` or something that spreads them. RecordError when no layer
    can be compared.
    """
    replays = [Replay(r) for r in records]
    for r in replays:
        if not Comparison(r).masks:
            raise RecordError(
                f'{r.record.name}: no layer has enough cells that were seen before and after it'
            )
    ambient = _ambient(replays, base)
    if ambient is not None:
        base = replace(base, heat=replace(base.heat, ambient=ambient, initial=ambient))
    cases = [Case.of(r, base.heat.ambient) for r in replays]
    before = [r.run(base) for r in replays]
    solver = Solver(cases, base, tick, each)
    solved = solver.solve()
    estimates = [
        _estimate(k, u, math.sqrt(v))
        for k, u, v in zip(REPLAYED, solved.u, np.diag(solved.covariance), strict=True)
    ]
    noise = next(k for k in SCATTER if k.field == 'area_noise_layer')
    estimates.append(_measured(noise, solved.noise, solved.noise_error))
    seen = Steady.join([steady(r, one) for r, one in zip(replays, solved.laid, strict=True)])
    electric, amps = _electric(seen, base)
    estimates += electric
    cell = physics(base, {e.unknown.name: e.value for e in estimates if e.told})
    after = [r.run(cell) for r in replays]
    misfits = tuple(map(_misfit, cases, before, after))
    return Fitted(
        cell, tuple(estimates), misfits, amps, ambient, tuple(replays), tuple(before), tuple(after),
        strikes=strikes(cell.arc, seen),
    )  # fmt: skip


def _electric(seen: Steady, base: PlantParams) -> tuple[list[Estimate], tuple[float, float] | None]:
    found = fit_current(seen, base.arc)
    if found is None:
        return [], None
    spread = np.sqrt(np.diag(found.covariance))
    estimates = [_estimate(k, u, s) for k, u, s in zip(ELECTRIC, found.u, spread, strict=True)]
    arc = physics(base, {e.unknown.name: e.value for e in estimates}).arc
    for name, (value, error) in scatter(seen, arc).items():
        estimates.append(_measured(next(k for k in SCATTER if k.field == name), value, error))
    return estimates, (found.before, found.after)


def _estimate(k: Unknown, u: float, sigma: float) -> Estimate:
    """From standard values; what laying anew is wrong by comes on top, up to what was believed before."""
    doubt = k.doubt / k.spread
    wide = min(math.hypot(sigma, doubt), 1.0)
    low, high = (float(k.value(u + s * NINETY * wide)) for s in (-1, 1))
    return Estimate(k, float(k.value(u)), low, high, wide)


def _measured(k: Unknown, value: float, error: float) -> Estimate:
    """A measured value with its relative error joins what was believed before (both logarithms normal)."""
    error = math.hypot(error, k.doubt)
    share = k.spread**2 / (k.spread**2 + error**2)
    sigma = math.sqrt(share) * error / k.spread
    return _estimate(replace(k, doubt=0.0), share * k.standard(value), sigma)


def _ambient(replays: list[Replay], base: PlantParams) -> float | None:
    """Temperature of the shop: the lowest reading before a first arc, where a pyrometer reads right whatever the
    emissivity; None without any."""
    shown = [r.before_job for r in replays if math.isfinite(r.before_job)]
    found = min(shown, default=math.nan)
    return found if -20.0 <= found <= 60.0 else None


def _misfit(case: Case, before: Laid, after: Laid) -> Misfit:
    compared, seen = case.comparison, case.replay.readings.celsius
    return Misfit(
        case.replay.record.name,
        len(compared.masks),
        height=(compared.misfit(before), compared.misfit(after)),
        metal=(compared.volume(before), compared.volume(after)),
        celsius=(_rms(before.celsius - seen), _rms(after.celsius - seen)),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan
