"""The lines of the link (docs/link_protocol.md): built and parsed here and nowhere else. Bytes in, tuples out."""

from __future__ import annotations

import re
from binascii import crc_hqx
from typing import NamedTuple
from zlib import crc32

MAX_LINE = 160  # bytes of a line to the controller, newline included
MAX_ANSWER = 400  # bytes of a line from the controller; identifications grow with the firmware
# real-time bytes act when two come in a row; four survive the loss of any two
STOP_NOW, HOLD_NOW = b'\x82' * 4, b'\x80' * 4
CRC16, CRC32 = 5, 10  # digits of a check

IDLE, RUN, HOLD, ALARM = range(4)
STATES = {b'IDLE': IDLE, b'RUN': RUN, b'HOLD': HOLD, b'ALARM': ALARM}
STATE_NAMES = ('IDLE', 'RUN', 'HOLD', 'ALARM')

# flags of telemetry
ARC_ENABLED, ARC_ESTABLISHED, GAS, HOMED, ARMED, QUEUE_EMPTY, ESTOP, WIRE_JOG = (
    1, 2, 4, 8, 16, 32, 64, 128,
)  # fmt: skip

CODES = {
    100: 'check failed', 101: 'gap in line numbers', 102: 'syntax', 103: 'unknown word',
    104: 'bad number', 105: 'contradiction', 106: 'line too long', 107: 'missing word',
    108: 'not now', 200: 'hold by host', 201: 'link watchdog', 202: 'arc lease expired',
    203: 'planner ran dry with the arc on', 204: 'arc lost', 205: 'no arc at start',
    206: 'wire fault', 207: 'gas', 208: 'stubbing', 209: 'burn-back', 210: 'over-temperature',
    211: 'wire frozen in the bead', 300: 'emergency stop', 301: 'limit switch',
    302: 'soft limit', 303: 'process inputs lost or implausible', 304: 'not homed',
    305: 'not armed', 306: 'power-up: reset needed', 307: 'the watchdog has reset the controller',
}  # fmt: skip


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


class Ack(NamedTuple):
    """Everything up to `seq` is in the controller's queue."""

    seq: int
    blocks: int
    room: int


class Resend(NamedTuple):
    expected: int
    code: int


class LineRefused(NamedTuple):
    """The queued line `seq` is wrong; nothing more is accepted until `$L`."""

    seq: int
    code: int
    column: int
    text: str


class StateChange(NamedTuple):
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
    """Answer to `$I`. Limits in mm, machine coordinates: x0, y0, z0, x1, y1, z1.

    accepted, executed: line numbers; after `$I keep` they do not change before `$L`.
    digits: of the check that the controller uses from now on.
    """

    name: str
    firmware: str
    boot: int
    synchronised: bool
    blocks: int
    rx: int
    limits_mm: tuple[float, ...]
    steps_per_mm: float
    capabilities: tuple[str, ...]
    offset_mm: tuple[float, ...] | None  # work offset G54, when the controller reports it
    accepted: int
    executed: int
    digits: int


Frame = Telemetry | Ack | Resend | LineRefused | StateChange | Answer | Pong | Identity


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


_U32 = 2**32
_I31 = 2**31


def _telemetry(payload: bytes) -> Telemetry:
    f = Telemetry._make(map(int, payload[2:].split(b',')))
    unsigned = f[0] | f[1] | f[2] | f[3] | f[12] | f[13] | f[14] | f[15] | f[16] | f[18] | f[19]
    if unsigned < 0 or f[2] > 3 or f[14] > 65535 or f[1] >> 63:
        raise FrameError('telemetry out of range')
    if max(f[0], *f[3:]) >= _U32 or min(f) < -_I31:
        raise FrameError('telemetry out of range')
    return f


_AT = rb'(?: @(\d{1,20}))?'  # controller time, us
_ACK = re.compile(rb'ok N(\d{1,10}) P(\d{1,5}) B(\d{1,5})(?: @\d{1,20})?')
_RESEND = re.compile(rb'rs N(\d{1,10}) E(\d{1,4})(?: @\d{1,20})?')
_REFUSED = re.compile(rb'er N(\d{1,10}) E(\d{1,4}) C(\d{1,4})(?: (.*?))??' + _AT)
_STATE = re.compile(rb'! (IDLE|RUN|HOLD|ALARM) E(\d{1,4})(?: (.*?))??' + _AT)
_PONG = re.compile(rb'\$H (\d{1,10}) (\d{1,18})')
_ERROR = re.compile(rb'\$([A-Z?])(?:@(\d{1,10}))? error E(\d{1,4})(?: (.*?))??' + _AT)
_ANSWER = re.compile(rb'\$([A-Z?])(?:@(\d{1,10}))?(?: (.*?))??' + _AT)


def _text(raw: bytes | None) -> str:
    return (raw or b'').decode('ascii', 'replace')


def _match(pattern: re.Pattern, payload: bytes) -> tuple:
    found = pattern.fullmatch(payload)
    if not found:
        raise FrameError(f'not understood: {_text(payload)}')
    return found.groups()


def _identity(payload: bytes, digits: int) -> Identity:
    words = _text(payload).split()
    if len(words) < 2:
        raise FrameError('an identification without a name')
    fields = dict(w.split('=', 1) for w in words[2:] if '=' in w)
    try:
        limits = tuple(float(v) for v in fields['lim'].split(','))
        offset = tuple(float(v) for v in fields['off'].split(',')) if 'off' in fields else None
        who = Identity(
            name=words[1],
            firmware=fields['fw'],
            boot=int(fields['boot']),
            synchronised=fields['clk'] == 'sync',
            blocks=int(fields['blocks']),
            rx=int(fields['rx']),
            limits_mm=limits,
            steps_per_mm=float(fields['spmm']),
            capabilities=tuple(c for c in fields.get('cap', '').split(',') if c),
            offset_mm=offset,
            accepted=int(fields['acc']),
            executed=int(fields['exe']),
            digits=digits,
        )
    except KeyError as e:
        raise FrameError(f'identification without {e.args[0]}=') from None
    numbers = (*who.limits_mm, *(who.offset_mm or ()), who.steps_per_mm)
    if len(who.limits_mm) != 6 or len(who.offset_mm or (0, 0, 0)) != 3:
        raise FrameError('identification with the wrong count of limits')
    if not all(abs(v) < 1e6 for v in numbers) or not 0 <= who.boot < _U32:
        raise FrameError('identification out of range')
    if not (0 < who.blocks < 65536 and 0 < who.rx < 2**24):
        raise FrameError('identification out of range')
    if not 0 <= who.executed <= who.accepted < _U32:
        raise FrameError('identification with impossible line numbers')
    return who


def _dollar(payload: bytes, digits: int) -> Frame:
    kind = payload[1:2]
    error = _ERROR.fullmatch(payload)
    if error:
        letter, token, code, text, t_us = error.groups(b'')
        return Answer(
            letter.decode(), int(code) or 108, _text(text), int(token or 0), int(t_us or 0)
        )
    if kind == b'H':
        token, t_us = _match(_PONG, payload)
        return Pong(int(token), int(t_us))
    if kind == b'I':
        return _identity(payload, digits)
    letter, token, text, t_us = _match(_ANSWER, payload)
    return Answer(letter.decode(), 0, _text(text), int(token or 0), int(t_us or 0))


def _ack(payload: bytes) -> Ack:
    return Ack._make(map(int, _match(_ACK, payload)))


def _resend(payload: bytes) -> Resend:
    return Resend._make(map(int, _match(_RESEND, payload)))


def _refused(payload: bytes) -> LineRefused:
    seq, code, column, text, _ = _match(_REFUSED, payload)
    return LineRefused(int(seq), int(code), int(column), _text(text))


def _state(payload: bytes) -> StateChange:
    state, code, text, t_us = _match(_STATE, payload)
    return StateChange(STATES[state], int(code), _text(text), int(t_us or 0))


_KINDS = {b'T ': _telemetry, b'ok': _ack, b'rs': _resend, b'er': _refused, b'! ': _state}


def parse(line: bytes) -> Frame:
    """One line of the controller (without newline; a carriage return is allowed).

    Raises FrameError when the check fails or the line is not of the protocol; never anything else.
    """
    payload, digits = unseal(line[:-1] if line[-1:] == b'\r' else line)
    kind = None if payload[:1] == b'$' else _KINDS.get(payload[:2])
    if kind is None and payload[:1] != b'$':
        raise FrameError(f'not understood: {_text(payload)}')
    try:
        return kind(payload) if kind else _dollar(payload, digits)
    except FrameError:
        raise
    except (ValueError, TypeError) as e:
        raise FrameError(f'{_text(payload[:40])}: {e}') from None
