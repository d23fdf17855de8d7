"""How far pose errors have bent a measured map: estimated from the map itself, where the true surface is known.

Beside the worn place a part has its nominal surface. What the map shows there, less the nominal, is the bend, the way
the part lies, and noise. The errors of the robot are unknowns with the stated standard deviations, height and two
slopes of the part three more: a Gaussian least-squares fit, its covariance the doubt that is left. What the fit finds
is carried to every place of the map by the same slopes (`Reach.slopes`). Height and slopes of the whole map can come
from the robot or from the part, which no map tells apart: they are told by themselves, and what leaves a plane is told
as bent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .station import Reach
from .uncertain import Stated

LIES = (
    1e-4,
    1e-3,
)  # m, rad: standard deviations of the height and the slopes of a part that was set up
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
    """Each (N,) m, at every cell. off, off_doubt: by how much the map is too high, and its standard deviation; bend,
    doubt: of that, what leaves a plane; stated: what the stated errors alone say of it. slope: rad, of the plane;
    cells: that it was estimated from; noise: m, of one of them."""

    off: np.ndarray
    off_doubt: np.ndarray
    bend: np.ndarray
    doubt: np.ndarray
    stated: np.ndarray
    slope: float
    cells: int
    noise: float

    @property
    def text(self) -> str:
        """One line for people."""
        bend, doubt, stated, off, off_doubt = (
            f'{_rms(v) * 1e3:.3f}' for v in (self.bend, self.doubt, self.stated, self.off, self.off_doubt)
        )  # fmt: skip
        most = float(np.abs(self.bend).max()) * 1e3
        return (
            f'pose errors bend the measured map by {bend} +-{doubt} mm (RMS; {most:.3f} mm at most), estimated from '
            f'{self.cells} cells of the surface that is known; the stated errors alone say {stated} mm. With height '
            f'and slope ({self.slope * 1e3:.2f} mm per m), which may be those of the part, the map is off by {off} '
            f'+-{off_doubt} mm'
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
        raise FitError(
            f'the true surface is known in {len(known)} cells of the map, wanted are {FEWEST}'
        )
    tips = np.vstack([taught, np.asarray(surface.points, float) - scanner])
    slopes = station.slopes(station.joints(tips), scanner, stated or Stated())
    change = slopes[:1] - slopes[1:]  # a scanner that is too high measures too low
    apart = surface.points[:, :2] - surface.points[known, :2].mean(axis=0)
    plane = np.column_stack([np.ones(len(apart)), apart])
    all_of_it = np.hstack([change, plane * [LIES[0], LIES[1], LIES[1]]])
    found, covariance, noise, used = _solved(all_of_it[known], surface.off[known])
    off = all_of_it @ found
    flat = np.linalg.lstsq(plane, np.column_stack([off, all_of_it]), rcond=None)[0]
    left = all_of_it - plane @ flat[:, 1:]
    return BendFit(
        off=off,
        off_doubt=_deviation(all_of_it, covariance),
        bend=left @ found,
        doubt=_deviation(left, covariance),
        stated=np.sqrt((left**2).sum(axis=1)),
        slope=float(np.hypot(*flat[1:, 0])),
        cells=used,
        noise=noise,
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


def _deviation(a: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(N,): standard deviations of a (N, k) times unknowns with a covariance (k, k)."""
    return np.sqrt(np.maximum(np.einsum('ij,jk,ik->i', a, covariance, a), 0.0))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
