"""Width of a free bead from profiles across it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_scan.bead_width import WidthError, bead_width, section_width

NOISE = 3e-5


def profile(width, height=2e-3, off=0.0, tilt=0.0, seed=101, points=640, noise=NOISE):
    """across, z (m) of a parabola on a tilted plate, seen over 50 mm."""
    across = np.linspace(-0.025, 0.025, points)
    u = 2 * (across - off) / width
    z = 0.02 + tilt * across + height * np.clip(1 - u * u, 0, None)
    return across, z + noise * np.random.default_rng(seed).standard_normal(points)


@given(
    st.floats(3e-3, 11e-3),
    st.floats(0.8e-3, 3e-3),
    st.floats(-0.5e-3, 0.5e-3),
    st.floats(-0.1, 0.1),
    st.integers(0, 1000),
)
def test_width_of_a_parabola_is_found_on_any_plate(width, height, off, tilt, seed):
    found, u = section_width(*profile(width, height, off, tilt, seed), reach=9e-3)
    assert found == pytest.approx(width, abs=5 * u + 0.02e-3)
    assert 0 < u < 0.1e-3 * (3e-3 / height)


def test_the_uncertainty_is_that_of_the_scatter():
    found = np.array([section_width(*profile(7e-3, seed=s), reach=9e-3) for s in range(200)])
    assert found[:, 0].std() == pytest.approx(found[:, 1].mean(), rel=0.25)


def test_spikes_and_lost_points_do_not_matter():
    across, z = profile(7e-3)
    z[300:310:3] += 1.5e-3
    z[330:345] = np.nan
    found, _ = section_width(across, z, 9e-3)
    assert found == pytest.approx(7e-3, abs=0.1e-3)


@pytest.mark.parametrize('what', ['flat', 'no echo', 'one side'])
def test_where_there_is_no_free_bead_there_is_no_width(what):
    across, z = profile(7e-3, height=0.0 if what == 'flat' else 2e-3)
    if what == 'no echo':
        z[:] = np.nan
    if what == 'one side':
        z[across > 3e-3] = np.nan
    assert np.isnan(section_width(across, z, 9e-3)).all()


def scan(width, angle, n=60, length=0.06, ripple=0.0):
    """Profiles (n, m, 3) across a bead of `length` from (0.01, 0.02) at an angle (rad); its end."""
    along = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-along[1], along[0]])
    start = np.array([0.01, 0.02])
    found = []
    for i, s in enumerate(np.linspace(0, length, n)):
        across, z = profile(width + ripple * np.sin(s / 4e-3), seed=i)
        found.append(np.column_stack([start + s * along + across[:, None] * normal, z]))
    return np.array(found), tuple(start), tuple(start + length * along)


@pytest.mark.parametrize('angle', [0.0, 0.7, np.pi / 2, 3.0])
def test_mean_width_along_a_bead_in_any_direction(angle):
    points, start, end = scan(6.5e-3, angle)
    found = bead_width(points, start, end)
    assert found.width == pytest.approx(6.5e-3, abs=0.02e-3)
    assert found.profiles == 40  # without the ends
    assert found.u < 0.02e-3


def test_a_bead_that_varies_has_a_larger_uncertainty():
    even, rippled = (bead_width(*scan(6.5e-3, 0.0, ripple=r)) for r in (0.0, 0.4e-3))
    assert rippled.u > 5 * even.u


def test_what_cannot_be_measured_says_why():
    points, start, end = scan(6.5e-3, 0.0)
    with pytest.raises(WidthError, match='15.0 mm is too short: 20 mm are its ends'):
        bead_width(points, start, (start[0] + 0.015, start[1]))
    points[..., 2] = 0.02
    with pytest.raises(WidthError, match='0 of 60 profiles show a free bead'):
        bead_width(points, start, end)
