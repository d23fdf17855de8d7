"""Bytes of a recording to values, by the definitions that the recording carries itself.

The messages that come by the thousand (telemetry, profiles) are read as arrays; all others by `rosbags`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

CDR_HEAD = 4  # bytes before the data; alignment counts from behind them


class DecodeError(ValueError):
    """A message that does not fit its definition; the text names the type."""


def alias(type_name: str) -> str:
    """The name by which rosbags registers a type; it puts `msg` into those of services."""
    package, kind, base = type_name.split('/')
    return type_name if kind in ('msg', 'action') else f'{package}/{kind}/msg/{base}'


class Decoder:
    """Deserialises messages of types that were `add`ed with their definition text."""

    def __init__(self) -> None:
        self._store: Typestore = get_typestore(Stores.EMPTY)
        self._known: set[str] = set()

    def add(self, type_name: str, definition: str) -> None:
        if type_name in self._known:
            return
        try:
            types = get_types_from_msg(definition, type_name)
            self._store.register({k: v for k, v in types.items() if k not in self._store.fielddefs})
        except Exception as e:  # rosbags raises what its parser raises
            raise DecodeError(f'the definition of {type_name} cannot be read: {e}') from None
        self._known.add(type_name)

    def message(self, type_name: str, data: bytes) -> Any:
        """The message as an object with the fields of its definition; arrays are numpy arrays."""
        try:
            return self._store.deserialize_cdr(data, alias(type_name))
        except Exception as e:
            raise DecodeError(f'a message {type_name} of {len(data)} bytes: {e}') from None


def poses(frames: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) int64 ns and positions (n, 3) m of serialised Telemetry, whose frame_id is one for all."""
    if not frames:
        return np.empty(0, np.int64), np.empty((0, 3))
    size = len(frames[0])
    if any(len(f) != size for f in frames):
        parts = [poses([f]) for f in frames]
        return np.concatenate([t for t, _ in parts]), np.concatenate([p for _, p in parts])
    raw = np.frombuffer(b''.join(frames), np.uint8).reshape(len(frames), size)[:, CDR_HEAD:]
    seconds, nanos = (raw[:, i : i + 4].copy().view('<u4')[:, 0] for i in (0, 4))
    name = int(raw[0, 8:12].copy().view('<u4')[0])  # length of frame_id with its zero
    at = _aligned(12 + name, 8) + 8 + 4 + 4 + 1  # controller_us, boot_id, sequence, state
    at = _aligned(at, 8)
    xyz = raw[:, at : at + 24].copy().view('<f8')
    return seconds.astype(np.int64) * 1_000_000_000 + nanos, xyz


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size
