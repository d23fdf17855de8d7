"""Segments that are slowed down to what the drives can do, before they are queued."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_bridge.program import Refusal
from waam_process.segment import Kind, Segment
from waam_robot.station import Station
from waam_robot_bridge.pace import OWN, Pacer
from waam_robot_bridge.params import RobotParams

ZERO = (0.1, 0.08, 0.02)
USUAL = RobotParams()


@pytest.fixture(scope='module')
def station() -> Station:
    return Station()


def segment(index, a, b, speed=0.1, **changes) -> Segment:
    kind = Kind.DEPOSIT if changes.get('arc') else Kind.IDLE
    return Segment(index, kind, tuple(map(float, a)), tuple(map(float, b)), speed, **changes)


def slow(share: float) -> RobotParams:
    """Joint 1 has only this share of its speed."""
    first, *others = USUAL.joint_speed_max
    return replace(USUAL, joint_speed_max=(first * share, *others))


def fastest(station, s: Segment) -> float:
    """rad/s of joint 1 at the segment's speed."""
    points = np.linspace(s.start, s.end, 200) + ZERO
    moved = np.abs(np.diff(station.joints(points)[:, 0]))
    return float(moved.max() / (s.length / 199) * s.speed)


def test_what_the_drives_can_do_stays(station):
    given = [
        segment(0, (0, 0, 0.03), (0.2, 0.1, 0.03), 0.5),
        segment(1, (0.2, 0.1, 0.03), (0, 0, 0.03)),
    ]
    assert Pacer(station, USUAL)(given, ZERO) == given


@pytest.mark.parametrize('own', [False, True])
def test_a_way_across_is_slowed_down_and_one_along_is_not(station, own):
    if not own:
        pytest.importorskip('toppra', reason='requirements-robot.txt is not installed')
    across = segment(0, (0.1, -0.05, 0.03), (0.1, 0.15, 0.03), 0.4)
    stop = Segment(1, Kind.DWELL, across.end, across.end, 0.1, dwell=0.1)
    along = segment(2, across.end, (0.101, 0.15, 0.08), 0.4)
    params = slow(0.06)
    pacer, told = Pacer(station, params), []
    if own:
        pacer.by = OWN
    pacer.on_slowed = told.append
    assert fastest(station, across) > params.joint_speed_max[0]
    out = pacer([across, stop, along], ZERO)
    assert out[1:] == [stop, along]
    assert 0.5 * across.speed < out[0].speed < across.speed
    assert fastest(station, out[0]) <= 0.9 * params.joint_speed_max[0] * 1.001
    assert out[0].at(speed=across.speed) == across
    assert told[0].count == 1 and 'J1 cannot go faster; by ' + pacer.by in told[0].text


def test_the_wire_goes_with_the_torch(station):
    lit = {'arc': True, 'wire_feed_speed': 0.1, 'voltage': 22.0}
    ways = [(0.002 * n, 0.002 * n + 0.002) for n in range(20)]
    bead = [segment(n, (0.1, a, 0), (0.1, b, 0), 0.02, **lit) for n, (a, b) in enumerate(ways)]
    out = Pacer(station, slow(0.004))(bead, ZERO)
    shares = np.array([b.speed / a.speed for a, b in zip(bead, out, strict=True)])
    assert (shares < 0.95).all() and (shares > 0.3).all()
    assert [b.wire_feed_speed for b in out] == pytest.approx((0.1 * shares).tolist())


def test_too_slow_for_the_arc_is_refused_with_joint_and_speed(station):
    bead = segment(
        7, (0.1, 0, 0), (0.1, 0.05, 0), 0.01, arc=True, wire_feed_speed=0.1, voltage=22.0
    )
    with pytest.raises(Refusal, match=r'segment 7: J1 allows 1\.\d+ mm/s and .* at least 3 mm/s'):
        Pacer(station, slow(0.0003))([bead], ZERO)


def test_a_segment_beside_the_box_is_left_to_the_check(station):
    far = segment(0, (0, 0, 0), (9, 0, 0), 0.5)
    assert Pacer(station, slow(0.01))([far], ZERO) == [far]
