"""Which version of this software runs. No ROS."""

from __future__ import annotations

import subprocess
from pathlib import Path


def software_revision() -> str:
    """git revision of the working tree with '+' when it is changed, or 'unknown' outside one."""
    here = Path(__file__).resolve().parent
    try:
        command = ['git', '-C', str(here), 'describe', '--always', '--dirty=+', '--abbrev=12']
        return subprocess.run(
            command, capture_output=True, text=True, timeout=5, check=True
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return 'unknown'
