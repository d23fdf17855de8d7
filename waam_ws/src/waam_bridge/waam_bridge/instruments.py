"""Instruments on a serial port or behind Modbus, and the thread that reads them. All calls may wait, none for long."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

import serial
from pymodbus import ModbusException
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from .pyrometer import (
    MODBUS,
    Address,
    Lines,
    PyrometerParams,
    Reading,
    from_line,
    from_registers,
    unknown,
    words,
)

WAIT = 0.1  # s, at most for bytes
RETRY = 1.0  # s, until a port that could not be opened is tried again


class Instrument(Protocol):
    """OSError from any call: the instrument is gone and is opened anew. polled: it gives a reading when it is asked."""

    polled: bool

    def open(self) -> None:
        """Opens the port."""

    def read(self) -> Reading | None:
        """The next reading; None = none has come yet."""

    def close(self) -> None:
        """Closes the port, if it is open."""


class AsciiInstrument:
    """Lines of text on a serial port, by themselves or after a request."""

    def __init__(self, port: str, params: PyrometerParams) -> None:
        self._port, self._params = port, params
        self.polled = bool(params.request)
        self._lines = Lines(self.polled)
        self._serial: serial.Serial | None = None

    def open(self) -> None:
        """See Instrument."""
        rate = self._params.baud
        self._serial = serial.Serial(
            self._port, rate, timeout=WAIT, write_timeout=WAIT, exclusive=True
        )
        self._lines.clear()

    def read(self) -> Reading | None:
        """See Instrument."""
        assert self._serial is not None
        if not self.polled:
            return self._take()
        self._serial.reset_input_buffer()
        self._lines.clear()
        self._serial.write(self._params.request_bytes)
        end = time.monotonic() + self._params.timeout
        while time.monotonic() < end:
            if found := self._take():
                return found
        return unknown('no answer')

    def _take(self) -> Reading | None:
        """The newest whole line."""
        assert self._serial is not None
        lines = self._lines.add(self._serial.read(max(1, self._serial.in_waiting)))
        return from_line(lines[-1], self._params) if lines else None

    def close(self) -> None:
        """See Instrument."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None


class ModbusInstrument:
    """Registers of a Modbus device, RTU on a serial port or TCP."""

    polled = True

    def __init__(self, where: Address, params: PyrometerParams) -> None:
        self._params = params
        self._client: ModbusTcpClient | ModbusSerialClient
        if where.port:
            self._client = ModbusTcpClient(
                where.name, port=where.port, timeout=params.timeout, retries=0
            )
        else:
            self._client = ModbusSerialClient(
                where.name, baudrate=params.baud, timeout=params.timeout, retries=0
            )

    def open(self) -> None:
        """See Instrument."""
        if not self._client.connect():
            raise OSError('the Modbus device does not answer')

    def read(self) -> Reading | None:
        """See Instrument."""
        p, c = self._params, self._client
        ask = c.read_input_registers if p.register_kind == 'input' else c.read_holding_registers
        try:
            answer = ask(p.register, count=words(p), device_id=p.device)
        except ModbusException as e:
            raise OSError(str(e)) from None
        return (
            unknown(f'Modbus: {answer}')
            if answer.isError()
            else from_registers(answer.registers, p)
        )

    def close(self) -> None:
        """See Instrument."""
        self._client.close()


def instrument(where: Address, params: PyrometerParams) -> Instrument:
    """The one at this address, not opened."""
    if where.kind == MODBUS:
        return ModbusInstrument(where, params)
    return AsciiInstrument(where.name, params)


class Reader:
    """A thread that reads an instrument and hands every reading to `take`, in that thread; no more than `rate` of them
    a second, the others are dropped."""

    def __init__(self, source: Instrument, rate: float, take: Callable[[Reading], None]) -> None:
        self._source, self._period, self._take = source, 1.0 / rate, take
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='instrument', daemon=True)

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Starts the thread; it opens the port, again and again when it cannot."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._stop.set()
        if self.alive:
            self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._source.open()
                self._serve()
            except (OSError, ValueError) as e:
                self._take(unknown(str(e)))
            finally:
                self._source.close()
            self._stop.wait(RETRY)

    def _serve(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            found = self._source.read()
            now = time.monotonic()
            if found is None or now < due - self._period / 2:
                continue
            due = max(due + self._period, now)
            self._take(found)
            if self._source.polled:
                self._stop.wait(due - now)
