"""What a recording says of the software that made it."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

_LIBRARIES = ('waam_record', 'mcap', 'zstandard', 'numpy', 'rclpy')


def versions() -> dict[str, str]:
    """`version.<name>` of Python and of the libraries that matter, as custom data of the recording."""
    found = {'version.python': platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[f'version.{name}'] = version(name)
        except PackageNotFoundError:
            continue
    return found
