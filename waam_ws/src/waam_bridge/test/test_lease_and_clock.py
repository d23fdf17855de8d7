"""Who lives, and what time it is."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_bridge.arming import Arming
from waam_bridge.clock import ClockMap
from waam_bridge.lease import Lease

WALL = 1.0  # s: long after everything


def test_the_slowest_required_node_decides():
    lease = Lease()
    lease.restart(5)
    assert lease.seen_us(1_000_000) == 1_000_000  # nobody required: the bridge's own time
    lease.require(['a', 'b', 'a'], 0, 0.0)
    assert lease.seen_us(1_000_000) == 0
    lease.beat('a', 900_000, 5, 1_000_000, 0.1)
    assert lease.seen_us(1_000_000) == 0 and lease.silent(1_000_000, WALL) == ['b']
    assert lease.beat('b', 800_000, 5, 1_000_000, 0.1)
    assert lease.seen_us(1_000_000) == 800_000 and lease.silent(1_000_000, WALL) == []
    assert lease.silent(1_150_000, WALL) == ['b']
    assert not lease.beat('c', 1_000_000, 5, 1_000_000, 0.1)  # not required
    lease.require(['c'], 0, 0.0)
    assert lease.seen_us(1_000_000) == 1_000_000


def test_a_node_gets_time_to_answer_before_it_is_called_silent():
    """ARM names nodes whose ticks are old, for without a lease simulated time may have run ahead of them."""
    lease = Lease()
    lease.restart(5)
    lease.beat('a', 100_000, 5, 1_000_000, 9.0)
    lease.require(['a'], 1_000_000, 10.0)
    assert lease.behind(1_000_000) == ['a']
    assert lease.silent(1_200_000, 20.0) == []  # not 300 ms of controller time
    assert lease.silent(1_400_000, 10.1) == []  # not 150 ms on the wall
    assert lease.silent(1_400_000, 10.2) == ['a']
    lease.beat('a', 1_300_000, 5, 1_400_000, 10.2)
    assert lease.silent(1_900_000, 10.3) == [] and lease.silent(1_900_000, 10.4) == ['a']


def test_old_boots_old_ticks_and_the_future_do_not_count():
    lease = Lease()
    lease.restart(5)
    lease.require(['a'], 0, 0.0)
    assert not lease.beat('a', 100, 4, 1000, 0.0)
    assert not lease.beat('a', 2000, 5, 1000, 0.0)
    assert lease.beat('a', 500, 5, 1000, 0.0)
    assert not lease.beat('a', 400, 5, 1000, 0.0)
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
    lease.require('abc', 0, 0.0)
    for node, tick, boot in beats:
        lease.beat(node, tick, boot, 500_000, 0.0)
        if boot == 5 and tick <= 500_000:
            seen[node] = max(seen[node], tick)
        assert lease.seen_us(500_000) == min(seen.values())


OFFSET = 1_700_000_000_000_000_000


def simulate(clock, seconds, drift, offset_ns, spread_s, seed=1, start=0):
    """Round trips at 20 Hz with one-sided random delays each way. Returns the largest error afterwards, s."""
    rnd = random.Random(seed)
    worst = 0.0
    for n in range(int(seconds * 20)):
        true_s = start + n * 0.05
        t_us = round(true_s * (1 + drift) * 1e6)
        up, down = (1e-4 + rnd.expovariate(1 / spread_s) for _ in range(2))
        clock.add(
            offset_ns + round((true_s - up) * 1e9), offset_ns + round((true_s + down) * 1e9), t_us
        )
        if n * 0.05 > seconds / 2:
            worst = max(worst, abs(clock.to_ros_ns(t_us) - offset_ns - true_s * 1e9) * 1e-9)
    return worst


@pytest.mark.parametrize('drift', [0.0, 5e-5, -2e-4])
@pytest.mark.parametrize('spread', [1e-4, 2e-3])
def test_the_clock_is_found_through_jitter(drift, spread):
    clock = ClockMap()
    error = simulate(clock, 120, drift, OFFSET, spread)
    assert error < 0.25 * spread + 2e-5
    assert clock.drift == pytest.approx(-drift, abs=1e-5 * max(1.0, spread / 1e-4))
    assert clock.offset == pytest.approx(1.7e9, abs=1.0)


def test_the_residual_is_what_the_line_was_off_by():
    """On a quiet cable within 0.2 ms; in between half of the round trips are held up by 20 ms on the way back."""
    quiet = ClockMap()
    simulate(quiet, 120, 5e-5, OFFSET, 1e-4)
    assert 0 < quiet.residual < 2e-4
    held = ClockMap()
    rnd = random.Random(3)
    for n in range(2400):
        true_s, late = n * 0.05, rnd.random() < 0.5
        back = 0.02 * late + 1e-4 + rnd.expovariate(1e4)
        ends = (OFFSET + round((true_s + d) * 1e9) for d in (-1e-4 - rnd.expovariate(1e4), back))
        held.add(*ends, round(true_s * 1e6))
    assert 0 < held.residual < 2e-4
    assert abs(held.to_ros_ns(119_000_000) - OFFSET - 119 * 10**9) < 1e5


def test_a_synchronised_clock_is_ros_time():
    clock = ClockMap()
    clock.reset(True)
    clock.add(0, 10**9, 5)
    assert clock.to_ros_ns(1_700_000_000_123_456) == 1_700_000_000_123_456_000
    assert clock.offset == 0.0 and clock.ready


@pytest.mark.parametrize('jump', [3600.0, 0.06, -0.02])
def test_a_jump_of_a_clock_is_followed(jump):
    clock = ClockMap()
    simulate(clock, 30, 0.0, 10**18, 1e-4)
    assert simulate(clock, 6, 0.0, 10**18 + round(jump * 1e9), 1e-4, start=30) < 2e-4


def test_before_any_round_trip_the_clock_is_not_ready():
    assert not ClockMap().ready


def test_a_node_that_is_late_is_waited_for_until_it_is_lost():
    arming = Arming()
    arming.arm('job', ['cell', 'scan'], 1_000_000, 0.0)
    assert not arming.waits(1_000_000)  # nobody was heard yet: that is not late but absent
    arming.beat('cell', 1_000_000, 0, 1_000_000, 0.1)
    arming.beat('scan', 900_000, 0, 1_000_000, 0.1)
    assert [arming.waits(t) for t in (1_149_999, 1_150_000, 1_399_999, 1_400_000)] == [
        False,
        True,
        True,
        False,
    ]
    arming.disarm()
    assert not arming.waits(1_200_000)
