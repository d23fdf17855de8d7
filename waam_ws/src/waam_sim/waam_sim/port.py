"""The client's end of the virtual controller's plant port (waam_firmware/doc/plant_port.md): steps in, readings out."""

from __future__ import annotations

import socket
import struct

import numpy as np

from waam_process.plant_port import SAMPLE

from .plant import Reading

STEP_MAGIC, ANSWER_MAGIC = 0x57414D53, 0x57414D41
HEADER = struct.Struct('<IIQ')
ANSWER = struct.Struct('<IIddddII')
MAX_SAMPLES = 1000


class PortError(ConnectionError):
    """The controller closed the connection or sent something other than a step; the text says which."""


class PlantPort:
    """A connected plant port. `samples` returned by `receive` is a view that the next call overwrites."""

    def __init__(self, path: str) -> None:
        """Raises OSError when nobody listens at the path."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(path)
        except OSError:
            self._socket.close()
            raise
        self._header = memoryview(bytearray(HEADER.size))
        self._body = bytearray(MAX_SAMPLES * SAMPLE.itemsize)
        self._views: dict[int, np.ndarray] = {}
        self._numbers = np.frombuffer(self._body, '<f8').reshape(MAX_SAMPLES, -1)[:, :5]

    def _fill(self, buffer: memoryview) -> None:
        got = 0
        while got < len(buffer):
            n = self._socket.recv_into(buffer[got:], 0, socket.MSG_WAITALL)
            if n == 0:
                raise PortError('the controller closed the plant port')
            got += n

    def receive(self) -> tuple[np.ndarray, int]:
        """Waits for a step: samples (n,) of SAMPLE and the controller time of its end in us. Raises PortError."""
        self._fill(self._header)
        magic, count, time_us = HEADER.unpack(self._header)
        if magic != STEP_MAGIC or not 0 < count <= MAX_SAMPLES:
            raise PortError(f'not a step of the plant port (magic {magic:#010x}, {count} samples)')
        if count not in self._views:
            self._views[count] = np.frombuffer(self._body, SAMPLE, count)
        self._fill(memoryview(self._body)[: count * SAMPLE.itemsize])
        if not np.isfinite(self._numbers[:count]).all():
            raise PortError('a step of the plant port holds a number that is not finite')
        return self._views[count], time_us

    def answer(self, r: Reading) -> None:
        """Answers the step. Raises OSError when the controller is gone."""
        self._socket.sendall(
            ANSWER.pack(
                ANSWER_MAGIC,
                r.inputs,
                r.current,
                r.voltage,
                r.wire_speed,
                r.distance,
                r.distance_reading,
                len(r.shaken),
            )
            + r.shaken.astype('<f4').tobytes()
        )

    def close(self) -> None:
        """Ends the connection; a `receive` in another thread returns with PortError."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            return
        finally:
            self._socket.close()
