"""Real-time priority for the processes that the arc depends on, so that viewers and recorders cannot delay them.

Linux runs a thread of a real-time class as soon as it is due, before all ordinary ones. It needs a right that most
systems grant only on request (`rtprio` in limits.conf, CAP_SYS_NICE of a container); without it nothing changes.
"""

from __future__ import annotations

import os

VARIABLE = 'WAAM_REALTIME'
LEVEL = 10  # of 1..99; the kernel's own interrupt threads have 50


def take() -> str:
    """Sets the priority and returns it as text: 'real time' when `WAAM_REALTIME` is 1 and it is allowed."""
    return request() if os.environ.get(VARIABLE, '') == '1' else 'ordinary'


def give(pid: int, real_time: bool) -> str:
    """Sets or takes back the priority of all threads of a process of this account; '' or why it was refused."""
    policy, level = (os.SCHED_RR, LEVEL) if real_time else (os.SCHED_OTHER, 0)
    try:
        threads = [int(name) for name in os.listdir(f'/proc/{pid}/task')]
    except OSError:
        return ''  # it has ended, or this is not Linux
    for thread in threads:
        try:
            if os.sched_getscheduler(thread) != policy:
                os.sched_setscheduler(thread, policy, os.sched_param(level))
        except ProcessLookupError:
            continue  # it has just ended
        except OSError as e:
            return str(e)
    return ''


def request(level: int = LEVEL) -> str:
    """Requests it; same result. Call it before starting threads that need it too: threads inherit it."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(level))
    except (OSError, AttributeError) as e:  # AttributeError: not Linux
        return f'ordinary (real time was refused: {e})'
    return 'real time'
