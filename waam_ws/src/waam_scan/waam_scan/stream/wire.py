"""Profile batches and telemetry as they come over the wire and lie in recordings (CDR, OMG DDS-XTYPES 7.4.1), read
without copying the arrays. Offsets and alignment count from behind the four bytes of the encapsulation header."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from .profiles import ProfileBlock, block_of

HEAD = 4  # bytes of the encapsulation header
LITTLE_ENDIAN = b'\x00\x01'  # plain CDR; all others are refused
NANO = 1_000_000_000


class _Cursor:
    """Reads one value after the other; struct.error or ValueError when the bytes end before."""

    def __init__(self, data: bytes) -> None:
        if bytes(data[:2]) != LITTLE_ENDIAN:
            raise ValueError(f'not little-endian CDR (header {bytes(data[:HEAD]).hex()})')
        self._data, self._at = data, HEAD

    def _align(self, size: int) -> None:
        self._at += -(self._at - HEAD) % size

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


def read_batch(data: bytes) -> tuple[int, ProfileBlock]:
    """Sequence number and profiles of a serialised waam_msgs/ProfileBatch. ValueError says what is wrong with it."""
    try:
        c = _Cursor(data)
        start = c.stamp_ns()
        c.skip_text()  # frame_id
        c.skip_text()  # sensor_id
        sequence, n, m = (c.number('I', 4) for _ in range(3))
        offsets = c.array('<i8')
        x, z, light = (c.array('<f4') for _ in range(3))
    except struct.error as e:
        raise ValueError(f'profile batch of {len(data)} bytes: {e}') from None
    return sequence, block_of(sequence, n, m, start, offsets, x, z, light)


def read_pose(data: bytes) -> tuple[int, float, float, float]:
    """Stamp (ns) and wire tip (m, work) of a serialised waam_msgs/Telemetry. ValueError when it is cut off."""
    try:
        c = _Cursor(data)
        stamp = c.stamp_ns()
        c.skip_text()  # frame_id
        for kind, size in (('Q', 8), ('I', 4), ('I', 4), ('B', 1)):  # clock, boot, sequence, state
            c.number(kind, size)
        return stamp, c.number('d', 8), c.number('d', 8), c.number('d', 8)
    except struct.error as e:
        raise ValueError(f'telemetry of {len(data)} bytes: {e}') from None
