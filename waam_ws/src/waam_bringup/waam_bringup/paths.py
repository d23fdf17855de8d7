"""Where things are: shares of packages, the folder of the running graph, the folder of the jobs."""

from __future__ import annotations

import os
from pathlib import Path


def share(package: str) -> Path:
    """<prefix>/share/<package> from AMENT_PREFIX_PATH."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':'):
        candidate = Path(prefix) / 'share' / package
        if prefix and candidate.is_dir():
            return candidate
    raise FileNotFoundError(f'package {package} is not in AMENT_PREFIX_PATH (source the workspace)')


def root() -> Path:
    """The working tree (WAAM_ROOT from env.sh), or the current folder on a full ROS installation."""
    return Path(os.environ.get('WAAM_ROOT', '.')).resolve()


def jobs_dir() -> Path:
    """Folder of the jobs: WAAM_JOBS, or `jobs` in the working tree."""
    return Path(os.environ.get('WAAM_JOBS', root() / 'jobs')).resolve()


def calibrations_dir() -> Path:
    """Folder of calibration results: WAAM_CALIBRATIONS, or `calibrations` in the working tree."""
    return Path(os.environ.get('WAAM_CALIBRATIONS', root() / 'calibrations')).resolve()


def run_dir() -> Path:
    """Folder of the running graph: sockets, logs, state. One graph per folder."""
    default = jobs_dir() / '.run'
    return Path(os.environ.get('WAAM_RUN', default)).resolve()
