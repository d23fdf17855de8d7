"""How far pose errors have bent a measured map: estimated from the map itself, where the true surface is known.

Beside the worn place a part has its nominal surface. What the map shows there, less the nominal, is the bend, the way
the part lies, and noise. The errors of the robot are unknowns with the stated standard deviations, height and two
slopes of the part three more: a Gaussian least-squares fit, its covariance the doubt that is left. What the fit finds is
carried to every place of the map by the same slopes (`Reach.slopes`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .station import Reach
from .uncertain import Stated

LIES = 1e-4, 1e-3  # m, rad: standard deviations of the height and the slopes of a part that was set up
NOISE = 2e-5  # m: least of a cell
FEWEST = 50  # cells
ROUNDS = 4
WRONG = 4.0  # standard deviations: cells farther off count for nothing


class FitError(ValueError):
    """There is nothing to estimate from; the text says why."""


@dataclass(frozen=True)
class Surface:
    """Cells of a map. points: (N, 3) m, machine coordinates, where they were measured; off: (N,) m, measured less
    nominal height, NaN where the true surface is not known."""

    points: np.ndarray
    off: np.ndarray


@dataclass(frozen=True)
class BendFit:
    """bend: (N,) m, by how much the map is too high at every cell; doubt: (N,) m, its standard deviation; stated: (N,)
    m, what is known without the map; cells: that it was estimated from; noise: m, of one of them."""

    bend: np.ndarray
    doubt: np.ndarray
    stated: np.ndarray
    cells: int
    noise: float

    @property
    def text(self) -> str:
        """One line for people."""
        rms, most = _rms(self.bend) * 1e3, float(np.abs(self.bend).max()) * 1e3
        return (
            f'pose errors bend the measured map by {rms:.3f} mm (RMS), {most:.3f} mm at most, +-{_rms(self.doubt) * 1e3:.3f} '
            f'mm: estimated from {self.cells} cells of the surface that is known (stated errors alone: '
            f'{_rms(self.stated) * 1e3:.3f} mm)'
        )


def fit(
    station: Reach,
    surface: Surface,
    taught: np.ndarray,
    scanner: np.ndarray,
    stated: Stated | None = None,
) -> BendFit:
    """taught: (3,) m, torch position where work zero and scanner were taught; scanner: (3,) m, what is measured as the
    torch sees it. FitError where too few cells are known; StationError where the arm does not reach."""
    known = np.flatnonzero(np.isfinite(surface.off))
    if len(known) < FEWEST:
        raise FitError(f'the true surface is known in {len(known)} cells of the map, wanted are {FEWEST}')
    tips = np.vstack([taught, np.asarray(surface.points, float) - scanner])
    slopes = station.slopes(station.joints(tips), scanner, stated or Stated())
    change = slopes[:1] - slopes[1:]  # a scanner that is too high measures too low
    apart = surface.points[:, :2] - surface.points[known, :2].mean(axis=0)
    lies = np.column_stack([np.full(len(apart), LIES[0]), LIES[1] * apart])
    a, off = np.hstack([change, lies])[known], surface.off[known]
    found, covariance, noise, used = _solved(a, off)
    count = change.shape[1]
    covariance = covariance[:count, :count]
    doubt = np.sqrt(np.maximum(np.einsum('ij,jk,ik->i', change, covariance, change), 0.0))
    return BendFit(
        change @ found[:count], doubt, np.sqrt((change**2).sum(axis=1)), used, noise
    )


def _solved(a: np.ndarray, off: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, int]:
    """(unknowns, in standard deviations, their covariance, noise of a cell, cells that count)."""
    good, noise = np.ones(len(off), bool), NOISE
    for _ in range(ROUNDS):
        some, right = a[good], off[good]
        covariance = np.linalg.inv(some.T @ some / noise**2 + np.eye(a.shape[1]))
        found = covariance @ some.T @ right / noise**2
        left = off - a @ found
        noise = max(NOISE, 1.4826 * float(np.median(np.abs(left[good]))))
        good = np.abs(left) < WRONG * noise
    return found, covariance, noise, int(good.sum())


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
