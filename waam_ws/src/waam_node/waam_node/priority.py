"""Who waits when the processor is short: those that watch the loop give way to those that close it."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys

CALL = {'x86_64': 314, 'aarch64': 274}  # number of sched_setattr
SLICE_MS = 0.1


def answer_soon(slice_ms: float = SLICE_MS) -> bool:
    """Asks the scheduler for short turns, which come the sooner; needs no privilege. False where it is not offered.

    Linux from 6.12 on lets a task with a shorter slice interrupt one with a longer (EEVDF, sched_setattr); between
    nodes that are sessions of their own `nice` does nothing. Threads and processes that are started later inherit it.
    """
    number = CALL.get(platform.machine())
    if number is None or not sys.platform.startswith('linux'):
        return False
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    # size, policy, flags, nice, priority, runtime, deadline, period, util_min, util_max
    attributes = struct.pack('IIQiIQQQII', 56, 0, 0, nice, 0, int(slice_ms * 1e6), 0, 0, 0, 0)
    return ctypes.CDLL(None).syscall(number, 0, attributes, 0) == 0
