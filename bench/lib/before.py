"""The commit that figures are compared with, from the history of git, and its laboratory beside today's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from .paths import ROOT

BEFORE = '986bae11'
# the first job compiles; argument: options of waam_lab.restore
JOB = """
import json, sys
from waam_bringup.paths import share
from waam_lab import restore, run
files = [share('waam_bringup') / 'parts' / f'jaw_{n}.stl' for n in ('nominal', 'worn')]
run(restore(*files, layers=1, **json.loads(sys.argv[1])))
found = run(restore(*files, **json.loads(sys.argv[1])))
print(found.time / found.cpu)
"""


def git(*words: str) -> str:
    """What git says in this repository."""
    done = subprocess.run(('git', *words), cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        asked = 'rev-parse', '--is-shallow-repository'
        shallow = words != asked and git(*asked) == 'true'
        hint = '; this clone is shallow: git fetch --unshallow' if shallow else ''
        raise RuntimeError(f'git {" ".join(words)}: {done.stderr.strip()}{hint}')
    return done.stdout.strip()


@contextmanager
def tree() -> Iterator[dict[str, str]]:
    """Environment with the packages as they were, not built, before those of today, whose messages and controller they
    use. RuntimeError where git does not have the commit."""
    with tempfile.TemporaryDirectory(prefix='waam_before_') as scratch:
        here, found = Path(scratch) / 'tree', {'NUMBA_CACHE_DIR': f'{scratch}/numba'}
        git('worktree', 'add', '--detach', str(here), BEFORE)
        try:
            packages = [p.parent for p in here.glob('waam_ws/src/*/setup.py')]
            index = Path(scratch) / 'share/ament_index/resource_index/packages'
            index.mkdir(parents=True)
            for package in packages:
                (index / package.name).touch()
                (Path(scratch) / 'share' / package.name).symlink_to(package)
            for name, first in (('PYTHONPATH', packages), ('AMENT_PREFIX_PATH', [scratch])):
                found[name] = os.pathsep.join([*map(str, first), os.environ.get(name, '')])
            yield found
        finally:
            git('worktree', 'remove', '--force', str(here))


def speed(environment: Mapping[str, str], **options: str) -> float:
    """Simulated seconds per second of processor time of the demo's job. options: of waam_lab.restore."""
    env = {**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1', **environment}
    command = [sys.executable, '-c', JOB, json.dumps(options)]
    done = subprocess.run(command, env=env, check=True, stdout=subprocess.PIPE, text=True)
    return float(done.stdout.splitlines()[-1])
