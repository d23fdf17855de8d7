"""The lines of the link (docs/link_protocol.md): what they say, how they are built and checked. See `parsing`."""

from __future__ import annotations

from binascii import crc_hqx
from typing import NamedTuple
from zlib import crc32

import numpy as np

from waam_process.names import CONTROLLER_STATES

MAX_LINE = 160  # bytes of a line to the controller, newline included
MAX_ANSWER = 480  # bytes of a line from the controller; identifications grow with the firmware
# real-time bytes act when two come in a row; four survive the loss of any two
STOP_NOW, HOLD_NOW = b'\x82' * 4, b'\x80' * 4
CRC16, CRC32 = 5, 10  # digits of a check

IDLE, RUN, HOLD, ALARM = range(4)
STATES = {name.encode(): number for number, name in enumerate(CONTROLLER_STATES)}

# flags of telemetry
ARC_ENABLED, ARC_ESTABLISHED, GAS, HOMED, ARMED, QUEUE_EMPTY, ESTOP, WIRE_JOG, UNDERFEED = (
    1, 2, 4, 8, 16, 32, 64, 128, 256,
)  # fmt: skip

CODES = {
    100: 'check failed', 101: 'gap in line numbers', 102: 'syntax', 103: 'unknown word',
    104: 'bad number', 105: 'contradiction', 106: 'line too long', 107: 'missing word',
    108: 'not now', 200: 'hold by host', 201: 'link watchdog', 202: 'arc lease expired',
    203: 'planner ran dry with the arc on', 204: 'arc lost', 205: 'no arc at start',
    206: 'wire fault', 207: 'gas', 208: 'stubbing', 209: 'burn-back', 210: 'over-temperature',
    211: 'wire frozen in the bead', 212: 'standoff: back to the programmed z', 213: 'accelerometer',
    300: 'emergency stop', 301: 'limit switch',
    302: 'soft limit', 303: 'process inputs lost or implausible', 304: 'not homed',
    305: 'not armed', 306: 'power-up: reset needed', 307: 'the watchdog has reset the controller',
    308: 'fault of a drive', 309: 'the controller fell 20 ms behind',
}  # fmt: skip


STANDOFF, ACCELEROMETER = 212, 213  # told beside a state, change none


class FrameError(ValueError):
    """A line that must not be acted on; the text says what is wrong with it."""


class Telemetry(NamedTuple):
    """Fields of a T line, as sent: integers, micrometres, micrometres/s, mA, mV, permille."""

    seq: int
    t_us: int
    state: int
    flags: int
    x_um: int
    y_um: int
    z_um: int
    v_um_s: int
    wire_cmd_um_s: int
    wire_um_s: int
    current_ma: int
    voltage_mv: int
    line_accepted: int
    line_executed: int
    free_blocks: int
    speed_permille: int
    wire_permille: int
    lease_left_ms: int
    underruns: int
    fault: int


class Standoff(NamedTuple):
    """Fields of a D line, as sent."""

    t_us: int  # microseconds of the controller's clock
    source: int  # 1 laser, 2 infrared, 3 arc
    known: int  # 1 = the distance is known
    alarm: int  # 0 = none
    set_um: int  # distance that is wanted, um
    measured_um: int  # distance that is measured, um
    correction_um: int  # of z, um


class PartTemperature(NamedTuple):
    """A P line: what the controller measures of the part."""

    t_us: int  # microseconds of the controller's clock
    fault: int  # 0 = known, otherwise why not (docs/link_protocol.md)
    celsius: float  # NaN = unknown


class Acceleration(NamedTuple):
    """An A line: samples of the accelerometer in counts."""

    seq: int  # of the line, from 0 when it was switched on
    t_us: int  # controller time of the first sample
    lost: int  # samples that were lost since it was switched on, at least
    counts: np.ndarray  # (n, 3) along the sensor's axes


class Ack(NamedTuple):
    """Everything up to `seq` is in the controller's queue."""

    seq: int
    blocks: int
    room: int


class Resend(NamedTuple):
    """Everything from line `expected` on is to be sent again; code: a gap or a failed check (docs/link_protocol.md)."""

    expected: int
    code: int


class LineRefused(NamedTuple):
    """The queued line `seq` is wrong; nothing more is accepted until `$L`."""

    seq: int
    code: int
    column: int
    text: str


class StateChange(NamedTuple):
    """The controller is in `state` now because of the fault `code`, 0 = none."""

    state: int
    code: int
    text: str
    t_us: int = 0  # controller time, 0 = not told


class Answer(NamedTuple):
    """Answer to the immediate line `$<letter>@<token>`; code 0 = done, otherwise the controller's refusal."""

    letter: str
    code: int
    text: str
    token: int = 0
    t_us: int = 0  # controller time, 0 = not told


class Pong(NamedTuple):
    """Answer to a heartbeat."""

    token: int
    t_us: int


class Identity(NamedTuple):
    """Answer to `$I`."""

    name: str
    firmware: str
    boot: int
    synchronised: bool
    blocks: int
    rx: int
    limits_mm: tuple[float, ...]  # x0, y0, z0, x1, y1, z1 in machine coordinates
    steps_per_mm: tuple[float, float, float]  # x, y, z
    capabilities: tuple[str, ...]
    offset_mm: tuple[float, ...] | None  # work offset G54, when the controller reports it
    accepted: int  # line number; after `$I keep` it does not change before `$L`
    executed: int  # line number, likewise
    digits: int  # of the check that the controller uses from now on


Frame = (
    Telemetry
    | Standoff
    | PartTemperature
    | Acceleration
    | Ack
    | Resend
    | LineRefused
    | StateChange
    | Answer
    | Pong
    | Identity
)


def check(data: bytes) -> int:
    """CRC-16/CCITT-FALSE (poly 0x1021, init 0xFFFF)."""
    return crc_hqx(data, 0xFFFF)


def seal(payload: bytes, digits: int = CRC16) -> bytes:
    """payload*check and newline. Raises FrameError when the line would be too long."""
    if digits == CRC32:
        line = b'%b*%010d\n' % (payload, crc32(payload))
    else:
        line = b'%b*%05d\n' % (payload, crc_hqx(payload, 0xFFFF))
    if len(line) > MAX_LINE:
        raise FrameError(f'a line of {len(line)} bytes, at most {MAX_LINE}')
    return line


def queued(seq: int, gcode: bytes, digits: int = CRC16) -> bytes:
    """A queued line `N<seq> <gcode>`."""
    return seal(b'N%d %b' % (seq, gcode), digits)


def immediate(letter: str, args: str = '', token: int = 0, digits: int = CRC16) -> bytes:
    """An immediate line `$<letter>@<token> <args>`, token 0 = none. Raises FrameError for text that cannot travel."""
    text = f'${letter}@{token}' if token else f'${letter}'
    text = f'{text} {args}' if args else text
    if not text.isascii() or not text.isprintable() or '*' in text:
        raise FrameError(f'{args!r} holds characters that cannot be sent')
    return seal(text.encode(), digits)


def heartbeat(token: int, lease_us: int, digits: int = CRC16) -> bytes:
    """`$H <token> <lease>`: renews the arc lease up to controller time `lease_us`; the answer repeats the token."""
    return seal(b'$H %d %d' % (token, lease_us), digits)


def unseal(line: bytes) -> tuple[bytes, int]:
    """Payload and digits of the check of a line (newline already removed). Raises FrameError when the check fails."""
    star = line.rfind(b'*')
    check = line[star + 1 :]
    payload, digits = line[:star], len(check)
    if star < 0 or len(line) > MAX_ANSWER:
        raise FrameError('no check' if star < 0 else f'a line of {len(line)} bytes')
    if not check.isdigit() or digits not in (CRC16, CRC32):
        raise FrameError('the check is malformed')
    if int(check) != (crc32(payload) if digits == CRC32 else crc_hqx(payload, 0xFFFF)):
        raise FrameError('the check fails')
    return payload, digits
