"""Time of `scripts/setup.sh` for a newcomer: a clean clone of what is committed, and no wheel in any cache.

setup.seconds: the first call; setup.second_call_seconds: the next one, when nothing has changed."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from pathlib import Path

from lib.emit import emit

PROJECT = Path(__file__).resolve().parents[1]
VERSION_0_1 = 420.0  # s, on two idle cores


def call(clone: Path, environment: dict[str, str]) -> float:
    """Seconds that one call of scripts/setup.sh takes."""
    start = time.monotonic()
    subprocess.run(
        ['bash', 'scripts/setup.sh'], cwd=clone, env=environment, check=True, capture_output=True
    )
    return time.monotonic() - start


def newcomer(caches: Path) -> dict[str, str]:
    """The environment without what `. ./env.sh` has put there, and with empty caches of wheels."""
    ours = (
        'AMENT_',
        'CMAKE_',
        'COLCON_',
        'PYTHON',
        'LD_LIBRARY_PATH',
        'VIRTUAL_ENV',
        'WAAM_',
        'UV_',
    )
    kept = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    path = [p for p in kept['PATH'].split(':') if not Path(p).is_relative_to(PROJECT)]
    return kept | {
        'PATH': ':'.join(path),
        'PIP_CACHE_DIR': str(caches),
        'UV_CACHE_DIR': str(caches / 'uv'),
    }


def setup() -> None:
    """Emits both figures; takes minutes, a network and 6 GB of disk."""
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder, 'clone')
        subprocess.run(['git', 'clone', '-q', PROJECT, clone], check=True)
        environment = newcomer(Path(folder, 'caches'))
        first, second = call(clone, environment), call(clone, environment)
    emit('setup.seconds', first, 's', 'version 0.1', VERSION_0_1)
    emit('setup.second_call_seconds', second, 's', 'none', None)


FIGURES = {'setup.seconds': setup, 'setup.second_call_seconds': setup}
