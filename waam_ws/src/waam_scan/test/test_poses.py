import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_scan.stream.poses import PoseStatus, PoseTrack

MS = 1_000_000
T0 = 1_763_000_000_000_000_000  # a ROS time of today: floats of seconds would lose 0.2 us here


def track_of(times_ms, positions, capacity=1000) -> PoseTrack:
    track = PoseTrack(capacity)
    for t, p in zip(times_ms, positions, strict=True):
        track.append(T0 + round(t * MS), *p)
    return track


@pytest.mark.parametrize('speed', [25e-3, -25e-3])
def test_interpolation_is_exact_on_a_steady_motion_in_both_directions(speed):
    t = np.arange(0, 1000, 10)
    track = track_of(t, [(speed * s * 1e-3, 0.1, 0.02) for s in t])
    ask = T0 + np.array([0, 5, 333, 987, 990]) * MS
    p, status = track.at(ask, 30 * MS)
    assert (status == PoseStatus.OK).all()
    assert np.allclose(p[:, 0], speed * np.array([0, 5, 333, 987, 990]) * 1e-3, atol=1e-12)
    assert np.allclose(p[:, 1:], [0.1, 0.02])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 60), min_size=3, max_size=40), st.randoms(use_true_random=False))
def test_a_pose_lies_between_its_neighbours_and_wide_gaps_give_none(steps, random):
    t = np.cumsum(steps)
    p = [(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)) for _ in t]
    track = track_of(t, p)
    ask = np.arange(int(t[0]) - 2, int(t[-1]) + 3)
    got, status = track.at(T0 + ask * MS, 30 * MS)
    for a, q, s in zip(ask, got, status, strict=True):
        if a < t[0]:
            assert s == PoseStatus.TOO_OLD
        elif a > t[-1]:
            assert s == PoseStatus.WAITING
        elif a in t:
            assert s == PoseStatus.OK and np.allclose(q, p[list(t).index(a)])
        else:
            i = int(np.searchsorted(t, a))
            wide = t[i] - t[i - 1] > 30
            assert s == (PoseStatus.GAP if wide else PoseStatus.OK)
            if not wide:
                low, high = np.minimum(p[i - 1], p[i]), np.maximum(p[i - 1], p[i])
                assert (low - 1e-12 <= q).all() and (q <= high + 1e-12).all()
        assert np.isnan(q).all() == (s != PoseStatus.OK)


def test_repeated_early_and_senseless_frames_are_counted_and_change_nothing():
    track = track_of([0, 10, 20], [(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    assert not track.append(T0 + 20 * MS, 9, 9, 9)
    assert not track.append(T0 + 15 * MS, 9, 9, 9)
    assert not track.append(T0 + 30 * MS, float('nan'), 0, 0)
    assert not track.append(T0 + 30 * MS, 0, float('inf'), 0)
    assert (track.repeated, track.out_of_order, track.not_finite, track.accepted) == (1, 1, 2, 3)
    p, _ = track.at(np.array([T0 + 15 * MS]), 30 * MS)
    assert np.allclose(p, [[1.5, 0, 0]])


def test_a_clock_that_was_set_back_starts_a_new_track():
    track = track_of([5000, 5010], [(0, 0, 0), (1, 0, 0)])
    assert track.append(T0, 7, 0, 0)
    assert (track.restarts, len(track)) == (1, 1)


def test_the_track_is_bounded_and_keeps_the_newest():
    track = track_of(range(1000), [(i, 0, 0) for i in range(1000)], capacity=64)
    assert len(track) == 64
    assert track.positions[0, 0] == 1000 - 64 and track.positions[-1, 0] == 999
    assert (np.diff(track.stamps) == MS).all()
    _, status = track.at(np.array([T0]), 30 * MS)
    assert status[0] == PoseStatus.TOO_OLD


def test_an_empty_track_waits_and_a_tiny_one_is_refused():
    p, status = PoseTrack(10).at(np.array([1, 2]), 30 * MS)
    assert np.isnan(p).all() and (status == PoseStatus.WAITING).all()
    with pytest.raises(ValueError, match='capacity'):
        PoseTrack(1)
