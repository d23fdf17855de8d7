"""Real-time priority for the processes that the arc depends on, so that nothing that watches can hold them up.

Linux runs a thread of a real-time class as soon as it is due, before all ordinary ones. It takes a right that most
systems give on request only (`rtprio` in limits.conf, CAP_SYS_NICE of a container); without it nothing changes.
"""

from __future__ import annotations

import os

VARIABLE = 'WAAM_REALTIME'
LEVEL = 10  # of 1..99; the kernel's own interrupt threads have 50


def take() -> str:
    """How this process runs from now on, in words: 'real time' when `WAAM_REALTIME` is 1 and it is allowed."""
    return request() if os.environ.get(VARIABLE, '') == '1' else 'ordinary'


def request(level: int = LEVEL) -> str:
    """Asks for it; the same words. Before any thread is started that is to have it as well: threads inherit it."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(level))
    except (OSError, AttributeError) as e:  # AttributeError: not Linux
        return f'ordinary (real time was refused: {e})'
    return 'real time'
