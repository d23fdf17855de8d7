"""The bend of a map, estimated from where the true surface is known."""

from __future__ import annotations

import numpy as np
import pytest

from waam_robot.bend_fit import FitError, Surface, fit
from waam_robot.known_surface import known_cells
from waam_robot.station import Station
from waam_robot.uncertain import Stated

SCANNER = np.array([0.06, 0.0, -0.03])
TAUGHT = np.array([0.08, 0.06, 0.02])


@pytest.fixture(scope='module')
def station() -> Station:
    return Station()


def grid() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0.08, 0.28, 21), np.linspace(0.04, 0.22, 19))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.03)])


def bent(station, points, rng) -> np.ndarray:
    """(N,) m: what one arm with the stated errors makes of a map."""
    slopes = station.slopes(
        station.joints(np.vstack([TAUGHT, points - SCANNER])), SCANNER, Stated()
    )
    return (slopes[:1] - slopes[1:]) @ rng.normal(size=slopes.shape[1])


def curved(points, off) -> np.ndarray:
    """(N,) m: what leaves a plane."""
    plane = np.column_stack([np.ones(len(points)), points[:, :2]])
    return off - plane @ np.linalg.lstsq(plane, off, rcond=None)[0]


def test_the_map_under_the_worn_place_is_known_from_beside_it(station):
    points, seen = grid(), []
    middle = np.abs(points[:, :2] - [0.18, 0.13]).max(axis=1) < 0.05
    for seed in range(12):
        rng = np.random.default_rng(seed)
        true = bent(station, points, rng)
        lies = rng.normal(0, 1e-4) + (points[:, :2] - points[0, :2]) @ rng.normal(0, 1e-3, 2)
        off = true + lies + rng.normal(0, 3e-5, len(true))
        found = fit(station, Surface(points, np.where(middle, np.nan, off)), TAUGHT, SCANNER)
        of_bend = curved(points, true)
        seen.append(np.array([
            found.off - true - lies, true + lies, found.off_doubt, found.bend - of_bend, of_bend, found.doubt,
        ])[:, middle])  # fmt: skip
    left, whole, doubt, left_bend, bend, bend_doubt = np.concatenate(seen, axis=1)
    rms = [np.sqrt(np.mean(v**2)) for v in (left, whole, left_bend, bend)]
    assert rms[0] < 0.1 * rms[1] and rms[2] < 0.8 * rms[3]
    assert np.mean(np.abs(left) < 2 * doubt) > 0.85
    assert np.mean(np.abs(left_bend) < 2 * bend_doubt) > 0.85


def test_a_few_cells_of_something_else_do_not_matter(station):
    points, rng = grid(), np.random.default_rng(5)
    off = bent(station, points, rng) + rng.normal(0, 2e-5, len(points))
    usual = fit(station, Surface(points, off), TAUGHT, SCANNER)
    off[::25] += 1e-3
    spoilt = fit(station, Surface(points, off), TAUGHT, SCANNER)
    assert np.abs(spoilt.bend - usual.bend).max() < 1e-5
    assert spoilt.cells < usual.cells


def test_too_little_is_known(station):
    points = grid()
    with pytest.raises(FitError, match='known in 10 cells of the map, wanted are 50'):
        off = np.full(len(points), np.nan)
        off[:10] = 0.0
        fit(station, Surface(points, off), TAUGHT, SCANNER)


def test_known_are_level_cells_beside_the_region():
    nominal = np.zeros((80, 100))
    nominal[:, 60:] = -5.0  # a step
    z = nominal + 1e-5
    region = np.zeros(nominal.shape, bool)
    region[:, :20] = True
    z[:, 30:34] = 1e-3  # something lies there
    rows, columns = known_cells(z, nominal, region, 5e-4)
    assert len(rows) and columns.min() >= 27
    assert not np.isin(columns, np.r_[30:34, 57:63]).any() and (columns >= 63).any()
