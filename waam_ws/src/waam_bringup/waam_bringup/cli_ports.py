"""`waam ports`: which serial port is the controller's; the rules of udev for it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from waam_process.cli_options import Verbs, add_verb

if TYPE_CHECKING:
    from waam_bridge.ports import Port

TEXT = """\
Lists serial ports, who holds them, and asks those that nobody holds for a controller: name, firmware, rate. Only the
question of who is there is sent ($I keep); with --list nothing is. Exit status: 0; 1 when no controller answers."""
EXAMPLES = """\
examples:
  waam ports
  waam ports /dev/ttyUSB0                     only this one
  waam ports --udev | sudo tee /etc/udev/rules.d/70-waam.rules
  waam ports --udev /dev/ttyUSB0              and /dev/serial/by-id/waam for the controller that is there"""


def register(commands: Verbs) -> None:
    """Adds the verb."""
    p = add_verb(
        commands, 'ports', 'serial ports: which one is the controller, rules of udev',
        ('port', str, 'only these', 'PORT', {'nargs': '*'}),
        ('--list', False, 'only list: send nothing'),
        ('--udev', False, 'print rules for udev: names that stay, rights, no ModemManager, low latency'),
        description=TEXT, epilog=EXAMPLES,
    )  # fmt: skip
    p.set_defaults(run_command=_run)


def _run(args: argparse.Namespace) -> int:
    from waam_bridge.ports import ports

    return _udev(args.port, ports()) if args.udev else _list(args, ports())


def _list(args: argparse.Namespace, plugged: Iterable[Port]) -> int:
    from waam_bridge.ports import Answer, ask

    found = [_known(name, plugged) for name in args.port] if args.port else list(plugged)
    if not found:
        print('no serial port: is the controller plugged in and switched on?')
    there = False
    for port in found:
        answer = Answer(problem='not asked') if args.list or port.holders else ask(port.device)
        there = there or bool(answer.rate)
        for line in _lines(port, answer.rate, answer.name, answer.firmware, answer.problem):
            print(line)
    return 0 if there or args.list else 1


def _known(name: str, plugged: Iterable[Port]) -> Port:
    """By its device or one of its names; a port that is not USB's is taken as it is."""
    from waam_bridge.ports import Port, holders

    port = next((p for p in plugged if name == p.device or name in p.names), None)
    if port is None and not Path(name).is_char_device():
        raise ValueError(f'{name} is no serial port')
    return port or Port(name, holders=holders(name))


def _lines(port: Port, rate: int, name: str, firmware: str, problem: str) -> list[str]:
    usb = 'no USB'
    if port.vendor:
        usb = f'USB {port.vendor:04x}:{port.product:04x}, serial {port.serial or "none"}'
    held = f'held by {", ".join(port.holders)}; ' if port.holders else ''
    told = f'{name}, firmware {firmware}, {rate} Bd' if rate else problem
    return [
        f'{port.device}: {held}{told}',
        f'  {usb}{": " if port.text else ""}{port.text}',
        *(f'  {link}' for link in port.names),
    ]


def _udev(names: list[str], plugged: Iterable[Port]) -> int:
    from waam_bridge.udev import INSTALL, rules

    if len(names) > 1:
        raise ValueError('--udev takes one port: that of the controller')
    print(rules(_known(names[0], plugged) if names else None), end='')
    if sys.stdout.isatty():
        print(f'\ninstall: {INSTALL}', file=sys.stderr)
    return 0
