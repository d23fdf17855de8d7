"""Who lives, and what time it is."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_bridge.clock import ClockMap
from waam_bridge.lease import Lease


def test_the_slowest_required_node_decides():
    lease = Lease()
    lease.restart(5)
    assert lease.seen_us(1_000_000) == 1_000_000  # nobody required: the bridge's own time
    lease.require(['a', 'b', 'a'])
    assert lease.seen_us(1_000_000) == 0
    lease.beat('a', 900_000, 5, 1_000_000)
    assert lease.seen_us(1_000_000) == 0 and lease.silent(1_000_000) == ['b']
    assert lease.beat('b', 800_000, 5, 1_000_000)
    assert lease.seen_us(1_000_000) == 800_000 and lease.silent(1_000_000) == []
    assert lease.silent(1_150_000) == ['b']
    assert not lease.beat('c', 1_000_000, 5, 1_000_000)  # not required
    lease.require(['c'])
    assert lease.seen_us(1_000_000) == 1_000_000


def test_old_boots_old_ticks_and_the_future_do_not_count():
    lease = Lease()
    lease.restart(5)
    lease.require(['a'])
    assert not lease.beat('a', 100, 4, 1000)
    assert not lease.beat('a', 2000, 5, 1000)
    assert lease.beat('a', 500, 5, 1000)
    assert not lease.beat('a', 400, 5, 1000)
    assert lease.seen_us(1000) == 500
    lease.restart(6)
    assert lease.seen_us(1000) == 0


@given(
    st.lists(
        st.tuples(st.sampled_from('abc'), st.integers(0, 10**6), st.integers(4, 6)), max_size=40
    )
)
def test_the_lease_is_never_beyond_what_every_node_has_seen(beats):
    lease, seen = Lease(), dict.fromkeys('abc', 0)
    lease.restart(5)
    lease.require('abc')
    for node, tick, boot in beats:
        lease.beat(node, tick, boot, 500_000)
        if boot == 5 and tick <= 500_000:
            seen[node] = max(seen[node], tick)
        assert lease.seen_us(500_000) == min(seen.values())


def simulate(clock, seconds, drift, offset_ns, spread_s, seed=1, start=0):
    """Round trips at 20 Hz with one-sided random delays each way. Returns the largest error at the end, s."""
    rnd = random.Random(seed)
    for n in range(int(seconds * 20)):
        true_s = start + n * 0.05
        t_us = round(true_s * (1 + drift) * 1e6)
        up, down = (2e-4 + rnd.expovariate(1 / spread_s) for _ in range(2))
        clock.add(
            offset_ns + round((true_s - up) * 1e9), offset_ns + round((true_s + down) * 1e9), t_us
        )
    true_s = start + seconds
    return abs(clock.to_ros_ns(round(true_s * (1 + drift) * 1e6)) - offset_ns - true_s * 1e9) * 1e-9


@pytest.mark.parametrize('drift', [0.0, 5e-5, -2e-4])
def test_the_clock_is_found_through_jitter(drift):
    clock = ClockMap()
    error = simulate(clock, 20, drift, 1_700_000_000_000_000_000, 2e-3)
    assert error < 5e-4  # a quarter of the mean delay
    assert clock.drift == pytest.approx(-drift, abs=6e-5)
    assert clock.offset == pytest.approx(1.7e9, abs=1.0)
    assert 0 < clock.residual < 5e-3


def test_a_synchronised_clock_is_ros_time():
    clock = ClockMap()
    clock.reset(True)
    clock.add(0, 10**9, 5)
    assert clock.to_ros_ns(1_700_000_000_123_456) == 1_700_000_000_123_456_000
    assert clock.offset == 0.0 and clock.ready


def test_a_jump_of_ros_time_is_followed():
    clock = ClockMap()
    simulate(clock, 10, 0.0, 10**18, 1e-3)
    error = simulate(clock, 3, 0.0, 10**18 + 3600 * 10**9, 1e-3, start=10)
    assert error < 1e-3


def test_before_any_round_trip_the_clock_is_not_ready():
    assert not ClockMap().ready
