"""The layouts that are written by hand are those of rclpy; bytes that end before are refused."""

from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from waam_msgs.msg import HeightMap, ProfileBatch, Telemetry
from waam_node import cdr

U8, U16, U32, U64 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64))
FLOAT, FLOAT32 = st.floats(allow_nan=False), st.floats(-(2.0**127), 2.0**127, width=32)
STAMPS = st.integers(0, 2**31 * cdr.NANO - 1)
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
UNSIGNED = {
    'controller_us': U64, 'state': U8, 'wire_feed': U8, 'blocks_free': U16,
    **dict.fromkeys(('boot_id', 'sequence', 'line_accepted', 'line_executed', 'underruns', 'fault'), U32),
}  # fmt: skip
SINGLE = dict.fromkeys(('speed_override', 'wire_override', 'lease_left'), FLOAT32)
FLAGS = dict.fromkeys(('arc_enabled', 'arc_established', 'gas'), st.booleans())
KINDS = {**dict.fromkeys(cdr.TelemetryFields._fields, FLOAT), **UNSIGNED, **SINGLE, **FLAGS}
FIELDS = st.builds(cdr.TelemetryFields, **KINDS)
SOME = cdr.TelemetryFields(*[1] * 4, *[1.0] * 8, *[True] * 3, *[1] * 4, *[1.0] * 3, *[1] * 2)


def stamped(msg, ns, frame_id='work'):
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(ns, cdr.NANO)
    msg.header.frame_id = frame_id
    return msg


def telemetry(ns, fields, frame_id='work'):
    msg = stamped(Telemetry(), ns, frame_id)
    for name, value in fields._asdict().items():
        setattr(msg.position if name in 'xyz' else msg, name, value)
    return msg


def batch(ns, sequence, frame_id, sensor, n, m, intensity):
    rng = np.random.default_rng(n * 100 + m)
    msg = ProfileBatch(
        sensor_id=sensor, sequence=sequence, profile_count=n, points_per_profile=m,
        stamp_offsets_ns=array('q', rng.integers(-(2**40), 2**40, n).tolist()),
        **{name: array('f', rng.normal(size=n * m).tolist()) for name in ('x', 'z')},
    )  # fmt: skip
    msg.intensity = array('f', rng.random(n * m).tolist() if intensity else [])
    return stamped(msg, ns, frame_id)


@settings(deadline=None)
@given(STAMPS, FIELDS)
def test_packed_telemetry_is_the_message(ns, fields):
    message = telemetry(ns, fields)
    packed, sent = cdr.pack_telemetry(ns, fields), serialize_message(message)
    assert len(packed) == len(sent)  # not compared: the padding, which is not initialised there
    assert deserialize_message(packed, Telemetry) == message
    assert cdr.pack_telemetry(ns, tuple(fields)) == packed


def test_telemetry_that_does_not_fit_its_types_is_refused():
    fields = cdr.TelemetryFields(*[0] * len(cdr.TelemetryFields._fields))
    with pytest.raises(cdr.struct.error):
        cdr.pack_telemetry(0, fields._replace(blocks_free=2**16))
    with pytest.raises(cdr.struct.error):
        cdr.pack_telemetry(0, fields[:-1])


@settings(deadline=None)
@given(STAMPS, FIELDS, TEXT)
def test_a_pose_is_that_of_the_message(ns, fields, frame_id):
    data = serialize_message(telemetry(ns, fields, frame_id))
    xyz = fields.x, fields.y, fields.z
    assert cdr.read_pose(data) == (ns, *xyz)
    stamps, positions = cdr.read_poses([data, data])
    assert stamps.tolist() == [ns, ns] and positions.tolist() == [list(xyz)] * 2


@settings(deadline=None)
@given(st.lists(st.tuples(STAMPS, FIELDS, st.sampled_from(['work', 'a', 'another'])), max_size=5))
def test_poses_at_once_are_those_read_one_by_one(frames):
    """With names of one length and of several."""
    data = [serialize_message(telemetry(*f)) for f in frames]
    stamps, positions = cdr.read_poses(data)
    assert (stamps.dtype, positions.shape) == (np.int64, (len(frames), 3))
    assert [(t, *p) for t, p in zip(stamps.tolist(), positions.tolist(), strict=True)] == [
        cdr.read_pose(d) for d in data
    ]


@settings(deadline=None)
@given(STAMPS, U32, TEXT, TEXT, st.integers(0, 9), st.integers(0, 9), st.booleans())
def test_a_batch_is_the_message(ns, sequence, frame_id, sensor, n, m, intensity):
    msg = batch(ns, sequence, frame_id, sensor, n, m, intensity)
    found = cdr.read_batch(serialize_message(msg))
    assert found[:4] == (ns, sequence, n, m)
    for name in ('stamp_offsets_ns', 'x', 'z', 'intensity'):
        read, sent = getattr(found, name), getattr(msg, name)
        assert (read.dtype.char, read.tobytes()) == (
            sent.typecode.replace('q', 'l'),
            sent.tobytes(),
        )


def test_the_arrays_of_a_batch_are_not_copied():
    data = serialize_message(batch(0, 1, 'scanner', 'a', 50, 50, True))
    found, raw = cdr.read_batch(data), np.frombuffer(data, np.uint8)
    assert all(np.shares_memory(values, raw) for values in found[4:])


@settings(deadline=None)
@given(STAMPS, st.sampled_from([Telemetry, ProfileBatch, HeightMap]), TEXT)
def test_the_stamp_is_that_of_the_message(ns, kind, frame_id):
    data = serialize_message(stamped(kind(), ns, frame_id))
    assert cdr.stamp_ns(data) == ns
    swapped = bytes((0, 0, 0, 0)) + data[4:8][::-1] + data[8:12][::-1]
    assert cdr.stamp_ns(swapped) == ns


@settings(deadline=None)
@given(st.data())
def test_bytes_that_end_before_are_refused(data):
    whole = {
        cdr.read_batch: serialize_message(batch(0, 1, 'scanner', 'a', 3, 4, True)),
        cdr.read_pose: serialize_message(telemetry(1, SOME))[:76],
        cdr.stamp_ns: serialize_message(stamped(Telemetry(), 5))[:12],
    }  # fmt: skip
    read = data.draw(st.sampled_from(list(whole)))
    read(whole[read])
    with pytest.raises(ValueError, match='.'):
        read(whole[read][: data.draw(st.integers(0, len(whole[read]) - 1))])


@given(st.binary(max_size=200))
def test_noise_is_read_or_refused(noise):
    for read in (cdr.read_batch, cdr.read_pose, cdr.stamp_ns):
        for data in (noise, b'\0\1\0\0' + noise):
            try:
                read(data)
            except ValueError as e:
                assert str(e)


@settings(deadline=None)
@given(st.lists(st.tuples(STAMPS, FIELDS), max_size=5))
def test_many_frames_are_read_as_they_were_packed(frames):
    stamps, fields = cdr.read_frames([cdr.pack_telemetry(ns, f) for ns, f in frames])
    assert stamps.tolist() == [ns for ns, _ in frames]
    assert [cdr.TelemetryFields(*f) for f in fields.tolist()] == [f for _, f in frames]


@pytest.mark.parametrize('cut', [0, 15, 40, 150])
def test_many_frames_that_are_cut_off_are_refused(cut):
    with pytest.raises(ValueError, match='telemetry'):
        cdr.read_frames([cdr.pack_telemetry(1, SOME)[:cut]])
