import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from waam_adapt.feed import feed_forward as ff
from waam_adapt.feed import lead
from waam_process import materials
from waam_process.segment import Kind

STEEL = materials.get('er70s-6')
LIMITS = ff.Limits.of(STEEL, (3e-3, 20e-3), (2 / 60, 12 / 60))


def behind_lag(command, duration, lag, first):
    """Mean feed of every segment of a first-order drive that runs at `first` before."""
    actual, means = first, []
    for u, t in zip(command, duration, strict=True):
        end = u + (actual - u) * math.exp(-t / lag)
        means.append(u + (actual - end) * lag / t)
        actual = end
    return np.array(means)


@given(st.lists(st.floats(0.05, 0.15), min_size=2, max_size=30), st.floats(0.2, 1.0))
@example([0.125, 0.0625, 0.1484375, 0.0546875], 0.3515625)
def test_metal_arrives_where_it_is_meant(feeds, duration):
    """Exactly, where segments are long enough; a wire that would have to run backwards stops instead."""
    feed, t, lag = np.array(feeds), np.full(len(feeds), duration), 0.12
    joined = np.arange(len(feed)) > 0
    plain = behind_lag(feed, t, lag, feed[0]) - feed
    command = lead.wire_lead(feed, t, joined, lag)
    led = behind_lag(command, t, lag, feed[0]) - feed
    assert np.abs(led).sum() <= np.abs(plain).sum() + 1e-12
    if duration > 0.35:
        assert np.abs(led[command > 0]).max() < 1e-9
        assert (led[command == 0] >= 0).all()


def test_a_steady_bead_and_no_lag_need_no_lead_and_beads_do_not_know_each_other():
    feed = np.array([0.1, 0.1, 0.1, 0.05, 0.05])
    joined = np.array([False, True, True, False, True])
    t = np.full(5, 0.3)
    assert lead.wire_lead(feed, t, joined, 0.2) == pytest.approx(feed)
    assert (lead.wire_lead(feed * [1, 2, 1, 1, 1], t, joined, 0.0) == feed * [1, 2, 1, 1, 1]).all()


@pytest.mark.parametrize(('angle', 'share'), [(0.0, 0.0), (math.pi / 2, 0.25), (math.pi, 1.0)])
def test_corners_cost_the_time_of_braking(angle, share):
    way = np.array([[1.0, 0.0], [math.cos(angle), math.sin(angle)]])
    speed = np.full(2, 20e-3)
    extra = lead.corner_time(way, speed, np.array([False, True]), 0.1)
    rest = 20e-3 / (2 * 0.1)  # of starting, and of stopping at the end
    assert extra == pytest.approx(rest * (1 + share))


def corner_path(n=10):
    x = 5e-3 + 3e-3 * np.arange(n + 1)
    points = np.stack([x, np.zeros(n + 1), np.zeros(n + 1)], axis=1)
    points[6:, 0], points[6:, 1] = points[5, 0], 3e-3 * np.arange(1, n - 4)
    return ff.Path(
        np.arange(n), np.full(n, int(Kind.DEPOSIT)), points[:-1], points[1:], np.full(n, 2e-3),
        np.full(n, 6e-3), np.full(n, 10e-3),
    )  # fmt: skip


def test_feed_is_less_at_a_corner_and_the_terms_explain_it():
    drives = lead.Drives(acceleration=0.05)
    plain = ff.compute(corner_path(), STEEL, LIMITS, 22.0)
    s = ff.compute(corner_path(), STEEL, LIMITS, 22.0, drives=drives, heat_factor=0.9)
    assert (plain.lead_factor == 1).all()
    assert s.lead_factor[[4, 5]] == pytest.approx(s.lead_factor[4])
    assert s.lead_factor[4] < s.lead_factor[2] == 1.0
    assert s.wire_feed_speed == pytest.approx(plain.wire_feed_base * 0.9 * s.lead_factor)
    text = s.explain(4)
    assert f'x {s.lead_factor[4]:.4f} (lead)' in text
    assert 'x 0.9000 (heat)' in text
    assert 'limited: nothing' in text
