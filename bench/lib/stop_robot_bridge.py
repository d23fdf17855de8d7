"""The bridge of a robot, whose controller is in its own process: notes when STOP has reached it (environment
STOP_STAMPS: file; CLOCK_MONOTONIC, ns, one line each). Started in place of the executable."""

from __future__ import annotations

import os
import time

from waam_bridge.embedded import Controller
from waam_bridge.frames import STOP_NOW
from waam_robot_bridge.robot_bridge_node import main

NOTES = os.open(os.environ['STOP_STAMPS'], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
feed = Controller.feed


def stamped(self: Controller, data: bytes) -> None:
    feed(self, data)
    if STOP_NOW in data:
        os.write(NOTES, b'%d\n' % time.monotonic_ns())


Controller.feed = stamped  # type: ignore[method-assign]

if __name__ == '__main__':
    main()
