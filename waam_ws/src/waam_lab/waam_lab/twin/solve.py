"""The fit: steps of Gauss and Newton on a few statistics, whose scatter is simulated.

What a cell scatters is not white: beads are larger here and smaller there, over a centimetre. So residuals are not
weighted one by one. The statistics are the slopes of the misfit, J^T r for every parameter, apart for wide and narrow
structure; their covariance S comes from laying the same job many times with other scatter. With M the change of the
statistics with the parameters, information is M^T S^-1 M, to which come the readings of the pyrometer and what was
believed before (a synthetic likelihood, Wood, Nature 466, 2010, with a local linear model). Standard values: deviations
from what is usual, in units of its spread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

import numpy as np

from waam_sim.plant import PlantParams

from .compare import Comparison
from .replay import Laid, Replay
from .unknowns import REPLAYED, physics

ROUNDS = 3
STEP = 0.3  # spreads, of the slopes
FARTHEST = 1.5  # spreads that one round may go
SCATTERS = 16  # jobs laid with other scatter, at each of two levels and at the last
LEVELS = (0.02, 0.06)
READING, DRIFT, SHARE, HOLDS = 1.0, 5.0, 0.03, 150.0  # K, K, of the excess temperature, s


@dataclass
class Case:
    """A recorded job ready for the fit."""

    replay: Replay
    comparison: Comparison
    inverse: np.ndarray  # of the covariance of the readings, (n, n) 1/K^2

    @classmethod
    def of(cls, replay: Replay, ambient: float) -> Case:
        """ambient: degrees Celsius."""
        r = replay.readings
        excess = np.maximum(r.celsius - ambient, 0.0)
        near = np.exp(-np.abs(r.t[:, None] - r.t[None]) / HOLDS)
        scale = np.sqrt(DRIFT**2 + (SHARE * excess) ** 2)
        covariance = scale[:, None] * near * scale + READING**2 * np.eye(r.t.size)
        return cls(replay, Comparison(replay), np.linalg.inv(covariance))


@dataclass(frozen=True)
class Solved:
    """Standard values (p,), their covariance with and without doubt, slopes of nothing else. `noise`: area_noise_layer
    and its relative standard error; `laid`: every job with what was found."""

    u: np.ndarray
    covariance: np.ndarray
    noise: float
    noise_error: float
    laid: list[Laid] = field(default_factory=list)


@dataclass(frozen=True)
class Task:
    """What one worker does for one job: the cell of standard values u (p,) beside `base`. Of scatter: its level
    (area_noise_layer), a seed, how many draws, and the slopes that it is told in."""

    case: Case
    base: PlantParams
    u: np.ndarray
    level: float = 0.0
    seed: int = 0
    draws: int = 0
    slopes: _Slopes | None = None

    def cell(self, u: np.ndarray, noise: float | None = None) -> PlantParams:
        """The cell of standard values (p,)."""
        values = {k.name: float(k.value(v)) for k, v in zip(REPLAYED, u, strict=True)}
        if noise is not None:
            values['metal_area_noise_layer'] = noise
        return physics(self.base, values)

    @property
    def key(self) -> str:
        """All that its result is made from, in a text."""
        told = self.case.replay.record.fingerprint, repr(self.base), self.u.tolist()
        slopes = '' if self.slopes is None else sha256(self.slopes.wide.tobytes()).hexdigest()
        return repr((*told, self.level, self.seed, self.draws, slopes))


Each = Callable[
    [Callable[[Task], Any], list[Task]], Iterable[Any]
]  # results in the order of the tasks


class Solver:
    """Over all jobs. `tick`: called after every job that was laid, with the number of all that will be. `each`: does
    the tasks, here or in other processes."""

    def __init__(
        self,
        cases: list[Case],
        base: PlantParams,
        tick: Callable[[int], None] = lambda total: None,
        each: Each = map,
    ) -> None:
        self.cases, self.base, self._tick, self._spread = cases, base, tick, each
        p = len(REPLAYED)
        self.total = len(cases) * ((ROUNDS + 1) * (2 * p + 1) + 5 * SCATTERS + 1)

    def _each(self, work: Callable[[Task], Any], tasks: list[Task], laid: int) -> list[Any]:
        """laid: jobs that one task lays."""
        found = []
        for result in self._spread(work, tasks):
            found.append(result)
            for _ in range(laid):
                self._tick(self.total)
        return found

    def solve(self) -> Solved:
        """LinAlgError never: what cannot be told is held by what was believed before."""
        u = np.zeros(len(REPLAYED))
        nothing = _Scatter(np.zeros(2 * u.size), np.eye(2 * u.size), 0.0, 0.0)
        scatter = [nothing for _ in self.cases]
        noise, noise_error = 0.0, 0.0
        for number in range(ROUNDS + 1):
            tasks = [Task(case, self.base, u) for case in self.cases]
            slopes = self._each(slopes_of, tasks, 2 * u.size + 1)
            if number == 1:
                noise, noise_error = self._noise(u, slopes)
            if number in (0, 1, ROUNDS):
                level = noise or 0.045
                scatter = self._scatter(u, slopes, [(level, 100 * i) for i in range(len(slopes))])
            precision, pull = np.eye(u.size), -u
            for case, slope, found in zip(self.cases, slopes, scatter, strict=True):
                more, towards = _information(case, slope, found)
                precision, pull = precision + more, pull + towards
            step = np.linalg.solve(precision, pull)
            if number == ROUNDS:
                step *= 0.7
            u = u + np.clip(step, -FARTHEST, FARTHEST)
        laid = self._each(laid_of, [Task(case, self.base, u) for case in self.cases], 1)
        return Solved(u, np.linalg.inv(precision), noise, noise_error, laid)

    def _scatter(
        self, u: np.ndarray, slopes: list[_Slopes], how: list[tuple[float, int]]
    ) -> list[_Scatter]:
        """how: level and seed of every job."""
        tasks = [
            Task(case, self.base, u, level, seed, SCATTERS, slope)
            for case, slope, (level, seed) in zip(self.cases, slopes, how, strict=True)
        ]
        return self._each(scatter_of, tasks, SCATTERS)

    def _noise(self, u: np.ndarray, slopes: list[_Slopes]) -> tuple[float, float]:
        """area_noise_layer and its relative error: at which the simulated job is as uneven as the recorded one."""
        estimates, errors = [], []
        levels = [self._scatter(u, slopes, [(n, 7000)] * len(slopes)) for n in LEVELS]
        for case, slope, low, high in zip(self.cases, slopes, *levels, strict=True):
            off = case.comparison.bands(case.comparison.off(slope.middle))[0]
            seen = loudness(slope, off)
            per = (np.exp(2 * high.loud) - np.exp(2 * low.loud)) / (LEVELS[1] ** 2 - LEVELS[0] ** 2)
            floor = np.exp(2 * low.loud) - per * LEVELS[0] ** 2
            square = max((np.exp(2 * seen) - floor) / per, 0.008**2)
            estimates.append(np.log(square) / 2)
            share = min(max(per * square / (floor + per * square), 0.2), 1.0)
            errors.append(max(high.spread, low.spread) / share)
        weight = 1.0 / np.square(errors)
        return float(np.exp(np.average(estimates, weights=weight))), float(weight.sum() ** -0.5)


def laid_of(task: Task) -> Laid:
    """The job, laid without scatter."""
    return task.case.replay.run(task.cell(task.u))


def slopes_of(task: Task) -> _Slopes:
    """How the job changes with every parameter."""
    case, u = task.case, task.u
    middle = laid_of(task)
    wide, narrow, warm = [], [], []
    for one in np.eye(u.size):
        up, down = (case.replay.run(task.cell(u + s * STEP * one)) for s in (1, -1))
        low, high = case.comparison.bands(case.comparison.difference(up, down))
        wide.append(low / (2 * STEP))
        narrow.append(high / (2 * STEP))
        warm.append((up.celsius - down.celsius) / (2 * STEP))
    return _Slopes(middle, np.array(wide).T, np.array(narrow).T, np.array(warm).T)


def scatter_of(task: Task) -> _Scatter:
    """Mean and covariance of the statistics over cells that differ in their scatter alone, and what laying is wrong by.

    The mean is not zero: beads of uneven width make lower ridges than even ones.
    """
    case, slopes = task.case, task.slopes
    assert slopes is not None
    rng = np.random.default_rng([task.seed, 29])
    cell, rows, loud = task.cell(task.u, task.level), [], []
    for k in range(task.draws):
        laid = case.replay.run(cell, 1000 + task.seed + k)
        grown = case.comparison.difference(laid, slopes.middle)
        loud.append(loudness(slopes, case.comparison.bands(grown)[0]))
        for _ in range(4):
            wrong = case.comparison.wrong(slopes.middle, rng)
            both = {n: grown[n] + wrong[n] for n in grown}
            rows.append(slopes.statistics(case.comparison.bands(both)))
    found = np.array(rows)
    mean = found.mean(axis=0)
    covariance = (found - mean).T @ (found - mean) / len(found) * (1.0 + 2.0 / task.draws)
    # few draws: what goes together is not quite known
    covariance += np.diag(np.diag(covariance)) * 0.1
    return _Scatter(mean, covariance, float(np.mean(loud)), float(np.std(loud)))


@dataclass(frozen=True)
class _Slopes:
    """middle: the job as laid; wide, narrow (n, p): change of the maps, m per spread; warm (m, p): of readings, K."""

    middle: Laid
    wide: np.ndarray
    narrow: np.ndarray
    warm: np.ndarray

    def statistics(self, bands: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(2 p,): slopes of the misfit, wide and narrow."""
        return np.concatenate([self.wide.T @ bands[0], self.narrow.T @ bands[1]])


@dataclass(frozen=True)
class _Scatter:
    """Mean (2 p,) and covariance (2 p, 2 p) of the statistics; logarithm of the RMS of what is left, and its spread."""

    mean: np.ndarray
    covariance: np.ndarray
    loud: float
    spread: float


def loudness(slopes: _Slopes, wide: np.ndarray) -> float:
    """Logarithm of the RMS (m) of wide structure that no parameter explains."""
    left = wide - slopes.wide @ np.linalg.lstsq(slopes.wide, wide, rcond=1e-3)[0]
    return float(0.5 * np.log(np.mean(left**2) + 1e-18))


def _information(case: Case, slopes: _Slopes, scatter: _Scatter) -> tuple[np.ndarray, np.ndarray]:
    """Precision (p, p) and pull (p,) of one job."""
    bands = case.comparison.bands(case.comparison.off(slopes.middle))
    change = np.concatenate([slopes.wide.T @ slopes.wide, slopes.narrow.T @ slopes.narrow])
    scale = np.sqrt(np.diag(scatter.covariance)) + 1e-30
    inner = np.linalg.pinv(scatter.covariance / np.outer(scale, scale), rcond=1e-6) / np.outer(
        scale, scale
    )
    precision = change.T @ inner @ change
    pull = change.T @ inner @ (slopes.statistics(bands) - scatter.mean)
    off = case.replay.readings.celsius - slopes.middle.celsius
    warm = slopes.warm.T @ case.inverse
    return precision + warm @ slopes.warm, pull + warm @ off
