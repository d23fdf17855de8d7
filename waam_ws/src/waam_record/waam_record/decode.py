"""Bytes of a recording to values, by the definitions that the recording carries itself.

By `rosbags`; telemetry, which comes by the thousand, is read with `waam_node.cdr`.
"""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


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
