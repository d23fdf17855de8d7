"""Two test processes never get the same ROS domain at the same time."""

from __future__ import annotations

import subprocess
import sys

from waam_node.testing import DOMAINS, fresh_domain

ASK = 'from waam_node.testing import fresh_domain; print(*(fresh_domain() for _ in range(5)), flush=True); input()'


def test_processes_get_domains_of_their_own():
    others = [
        subprocess.Popen([sys.executable, '-c', ASK], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for _ in range(2)
    ]
    try:
        theirs = [int(d) for p in others for d in p.stdout.readline().split()]
        mine = [fresh_domain() for _ in range(5)]
    finally:
        for p in others:
            p.communicate(b'\n', timeout=30)
    assert len({*theirs, *mine}) == 15
    assert all(1 <= d <= DOMAINS for d in (*theirs, *mine))
