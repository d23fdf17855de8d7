"""A cable between bridge and controller that notes when STOP went through: python stop_tap.py REAL LINK STAMPS.

It stands for the last centimetre before the controller: what it stamps (CLOCK_MONOTONIC, ns, one line each) is what the
controller's port has received. It runs with real-time priority where that is allowed, to measure and not be measured.
"""

from __future__ import annotations

import os
import select
import sys
import time
import tty
from contextlib import suppress

BURST = b'\x82\x82'  # acts when it comes twice


def open_when_there(path: str) -> int:
    while True:
        with suppress(OSError):
            return os.open(path, os.O_RDWR | os.O_NOCTTY)
        time.sleep(0.02)


def main(real: str, link: str, stamps: str) -> None:
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(50))
    notes = os.open(stamps, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    controller = open_when_there(real)
    tty.setraw(controller)
    master, slave = os.openpty()
    tty.setraw(slave)
    os.symlink(os.ttyname(slave), link)
    tail = b''
    while True:
        for fd in select.select([master, controller], [], [])[0]:
            data = os.read(fd, 65536)
            if not data:
                return
            if fd == master:
                if BURST in tail + data:
                    os.write(notes, b'%d\n' % time.monotonic_ns())
                tail = data[-1:] if BURST not in data[-2:] else b''
            target = controller if fd == master else master
            while data:
                data = data[os.write(target, data) :]


if __name__ == '__main__':
    main(*sys.argv[1:])
