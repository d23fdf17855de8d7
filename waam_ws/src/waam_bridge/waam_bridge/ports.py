"""Serial ports of this computer: what they are, who holds them, and whether a controller answers there."""

from __future__ import annotations

import errno
import os
import select
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from . import frames, parsing
from .transport import RATES, reason

ANSWER_S = 0.6  # that a controller may take to say who it is; two questions, the second with the other check
BY_ID = Path('/dev/serial/by-id')
PROCESSES = Path('/proc')


@dataclass(frozen=True)
class Port:
    """names: of it that stay when it is plugged in again; vendor, product: of USB, 0 = it is none; serial: its number,
    '' = it has none; holders: `process (pid)` of those that have it open, as far as this user may see."""

    device: str
    names: tuple[str, ...] = ()
    vendor: int = 0
    product: int = 0
    serial: str = ''
    text: str = ''
    holders: tuple[str, ...] = ()


@dataclass(frozen=True)
class Answer:
    """Of a port that was asked. rate: Bd at which the controller answered, 0 = nobody did; problem: why not."""

    rate: int = 0
    name: str = ''
    firmware: str = ''
    problem: str = ''


def ports(by_id: Path = BY_ID, processes: Path = PROCESSES) -> list[Port]:
    """Every serial port that is plugged in; those without hardware behind them are left out."""
    found = [p for p in list_ports.comports() if p.vid or p.hwid != 'n/a']
    names = _names(by_id)
    return [
        Port(
            p.device, names.get(p.device, ()), p.vid or 0, p.pid or 0, p.serial_number or '',
            ' '.join(filter(None, (p.manufacturer, p.product))) or p.description, holders(p.device, processes),
        )
        for p in sorted(found, key=lambda p: p.device)
    ]  # fmt: skip


def _names(by_id: Path) -> dict[str, tuple[str, ...]]:
    """device -> its links."""
    found: dict[str, tuple[str, ...]] = {}
    try:
        links = sorted(by_id.iterdir())
    except OSError:
        return found
    for link in links:
        device = os.path.realpath(link)
        found[device] = (*found.get(device, ()), str(link))
    return found


def holders(device: str, processes: Path = PROCESSES) -> tuple[str, ...]:
    """Processes that have the device open; those of other users only as root."""
    real = os.path.realpath(device)
    found = []
    for folder in processes.glob('[0-9]*'):
        if int(folder.name) == os.getpid():
            continue
        try:
            if any(os.readlink(fd) == real for fd in (folder / 'fd').iterdir()):
                found.append(f'{(folder / "comm").read_text().strip()} ({folder.name})')
        except OSError:  # it has ended, or is somebody else's
            continue
    return tuple(found)


def ask(device: str, rates: Iterable[int] = RATES) -> Answer:
    """Asks `$I keep` at each rate: the queue of a controller stays. A port that somebody holds is not asked."""
    if held := holders(device):
        return Answer(problem=f'held by {", ".join(held)}')
    for rate in rates:
        try:
            who = _ask(device, rate)
        except (OSError, ValueError) as e:
            return Answer(problem=reason(e))
        if who is not None:
            return Answer(rate, who.name, who.firmware)
    return Answer(problem='no controller answers')


def _ask(device: str, rate: int) -> frames.Identity | None:
    """None: nobody understood. OSError when the port cannot be opened alone."""
    with serial.Serial(device, rate, timeout=0, write_timeout=0.5, exclusive=True) as port:
        port.reset_input_buffer()
        for digits in (frames.CRC32, frames.CRC16):
            port.write(b'\n' + frames.immediate('I', 'keep', 0, digits))
            if who := _identity(port.fileno()):
                return who
    return None


def _identity(fd: int) -> frames.Identity | None:
    rest, end = b'', time.monotonic() + ANSWER_S / 2
    while (left := end - time.monotonic()) > 0:
        if not select.select([fd], [], [], left)[0]:
            break
        data = os.read(fd, 4096)
        if not data:
            raise OSError(errno.EIO, 'the other end hung up')
        *lines, rest = (rest + data).split(b'\n')
        for line in lines:
            try:
                frame = parsing.parse(line)
            except frames.FrameError:
                continue
            if isinstance(frame, frames.Identity):
                return frame
        rest = rest[-frames.MAX_ANSWER :]
    return None
