"""What a pyrometer beside the controller says: where it is, and its answers as temperatures or as unknown. Pure."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from waam_node.params import ParameterError, param

SERIAL, MODBUS, TOPIC = 'serial', 'modbus', 'topic'
UNITS = {'degC': (1.0, 0.0), 'K': (1.0, -273.15), 'degF': (1 / 1.8, -32 / 1.8)}  # factor, offset
REGISTERS = {'int16': '>h', 'uint16': '>H', 'int32': '>i', 'float32': '>f', 'float32_swapped': '>f'}
LINE_LIMIT = 256  # bytes without an end of line that no instrument sends
NUMBER = re.compile(r'[-+]?\d{1,6}(?:[.,]\d{1,6})?', re.ASCII)


class Address(NamedTuple):
    """kind: one of SERIAL, MODBUS, TOPIC; name: port of the computer, host or topic; port: of TCP, 0 = a serial one."""

    kind: str
    name: str
    port: int = 0


def address(source: str) -> Address:
    """Raises ValueError for what is no source."""
    kind, _, name = source.partition(':')
    if kind not in (SERIAL, MODBUS, TOPIC) or not name:
        raise ValueError(
            f"'{source}' is no pyrometer: serial:PORT, modbus:PORT, modbus:HOST:PORT or topic:NAME"
        )
    if kind != MODBUS or name.startswith('/'):
        return Address(kind, name)
    host, _, port = name.rpartition(':')
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"'{source}': a Modbus instrument is modbus:PORT or modbus:HOST:PORT")
    return Address(kind, host, int(port))


@dataclass(frozen=True)
class PyrometerParams:
    """An instrument of 0.1 K on a serial port that speaks by itself."""

    source: str = param(
        'serial:/dev/pyrometer',
        'serial:/dev/..., modbus:/dev/... (RTU), modbus:HOST:PORT (TCP), or topic:NAME of a driver',
    )
    baud: int = param(9600, 'of a serial port', 'Bd', 300, 4000000)
    request: str = param(
        '', r"what is sent for a reading, as '?T\r'; empty = the instrument speaks by itself"
    )
    pattern: str = param(
        r'\s*(\S+?)\s*(?:°?C)?\s*',
        'regular expression for a whole line; its first group is the number',
    )
    unit: str = param('degC', 'of the instrument', choices=tuple(UNITS))
    device: int = param(1, 'Modbus: number of the device', '', 0, 255)
    register: int = param(0, 'Modbus: address of the first register, from 0', '', 0, 65535)
    register_kind: str = param('input', 'Modbus', choices=('input', 'holding'))
    register_type: str = param('int16', 'Modbus; swapped: low word first', choices=tuple(REGISTERS))
    scale: float = param(1.0, 'Modbus: unit per count', '', 1e-6, 1e6)
    rate: float = param(10.0, 'readings, at most', 'Hz', 0.5, 100.0)
    range_low: float = param(-50.0, 'lowest reading that is one', 'degC', -273.0, 3500.0)
    range_high: float = param(3000.0, 'highest reading that is one', 'degC', -273.0, 3500.0)
    timeout: float = param(1.0, 'silence after which the temperature is unknown', 's', 0.1, 10.0)

    def __post_init__(self) -> None:
        try:
            groups = re.compile(self.pattern).groups
        except re.error as e:
            raise ParameterError(f"parameter 'pattern': {e}") from None
        try:
            _ = self.request_bytes
        except ValueError as e:
            raise ParameterError(f"parameter 'request': {e}") from None
        if groups < 1:
            raise ParameterError("parameter 'pattern': a group in ( ) must hold the number")
        if not self.range_low < self.range_high:
            raise ParameterError("parameter 'range_high' must be above 'range_low'")

    @property
    def request_bytes(self) -> bytes:
        """`request` with its escapes resolved."""
        return self.request.encode().decode('unicode_escape').encode('latin-1')


class Reading(NamedTuple):
    """celsius: NaN when it is unknown; problem: why, '' = it is known."""

    celsius: float
    problem: str = ''


def unknown(problem: str) -> Reading:
    """No temperature, and why."""
    return Reading(math.nan, problem)


def judged(value: float, p: PyrometerParams) -> Reading:
    """A number in the unit of the instrument."""
    factor, offset = UNITS[p.unit]
    celsius = value * factor + offset
    if not math.isfinite(celsius):
        return unknown(f'the instrument says {value}')
    if not p.range_low <= celsius <= p.range_high:
        return unknown(f'{celsius:.1f} degC, outside {p.range_low:g} .. {p.range_high:g}')
    return Reading(celsius)


def from_line(line: bytes, p: PyrometerParams) -> Reading:
    """A line of an ASCII instrument without its end. It must match as a whole: an error code is no temperature."""
    try:
        text = line.decode('utf-8')
    except UnicodeDecodeError:
        text = line.decode('latin-1')  # older instruments have their degree sign so
    found = re.fullmatch(p.pattern, text)
    number = NUMBER.fullmatch(found[1] or '') if found else None
    if not number:
        return unknown(f'{text[:40]!a} is no temperature')
    return judged(float(number[0].replace(',', '.')), p)


def words(p: PyrometerParams) -> int:
    """Registers of a reading."""
    return struct.calcsize(REGISTERS[p.register_type]) // 2


def from_registers(registers: Sequence[int], p: PyrometerParams) -> Reading:
    """Of a Modbus device, 16 bits each, in the order of their addresses."""
    if len(registers) != words(p):
        return unknown(f'{len(registers)} registers in the answer, not {words(p)}')
    order = registers[::-1] if p.register_type == 'float32_swapped' else registers
    data = b''.join(r.to_bytes(2, 'big') for r in order)
    (value,) = struct.unpack(REGISTERS[p.register_type], data)
    return judged(value * p.scale, p)


class Lines:
    """Bytes of a serial port become lines. What comes before the first end of a line may be the rest of one, and
    12.4 the rest of 312.4: it is dropped, unless the instrument was asked for it."""

    def __init__(self, asked: bool) -> None:
        self._rest, self._whole, self._asked = b'', asked, asked

    def clear(self) -> None:
        """Another answer begins."""
        self._rest, self._whole = b'', self._asked

    def add(self, data: bytes) -> list[bytes]:
        """Whole lines, without empty ones."""
        *lines, self._rest = re.split(rb'[\r\n]', self._rest + data)
        if lines and not self._whole:
            self._whole = True
            del lines[0]
        if len(self._rest) > LINE_LIMIT:
            self._rest, self._whole = b'', False
        return [line for line in lines if line.strip()]
