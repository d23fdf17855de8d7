"""For tests: ROS domains that no other test uses at the same time, in this process or in any other on the machine."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from pathlib import Path

DOMAINS = 99  # domains above 101 would use ports that the system hands out to any program
PER_WORKER = DOMAINS // 3
_count = itertools.count()
_held: dict[int, int] = {}  # domain -> descriptor of its lock, held until this process ends


def fresh_domain() -> int:
    """A ROS_DOMAIN_ID of 1..99.

    Each worker of pytest-xdist begins in its own third and goes round; a domain that another process holds is left
    out, unless all are held.
    """
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:]) % 3
    for _ in range(DOMAINS):
        domain = 1 + (worker * PER_WORKER + next(_count)) % DOMAINS
        if domain in _held or _hold(domain):
            return domain
    return 1 + next(_count) % DOMAINS


def _hold(domain: int) -> bool:
    path = Path(tempfile.gettempdir()) / f'waam_ros_domain_{domain}_{os.getuid()}.lock'
    descriptor = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return False
    _held[domain] = descriptor
    return True
