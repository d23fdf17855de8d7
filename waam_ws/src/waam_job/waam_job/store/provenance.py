"""Versions and hashes that a job keeps: what ran, on what."""

from __future__ import annotations

import platform
from importlib import metadata

from waam_node.revision import software_revision

PACKAGES = ('numpy', 'scipy', 'numba', 'trimesh', 'shapely', 'mcap', 'rerun-sdk', 'rclpy')


def version_of(package: str) -> str:
    """Of an installed Python package, else 'not installed'."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return 'not installed'


def provenance(part_sha256: str, program_sha256: str = '') -> dict:
    """For job.yaml. program_sha256: of the program of others that is laid; '' = the part is planned."""
    return {
        'part_sha256': part_sha256,
        'program_sha256': program_sha256,
        'software': software_revision(),
        'python': platform.python_version(),
        'system': platform.platform(),
        'packages': {p: version_of(p) for p in PACKAGES},
    }
