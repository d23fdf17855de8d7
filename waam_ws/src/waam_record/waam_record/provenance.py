"""What a recording states about its job and the software that made it."""

from __future__ import annotations

import platform
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from waam_node import job_folder

_LIBRARIES = ('waam_record', 'mcap', 'zstandard', 'numpy', 'rclpy')
_JOB, _PROGRAM = job_folder.JOB, job_folder.program()


def versions() -> dict[str, str]:
    """`version.<name>` of Python and of the libraries that matter, as custom data of the recording."""
    found = {'version.python': platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[f'version.{name}'] = version(name)
        except PackageNotFoundError:
            continue
    return found


def job_files(directory: Path) -> dict[str, str]:
    """Custom data of a recording in the folder of a job: the text of its job.yaml (what was asked, hash of the part,
    material, versions), and `sha256.<file>` of that and of the program. Empty elsewhere."""
    folder = Path(directory).parent
    found: dict[str, str] = {}
    for name in (_JOB, _PROGRAM):
        try:
            data = (folder / name).read_bytes()
        except OSError:
            continue
        found[f'sha256.{name}'] = sha256(data).hexdigest()
        if name == _JOB:
            found[name] = data.decode('utf-8', 'replace')
    return found
