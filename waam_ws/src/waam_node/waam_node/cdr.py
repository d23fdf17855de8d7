"""The few messages that are packed and read by hand, as layouts of their bytes (CDR, OMG DDS-XTYPES 7.4.1).

Telemetry comes up to a thousand times per second and a profile batch holds up to a million values. Making a message
object of each costs more than everything else that is done with it: 9 us instead of 1 us per telemetry frame, and a
copy of every array. All other messages go through rclpy.

Values lie at multiples of their size; positions count from behind the four bytes of the header. The tests compare
every layout with what rclpy makes of the same message. Knows no ROS, no clock and no file.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

HEAD = 4  # bytes of the header
LITTLE_ENDIAN = b'\x00\x01'  # plain CDR
NANO = 1_000_000_000

_STAMP = {True: struct.Struct('<iI'), False: struct.Struct('>iI')}  # by: little-endian
_POSITION = struct.Struct('<3d')
_HEADER = LITTLE_ENDIAN + b'\0\0'
_WORK = struct.pack('<I5s', 5, b'work\0')  # frame_id of telemetry, with its length
_TELEMETRY_HEAD = struct.Struct('<4siI9s7x')  # header, sec, nanosec, frame_id
_TELEMETRY = struct.Struct(
    '<QIIB7x'  # controller_us, boot_id, sequence, state
    '8d'  # position, speeds, current, voltage
    '???BII'  # arc_enabled, arc_established, gas; wire_feed; line_accepted, line_executed
    'H2x3f2I'  # blocks_free; overrides, lease_left; underruns, fault
)


class TelemetryFields(NamedTuple):
    """Fields of waam_msgs/Telemetry in their order, without the header. SI units."""

    controller_us: int
    boot_id: int
    sequence: int
    state: int
    x: float
    y: float
    z: float
    travel_speed: float
    wire_feed_commanded: float
    wire_feed_speed: float
    arc_current: float
    arc_voltage: float
    arc_enabled: bool
    arc_established: bool
    gas: bool
    wire_feed: int
    line_accepted: int
    line_executed: int
    blocks_free: int
    speed_override: float
    wire_override: float
    lease_left: float
    underruns: int
    fault: int


_FRAME = np.dtype({  # the layout of _TELEMETRY
    'names': list(TelemetryFields._fields), 'itemsize': _TELEMETRY.size,
    'formats': [
        '<u8', '<u4', '<u4', 'u1', *['<f8'] * 8, *['?'] * 3, 'u1', '<u4', '<u4', '<u2', *['<f4'] * 3, '<u4', '<u4',
    ],
    'offsets': [0, 8, 12, 16, *range(24, 88, 8), 88, 89, 90, 91, 92, 96, 100, 104, 108, 112, 116, 120],
})  # fmt: skip


class BatchFields(NamedTuple):
    """What a waam_msgs/ProfileBatch holds. The arrays are flat read-only views of its bytes; their lengths are not
    checked against the counts yet."""

    stamp_ns: int
    sequence: int
    profile_count: int
    points_per_profile: int
    stamp_offsets_ns: np.ndarray  # int64
    x: np.ndarray  # float32, m
    z: np.ndarray  # float32, m
    intensity: np.ndarray  # float32


def pack_telemetry(stamp_ns: int, fields: tuple[Any, ...]) -> bytes:
    """A serialised waam_msgs/Telemetry. `fields`: a TelemetryFields, or a plain tuple of the same values in the same
    order, which is made in a third of the time. struct.error when a value does not fit its type."""
    head = _TELEMETRY_HEAD.pack(_HEADER, stamp_ns // NANO, stamp_ns % NANO, _WORK)
    return head + _TELEMETRY.pack(*fields)


def stamp_ns(data: bytes) -> int:
    """header.stamp of any serialised message that begins with a Header. ValueError when it is cut off."""
    if len(data) < HEAD + 8:
        raise ValueError(f'{len(data)} bytes are too few for the stamp of a message')
    seconds, nanoseconds = _STAMP[bool(data[1] & 1)].unpack_from(data, HEAD)
    return seconds * NANO + nanoseconds


def read_pose(data: bytes) -> tuple[int, float, float, float]:
    """Stamp (ns) and wire tip (m, work) of a serialised waam_msgs/Telemetry. ValueError when it is cut off."""
    try:
        c = _Cursor(data)
        stamp = c.stamp_ns()
        at = HEAD + _position_at(c.number('I', 4))
        return stamp, *_POSITION.unpack_from(data, at)
    except struct.error as e:
        raise ValueError(f'telemetry of {len(data)} bytes: {e}') from None


def read_poses(frames: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) int64 ns and positions (n, 3) m of serialised Telemetry, whose frame_id is one for all."""
    if not frames:
        return np.empty(0, np.int64), np.empty((0, 3))
    size = len(frames[0])
    if any(len(f) != size for f in frames):
        parts = [read_poses([f]) for f in frames]
        return np.concatenate([t for t, _ in parts]), np.concatenate([p for _, p in parts])
    raw = np.frombuffer(b''.join(frames), np.uint8).reshape(len(frames), size)[:, HEAD:]
    seconds, nanos = (raw[:, i : i + 4].copy().view('<u4')[:, 0] for i in (0, 4))
    at = _position_at(int(raw[0, 8:12].copy().view('<u4')[0]))
    xyz = raw[:, at : at + _POSITION.size].copy().view('<f8')
    return seconds.astype(np.int64) * NANO + nanos, xyz


def read_frames(frames: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) int64 ns and all fields of serialised waam_msgs/Telemetry as a structured array (n,) with the names
    of `TelemetryFields`. ValueError: the frames are cut off, or their frame_ids are of different length."""
    if not frames:
        return np.empty(0, np.int64), np.empty(0, _FRAME)
    size = len(frames[0])
    if size < HEAD + 12 or any(len(f) != size for f in frames):
        raise ValueError('telemetry frames of different length, or too short for a header')
    raw = np.frombuffer(b''.join(frames), np.uint8).reshape(len(frames), size)[:, HEAD:]
    seconds, nanos = (raw[:, i : i + 4].copy().view('<u4')[:, 0] for i in (0, 4))
    at = _aligned(12 + int(raw[0, 8:12].copy().view('<u4')[0]), 8)
    if size - HEAD < at + _TELEMETRY.size:
        raise ValueError(f'telemetry of {size} bytes is cut off')
    fields = raw[:, at : at + _TELEMETRY.size].copy().view(_FRAME)[:, 0]
    return seconds.astype(np.int64) * NANO + nanos, fields


def read_batch(data: bytes) -> BatchFields:
    """A serialised waam_msgs/ProfileBatch. ValueError says what is wrong with its bytes."""
    try:
        c = _Cursor(data)
        stamp = c.stamp_ns()
        c.skip_text()  # frame_id
        c.skip_text()  # sensor_id
        counts = [c.number('I', 4) for _ in range(3)]
        arrays = [c.array(kind) for kind in ('<i8', '<f4', '<f4', '<f4')]
    except struct.error as e:
        raise ValueError(f'profile batch of {len(data)} bytes: {e}') from None
    return BatchFields(stamp, *counts, *arrays)


def _position_at(frame_id: int) -> int:
    """Where `position` of a Telemetry lies behind the header; frame_id: its length with the zero."""
    clock = _aligned(12 + frame_id, 8)
    return _aligned(clock + 8 + 4 + 4 + 1, 8)  # controller_us, boot_id, sequence, state


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size


class _Cursor:
    """Reads one value after the other; struct.error or ValueError when the bytes end before."""

    def __init__(self, data: bytes) -> None:
        if bytes(data[:2]) != LITTLE_ENDIAN:
            raise ValueError(f'not little-endian CDR (header {bytes(data[:HEAD]).hex()})')
        self._data, self._at = data, HEAD

    def _align(self, size: int) -> None:
        self._at = HEAD + _aligned(self._at - HEAD, size)

    def number(self, kind: str, size: int) -> Any:
        """An int or a float, as `kind` (of struct) says."""
        self._align(size)
        (value,) = struct.unpack_from('<' + kind, self._data, self._at)
        self._at += size
        return value

    def skip_text(self) -> None:
        length = self.number('I', 4)
        self._at += length

    def array(self, kind: str) -> np.ndarray:
        """A sequence of numbers of the NumPy type `kind`: a read-only view."""
        count, dtype = self.number('I', 4), np.dtype(kind)
        if count == 0:
            return np.empty(0, dtype)
        self._align(dtype.itemsize)
        start, self._at = self._at, self._at + count * dtype.itemsize
        if self._at > len(self._data):
            raise ValueError(f'{count} values of {kind} are promised where the message ends')
        return np.frombuffer(self._data, dtype, count, start)

    def stamp_ns(self) -> int:
        return self.number('i', 4) * NANO + self.number('I', 4)
