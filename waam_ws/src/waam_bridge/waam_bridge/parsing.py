"""The lines of the controller: bytes in, tuples of `frames` out."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np

from .frames import (
    STATES,
    Acceleration,
    Ack,
    Answer,
    Frame,
    FrameError,
    Identity,
    LineRefused,
    PartTemperature,
    Pong,
    Resend,
    Standoff,
    StateChange,
    Telemetry,
    unseal,
)

_U32 = 2**32
_I31 = 2**31


def _telemetry(payload: bytes) -> Telemetry:
    f = Telemetry._make(map(int, payload[2:].split(b',')))
    unsigned = f[0] | f[1] | f[2] | f[3] | f[12] | f[13] | f[14] | f[15] | f[16] | f[18] | f[19]
    if unsigned < 0 or f[2] > 3 or f[14] > 65535 or f[1] >> 63:
        raise FrameError('telemetry out of range')
    if max(f[3:]) >= _U32 or f[0] >= _U32 or min(f) < -_I31:
        raise FrameError('telemetry out of range')
    return f


def _standoff(payload: bytes) -> Standoff:
    f = Standoff._make(map(int, payload[2:].split(b',')))
    if (
        f.t_us < 0
        or f.t_us >> 63
        or not (0 <= f.source < 16 and 0 <= f.known <= 1 and f.alarm >= 0)
    ):
        raise FrameError('standoff out of range')
    if max(f[3:]) >= _I31 or min(f[3:]) < -_I31:
        raise FrameError('standoff out of range')
    return f


_PART = re.compile(rb'P (\d{1,18}),([0-3]),(-?\d{1,7})?')


def _part(payload: bytes) -> PartTemperature:
    """The number is there when the temperature is known, and only then."""
    t_us, fault, milli = _match(_PART, payload)
    if (fault == b'0') != (milli is not None):
        raise FrameError('a temperature that is known without a number, or the other way round')
    return PartTemperature(int(t_us), int(fault), int(milli) / 1e3 if milli else math.nan)


_SAMPLES = re.compile(rb'A (\d{1,10}),(\d{1,18}),(\d{1,10}),((?:[0-o]{7})+)')


def _acceleration(payload: bytes) -> Acceleration:
    """Seven characters of six bits, '0' to 'o', are three times 14 bits, x first; each is a count plus 8192."""
    seq, t_us, lost, packed = _match(_SAMPLES, payload)
    six = np.frombuffer(packed, np.uint8).reshape(-1, 7).astype(np.int64) - ord('0')
    bits = six @ (1 << np.arange(36, -1, -6))
    counts = (bits[:, None] >> np.array([28, 14, 0]) & 0x3FFF) - 8192
    if abs(counts).max() > 4096 or int(seq) >= _U32 or int(lost) >= _U32:
        raise FrameError('acceleration out of range')
    return Acceleration(int(seq), int(t_us), int(lost), counts)


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


def _three(text: str) -> tuple[float, float, float]:
    """Of x, y, z; one number is that of all (older firmware)."""
    values = [float(v) for v in text.split(',')]
    x, y, z = values * 3 if len(values) == 1 else values
    return x, y, z


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
            steps_per_mm=_three(fields['spmm']),
            capabilities=tuple(c for c in fields.get('cap', '').split(',') if c),
            offset_mm=offset,
            accepted=int(fields['acc']),
            executed=int(fields['exe']),
            digits=digits,
        )
    except KeyError as e:
        raise FrameError(f'identification without {e.args[0]}=') from None
    numbers = (*who.limits_mm, *(who.offset_mm or ()), *who.steps_per_mm)
    if len(who.limits_mm) != 6 or len(who.offset_mm or (0, 0, 0)) != 3:
        raise FrameError('identification with the wrong count of limits')
    in_range = all(abs(v) < 1e6 for v in numbers) and min(who.steps_per_mm) > 0
    if not in_range or not 0 <= who.boot < _U32:
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


_KINDS: dict[bytes, Callable[[bytes], Frame]] = {
    b'T ': _telemetry,
    b'D ': _standoff,
    b'P ': _part,
    b'A ': _acceleration,
    b'ok': _ack,
    b'rs': _resend,
    b'er': _refused,
    b'! ': _state,
}


def parse(line: bytes) -> Frame:
    """One line of the controller (without newline; a carriage return is allowed).

    Raises FrameError when the check fails or the line is not of the protocol; never anything else.
    """
    payload, digits = unseal(line[:-1] if line.endswith(b'\r') else line)
    kind = _KINDS.get(payload[:2])
    if kind is None and payload[:1] != b'$':
        raise FrameError(f'not understood: {_text(payload)}')
    try:
        return kind(payload) if kind else _dollar(payload, digits)
    except FrameError:
        raise
    except (ValueError, TypeError) as e:
        raise FrameError(f'{_text(payload[:40])}: {e}') from None
