"""For tests: ROS domains that no other test of the same run uses at the same time."""

from __future__ import annotations

import itertools
import os

_PER_WORKER = 33  # domains above 101 would use ports that the system hands out to anybody
_count = itertools.count()


def fresh_domain() -> int:
    """A ROS_DOMAIN_ID of 1..99; each worker of pytest-xdist has a third of them and goes round in it."""
    worker = os.environ.get('PYTEST_XDIST_WORKER', 'gw0')
    return 1 + _PER_WORKER * (int(worker[2:]) % 3) + next(_count) % _PER_WORKER
