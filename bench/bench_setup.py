"""What a newcomer waits for, today and at commit 986bae11 in turn on this machine: clean clones of what is committed,
and no wheel in any cache.

setup.seconds: the first call of `scripts/setup.sh` (baseline: that of the commit); setup.ratio: one over the other;
setup.second_call_seconds: the next call, when nothing has changed;
loop.speed_ratio: simulated seconds per second of wall time of `make demo`, start-up and reports included, on `gentle`,
which the commit has as its only cell, over that of the commit (baseline: 1);
house.test_ratio: `make test`, set-up included, over that of the commit. It takes an hour.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from lib.before import BEFORE, git
from lib.emit import emit
from lib.paths import ROOT

OURS = (
    'AMENT_', 'CMAKE_', 'COLCON_', 'PYTHON', 'LD_LIBRARY_PATH', 'VIRTUAL_ENV', 'WAAM_', 'UV_', 'ROS_', 'FASTDDS_',
    'FASTRTPS_',
)  # fmt: skip


class Newcomer:
    """A clone of a commit, in an environment without what `. ./env.sh` has put there and with empty caches."""

    def __init__(self, folder: Path, commit: str) -> None:
        self.clone = folder / 'clone'
        git('clone', '-q', str(ROOT), str(self.clone))
        git('-C', str(self.clone), 'checkout', '-q', git('rev-parse', commit))
        kept = {k: v for k, v in os.environ.items() if not k.startswith(OURS)}
        path = [p for p in kept['PATH'].split(':') if not Path(p).is_relative_to(ROOT)]
        caches = {'PIP_CACHE_DIR': str(folder / 'pip'), 'UV_CACHE_DIR': str(folder / 'uv')}
        self._environment = kept | {'PATH': ':'.join(path)} | caches

    def seconds(self, command: str) -> float:
        """That a command takes in the clone."""
        began = time.monotonic()
        words = ['bash', '-c', command]
        subprocess.run(
            words, cwd=self.clone, env=self._environment, check=True, capture_output=True
        )
        return time.monotonic() - began

    def demo_speed(self, options: str) -> float:
        """Simulated seconds per second of both jobs of the demo."""
        took = self.seconds(f'. ./env.sh && waam demo --seed 7 --fresh --jobs demo_jobs {options}')
        report = json.loads((self.clone / 'demo_jobs' / 'latest' / 'report.json').read_text())
        return (report['open_loop']['duration_s'] + report['closed_loop']['duration_s']) / took


def newcomer() -> None:
    """Takes half an hour, a network and 12 GB of disk."""
    setups, speeds = {}, {}
    for commit, options in (('HEAD', '--preset gentle'), (BEFORE, '')):
        with tempfile.TemporaryDirectory() as folder:
            one = Newcomer(Path(folder), commit)
            setups[commit] = [one.seconds('bash scripts/setup.sh') for _ in range(2)]
            speeds[commit] = one.demo_speed(options)
    (first, second), (former, _) = setups['HEAD'], setups[BEFORE]
    said = f'commit {BEFORE}, same run'
    emit('setup.seconds', first, 's', said, former)
    emit('setup.ratio', first / former, '', said, 1.0)
    emit('setup.second_call_seconds', second, 's', 'none', None)
    emit('loop.speed_ratio', speeds['HEAD'] / speeds[BEFORE], '', said, 1.0)


def tests() -> None:
    """A test that fails ends the measurement."""
    took = []
    for commit in ('HEAD', BEFORE):
        with tempfile.TemporaryDirectory() as folder:
            took.append(Newcomer(Path(folder), commit).seconds('make test'))
            print(f'make test of {commit}: {took[-1]:.0f} s', file=sys.stderr)
    emit('house.test_ratio', took[0] / took[1], '', f'commit {BEFORE}, same run', 1.0)


FIGURES = {
    **dict.fromkeys(('setup.seconds', 'setup.ratio', 'setup.second_call_seconds', 'loop.speed_ratio'), newcomer),
    'house.test_ratio': tests,
}  # fmt: skip
