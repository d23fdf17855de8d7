"""Serialised batches and telemetry are read as the middleware writes them; broken ones are refused, never misread."""

import struct
from array import array

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message

from waam_msgs.msg import ProfileBatch, Telemetry
from waam_node.cdr import read_pose
from waam_node.conversions import floats
from waam_scan.conversions import block_from_msg
from waam_scan.stream.profiles import read_batch

TEXT = st.text(max_size=9)


def batch(n=3, m=4, intensity=True, frame='scanner', sensor='a'):
    rng = np.random.default_rng(n * 100 + m)
    msg = ProfileBatch(sensor_id=sensor, sequence=7, profile_count=n, points_per_profile=m)
    msg.header.frame_id = frame
    msg.header.stamp.sec, msg.header.stamp.nanosec = 1_700_000_000, 999_999_999
    msg.stamp_offsets_ns = array('q', (np.arange(n) * 10_000_000 - 5).tolist())
    x, z = rng.normal(size=(2, n * m))
    z[::3] = np.nan
    msg.x, msg.z = floats(x), floats(z)
    msg.intensity = floats(rng.random(n * m)) if intensity else floats(np.empty(0))
    return msg


@given(st.integers(1, 9), st.integers(1, 9), st.booleans(), TEXT, TEXT)
def test_a_batch_is_what_the_middleware_would_make_of_it(n, m, intensity, frame, sensor):
    msg = batch(n, m, intensity, frame, sensor)
    sequence, block = read_batch(serialize_message(msg))
    want = block_from_msg(msg)
    assert sequence == 7 and (block.stamps == want.stamps).all()
    assert block.x.tobytes() == want.x.tobytes() and block.z.tobytes() == want.z.tobytes()
    assert block.x.shape == block.z.shape == (n, m)


def test_the_points_are_not_copied():
    data = serialize_message(batch(50, 50))
    block = read_batch(data)[1]
    assert all(np.shares_memory(v, np.frombuffer(data, np.uint8)) for v in (block.x, block.z))


@given(TEXT, st.floats(-9, 9), st.integers(0, 2**63), st.integers(0, 3))
def test_a_pose_is_what_the_middleware_would_make_of_it(frame, x, clock, state):
    msg = Telemetry(controller_us=clock, state=state, sequence=3)
    msg.header.frame_id = frame
    msg.header.stamp.sec, msg.header.stamp.nanosec = 12, 345
    msg.position.x, msg.position.y, msg.position.z = x, -x, 2 * x
    assert read_pose(serialize_message(msg)) == (12_000_000_345, x, -x, 2 * x)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 400), st.binary(max_size=6), st.integers(0, 400))
@example(0, b'', 3)
@example(4, b'', 400)
def test_damaged_bytes_are_refused_or_still_fit_together(at, noise, cut):
    data = bytearray(serialize_message(batch(3, 4)))
    data[at : at + len(noise)] = noise
    for read in (read_batch, read_pose):
        try:
            found = read(bytes(data[:cut] if cut < 300 else data))
        except ValueError as e:
            assert str(e)
        else:
            assert read is read_pose or found[1].x.shape == found[1].z.shape


@pytest.mark.parametrize(
    'change, text',
    [
        (
            lambda m: setattr(m, 'profile_count', 4),
            'batch 7: stamp_offsets_ns has 3 values, 4 prof',
        ),
        (lambda m: setattr(m, 'points_per_profile', 5), 'batch 7: x has 12 values'),
        (lambda m: setattr(m, 'z', floats(np.zeros(11))), 'batch 7: z has 11 values'),
    ],
)
def test_counts_that_do_not_fit_are_named(change, text):
    msg = batch()
    change(msg)
    with pytest.raises(ValueError, match=text):
        read_batch(serialize_message(msg))
    with pytest.raises(ValueError, match=text):
        block_from_msg(msg)


def test_an_empty_batch_and_another_byte_order_are_refused():
    with pytest.raises(ValueError, match='empty batch'):
        read_batch(serialize_message(ProfileBatch(sequence=7)))
    data = serialize_message(batch())
    with pytest.raises(ValueError, match='little-endian'):
        read_batch(b'\x00\x00' + data[2:])
    with pytest.raises(ValueError, match='promised'):
        at = data.index(struct.pack('<I', 12), 40)  # length of x
        read_batch(data[:at] + struct.pack('<I', 2**31) + data[at + 4 :])
