import dataclasses

import numpy as np
import pytest

from waam_adapt.laws.checks import MapLimits, MapOrigin, reasons_against
from waam_adapt.types import CorrectionInput, error_figures

SHAPE = (40, 50)
GOOD = MapOrigin(5.0, 'job', 'job', 3, 3, True)
LIMITS = MapLimits()


def surface(z=None, planned=2e-3, sigma=2e-5):
    z = np.zeros(SHAPE) if z is None else z
    return CorrectionInput(
        z, np.zeros(SHAPE), np.full(SHAPE, planned), 5e-4, 6e-3, 0.3, np.full(SHAPE, sigma)
    )


def test_a_good_map_has_nothing_against_it():
    assert reasons_against(GOOD, surface(), LIMITS) == ()


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'age': 400.0}, ('stale', '400.0 s', '300 s')),
        ({'age': -20.0}, ('stale', '-20.0 s')),
        ({'age': float('nan')}, ('stale',)),
        ({'job_id': 'x'}, ('stale', "'x'", "'job'")),
        ({'layers': 2}, ('stale', 'after layer 2, not 3')),
        ({'plausible': False}, ('implausible',)),
        ({'plausible': False, 'reasons': ('no pose',)}, ('implausible', 'no pose')),
    ],
)
def test_origin(change, words):
    reasons = reasons_against(dataclasses.replace(GOOD, **change), surface(), LIMITS)
    assert len(reasons) == 1
    assert all(w in reasons[0] for w in words)


def test_partial_map_counts_only_the_footprint():
    z = np.zeros(SHAPE)
    z[:, : round(0.6 * SHAPE[1])] = np.nan
    reasons = reasons_against(GOOD, surface(z), LIMITS)
    assert reasons == ('partial map: 40% of the footprint seen, limit 50%',)
    planned = np.zeros(SHAPE)
    planned[:, round(0.7 * SHAPE[1]) :] = 2e-3
    inside = CorrectionInput(z, np.zeros(SHAPE), planned, 5e-4, 6e-3, 0.3)
    assert reasons_against(GOOD, inside, LIMITS) == ()


def test_height_and_uncertainty_must_be_believable():
    assert 'median error 8.00 mm' in reasons_against(GOOD, surface(np.full(SHAPE, 8e-3)), LIMITS)[0]
    assert 'median sigma 0.50 mm' in reasons_against(GOOD, surface(sigma=5e-4), LIMITS)[0]


def test_nothing_planned_and_nothing_seen():
    assert 'nothing planned' in reasons_against(GOOD, surface(planned=0.0), LIMITS)[0]
    assert 'partial map: 0%' in reasons_against(GOOD, surface(np.full(SHAPE, np.nan)), LIMITS)[0]


def test_all_reasons_are_named_together():
    stale = dataclasses.replace(GOOD, age=1e4, plausible=False)
    assert len(reasons_against(stale, surface(np.full(SHAPE, 8e-3)), LIMITS)) == 3


def test_error_figures():
    z = np.zeros(SHAPE)
    z[:20] = 1e-3
    z[0, 0] = -3e-3
    rms, largest = error_figures(surface(z))
    assert rms == pytest.approx(np.sqrt((999 * 1e-6 + 9e-6) / 2000))
    assert largest == pytest.approx(3e-3)
    assert np.isnan(error_figures(surface(np.full(SHAPE, np.nan)))).all()
