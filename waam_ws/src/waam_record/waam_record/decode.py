"""Bytes of a recording to values, by the definitions that the recording carries itself.

By `rosbags`; telemetry, which comes by the thousand, is read with `waam_node.cdr`.
"""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


class DecodeError(ValueError):
    """A message that does not fit its definition; the text names the type."""


# what `waam_node.cdr` reads without a definition, in its order; of telemetry the rest may be anything
LAYOUTS = {
    'waam_msgs/msg/ProfileBatch': (
        'std_msgs/Header header, string sensor_id, uint32 sequence, uint32 profile_count, '
        'uint32 points_per_profile, int64[] stamp_offsets_ns, float32[] x, float32[] z, float32[] intensity'
    ),
    'waam_msgs/msg/Telemetry': (
        'std_msgs/Header header, uint64 controller_us, uint32 boot_id, uint32 sequence, uint8 state, '
        'geometry_msgs/Point position'
    ),
}


def check_layout(type_name: str, definition: bytes) -> None:
    """DecodeError when a recording's own definition of a message is not the one of LAYOUTS."""
    lines = definition.decode(errors='replace').split('\n=')[0].splitlines()
    parts = [line.split('#')[0].split() for line in lines]
    fields = ', '.join(' '.join(p) for p in parts if p and '=' not in p[-1])
    if not (fields.replace('/msg/', '/') + ',').startswith(LAYOUTS[type_name] + ','):
        raise DecodeError(f'{type_name} was recorded with other fields: {fields}')


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
        """Makes a type known; a second call has no effect. DecodeError when its definition cannot be read."""
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
