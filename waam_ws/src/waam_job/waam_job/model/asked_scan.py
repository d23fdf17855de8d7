"""Whether a scan is the one that was asked for."""

from __future__ import annotations

from waam_process.grid import GridSpec

from .snapshots import Scan

EARLY = 1.0  # s by which the stamp of a scan may lie before its begin: the scanner has a clock of its own


def foreign(scan: Scan, job_id: str, layer: int, spec: GridSpec, begun: float) -> str:
    """Why `scan` is not that of `job_id` after `layer` layers on the grid `spec`, begun at ROS time `begun` (s), in
    words; '' when it is. What a scan that came without a message does not tell is not compared."""
    if scan.job_id and scan.job_id != job_id:
        return f"it is of job '{scan.job_id}', asked for was '{job_id}'"
    if scan.layer not in (-1, layer):
        return f'it was taken after layer {scan.layer}, asked for was one after layer {layer}'
    if scan.map.spec != spec:
        return f'its grid is {_grid(scan.map.spec)}, asked for was {_grid(spec)}'
    if scan.stamp < begun - EARLY:  # NaN: not known
        return f'it is older than the request, by {begun - scan.stamp:.0f} s'
    return ''


def _grid(s: GridSpec) -> str:
    x, y = s.origin_x * 1e3, s.origin_y * 1e3
    return f'{s.rows} x {s.cols} cells of {s.resolution * 1e3:g} mm from ({x:.3f}, {y:.3f}) mm'
