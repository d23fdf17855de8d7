"""Profiles beside the burning arc: how much is spoilt, that it lasts, and that nothing is without an arc."""

from __future__ import annotations

import numpy as np
import pytest

from waam_sim.arclight import Arclight, ArclightParams
from waam_sim.drive import Drive

LATERAL = np.linspace(-0.025, 0.025, 640)
CALM = ArclightParams(glare=0.0, spatter=0.0, smoke=0.0, lost=0.0)


def spoilt(params: ArclightParams, count: int = 2000, seed: int = 1) -> np.ndarray:
    """(count, points) of z, whose truth is 0, at 100 Hz."""
    light = Arclight.of(params, seed)
    z = np.zeros((count, len(LATERAL)), np.float32)
    light.spoil(np.arange(count) * 10_000, LATERAL, z, np.full_like(z, 0.5))
    return z


def test_the_shares_are_those_of_the_recorded_profiles():
    z = spoilt(ArclightParams())
    seen = np.isfinite(z)
    assert 0.04 < (np.abs(z[seen]) > 1.5e-3).mean() < 0.12
    assert 0.02 < 1 - seen.mean() < 0.2
    assert not seen.any(axis=1).all()
    assert np.abs(z[seen]).max() < 0.08


@pytest.mark.parametrize(
    ('params', 'share'),
    [
        (ArclightParams(glare=0.15, spatter=0.0, smoke=0.0, lost=0.0), 0.15),
        (ArclightParams(glare=0.0, spatter=0.0, smoke=0.2, lost=0.0), 0.2),
    ],
)
def test_glare_and_smoke_come_in_stretches(params, share):
    hit = (spoilt(params, 20_000) != 0).any(axis=1)  # NaN counts
    assert hit.mean() == pytest.approx(share, rel=0.25)
    stretches = np.diff(np.flatnonzero(np.diff(hit.astype(int)) != 0))
    lasting = params.glare_time if params.glare else params.smoke_time
    assert hit.sum() / max(len(stretches) / 2, 1) * 0.01 == pytest.approx(lasting, rel=0.4)


def test_the_same_seed_spoils_alike_and_calm_light_nothing():
    a, b, other = (
        spoilt(ArclightParams()),
        spoilt(ArclightParams()),
        spoilt(ArclightParams(), seed=2),
    )
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, other, equal_nan=True)
    assert (spoilt(CALM) == 0).all()


def test_without_an_arc_profiles_are_as_they_were(make_cell):
    """The lights differ, the profiles do not."""
    found = []
    for light in (CALM, ArclightParams(spatter=50.0)):
        plant = make_cell(groups={'arclight': light})
        plant.scanning = True
        drive = Drive(plant, (-0.01, 0.03, 0.03), plant.time_us + 1_000_000)
        drive.wait(0.05)
        found.append(np.concatenate([p.z for p in drive.profiles]))
    np.testing.assert_array_equal(*found)
