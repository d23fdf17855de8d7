"""Shared types survive the way through messages."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header

from waam_msgs.msg import AccelerationBatch, Anomaly
from waam_node.conversions import (
    floats,
    from_msg,
    grid_from_msg,
    grid_to_msg,
    image_to_msg,
    map_from_msg,
    nanoseconds,
    paths_from_msg,
    paths_to_msg,
    seconds,
    segment_from_msg,
    segment_to_msg,
    time_to_msg,
    to_msg,
)
from waam_process.grid import GridError, GridSpec
from waam_process.segment import Clamp, Kind, Segment

number = st.floats(-10, 10, allow_nan=False)
point = st.tuples(number, number, number)


@given(
    st.builds(
        Segment,
        index=st.integers(0, 2**31),
        kind=st.sampled_from(Kind),
        start=point,
        end=point,
        speed=number,
        layer=st.integers(0, 1000),
        arc=st.booleans(),
        wire_feed_speed=number,
        psi=number,
        clamps=st.sampled_from([Clamp.NONE, Clamp.PSI | Clamp.FEED_LOW]),
    )
)
def test_segment_round_trip(segment):
    assert segment_from_msg(segment_to_msg(segment)) == segment


@given(number, number, st.floats(1e-4, 1e-2), st.integers(1, 300), st.integers(1, 300))
def test_grid_round_trip(x, y, resolution, rows, cols):
    spec = GridSpec(x, y, resolution, rows, cols)
    assert grid_from_msg(grid_to_msg(spec)) == spec


def test_map_round_trip_keeps_nan_and_refuses_a_wrong_length():
    spec = GridSpec(0, 0, 1e-3, 2, 3)
    z = np.array([[1, np.nan, 3], [4, 5, 6]], np.float32)
    np.testing.assert_array_equal(map_from_msg(floats(z), spec), z)
    with pytest.raises(ValueError, match='5 values for a grid of 2 x 3'):
        map_from_msg(floats(z.ravel()[:5]), spec)


def test_empty_grid_message_is_refused():
    from waam_msgs.msg import GridInfo

    with pytest.raises(GridError, match='resolution'):
        grid_from_msg(GridInfo())


def test_image_shows_the_largest_y_first():
    z = np.array([[1.0, 2.0], [3.0, np.nan]])
    image = image_to_msg(z, Header(frame_id='work'))
    values = np.frombuffer(image.data, np.float32).reshape(2, 2)
    assert values[1, 0] == 1.0 and values[0, 0] == 3.0 and math.isnan(values[0, 1])
    assert image.encoding == '32FC1' and image.step == 8


@given(st.integers(1, 2**31 - 1), st.integers(0, 999_999))
def test_time_round_trip(sec, micro):
    stamp = time_to_msg(sec + micro * 1e-6)
    assert abs(nanoseconds(stamp) - (sec * 10**9 + micro * 1000)) < 1000
    assert seconds(stamp) == pytest.approx(sec + micro * 1e-6)


@given(st.lists(st.integers(0, 5), max_size=6), st.integers(0, 1000))
def test_paths_come_back_from_their_message(sizes, seed):
    rng = np.random.default_rng(seed)
    paths = [rng.uniform(-1, 1, (n, 2)).astype(np.float32).astype(float) for n in sizes]
    found = paths_from_msg(paths_to_msg(paths))
    assert [p.tolist() for p in found] == [p.tolist() for p in paths]


@dataclass(frozen=True)
class Told:
    """As Anomaly has it, and one field that only newer records have."""

    class_name: str
    layer: int
    position: tuple[float, float, float]
    new: float = 7.0


def test_a_dataclass_and_a_message_mirror_each_other_by_the_names_of_their_fields():
    known = Told('scan', 3, (1.0, 2.0, 3.0))
    stamp = Time(sec=5)
    with pytest.raises(AttributeError, match="no field 'new'"):
        to_msg(Anomaly, known)
    fields = {'class_name': 'scan', 'layer': np.int64(3), 'position': np.array([1, 2, 3])}
    msg = to_msg(Anomaly, stamp=stamp, frame='work', **fields)
    assert (msg.header.stamp, msg.header.frame_id) == (stamp, 'work')
    assert from_msg(Told, msg) == known
    assert from_msg(Told, msg, layer=9).layer == 9
    assert math.isnan(to_msg(Anomaly, position=None).position.x)
    batch = to_msg(AccelerationBatch, x=np.arange(3), sensor_id='a')
    assert batch.x.typecode == 'f' and batch.x.tolist() == [0, 1, 2]
