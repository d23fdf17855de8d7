"""Profile batches, telemetry and height maps: message <-> array."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import LaserScan, PointCloud2

from waam_msgs.msg import GridInfo, HeightMap, ProfileBatch
from waam_msgs.srv import BeginScan, FinishScan
from waam_node.conversions import (
    grid_from_msg,
    nanoseconds,
    paths_from_msg,
    stamp_ns,
    to_msg,
    transform_to_msg,
)
from waam_process.grid import GridError, GridSpec

from .map_maker import ScanMap
from .stream.point_fields import CloudLayout, profile_of_rays, profiles_of
from .stream.profiles import ProfileBlock, block_of
from .stream.session import LaidBeads, Session
from .transform import Mounting

MAX_CELLS = 2_000_000  # of a grid: 0.7 GB
Response = TypeVar('Response', BeginScan.Response, FinishScan.Response)


def block_from_msg(msg: ProfileBatch) -> ProfileBlock:
    """ValueError names the array whose length does not fit the counts."""
    return block_of(
        msg.sequence, msg.profile_count, msg.points_per_profile, nanoseconds(msg.header.stamp),
        np.frombuffer(msg.stamp_offsets_ns, np.int64),
        *(np.frombuffer(v, np.float32) for v in (msg.x, msg.z)),
    )  # fmt: skip


def block_from_cloud(msg: PointCloud2, down: bool, period_ns: int) -> ProfileBlock:
    """A driver's cloud: one profile per row, `period_ns` apart. ValueError says what is wrong with it."""
    fields = tuple((f.name, f.offset, f.datatype, f.count) for f in msg.fields)
    layout = CloudLayout(
        fields, msg.width, msg.height, msg.point_step, msg.row_step, msg.is_bigendian
    )
    if msg.height > 1 and period_ns <= 0:
        raise ValueError(
            f'the cloud holds {msg.height} profiles but one stamp: set the parameter points_period'
        )
    x, z = profiles_of(layout, msg.data, down)
    stamps = nanoseconds(msg.header.stamp) + period_ns * np.arange(len(x), dtype=np.int64)
    return ProfileBlock(stamps, x, z)


def block_from_scan(msg: LaserScan) -> ProfileBlock:
    """One profile, at the time of its middle ray. ValueError says what is wrong with it."""
    ranges = np.frombuffer(msg.ranges, np.float32)
    limits = msg.range_min, msg.range_max
    x, z = profile_of_rays(ranges, msg.angle_min, msg.angle_increment, *limits)
    if not np.isfinite(msg.time_increment):
        raise ValueError(f'time_increment is {msg.time_increment}')
    middle = round(msg.time_increment * (len(ranges) - 1) / 2 * 1e9)
    return ProfileBlock(np.array([nanoseconds(msg.header.stamp) + middle]), x, z)


def checked_grid(msg: GridInfo) -> GridSpec:
    """GridError also for a rotated grid and for more cells than the node may hold."""
    q = msg.origin.orientation
    if abs(q.x) + abs(q.y) + abs(q.z) > 1e-9:
        raise GridError('a rotated grid is not supported: origin.orientation must be the identity')
    spec = grid_from_msg(msg)
    if spec.rows * spec.cols > MAX_CELLS:
        raise GridError(f'{spec.rows} x {spec.cols} cells are more than the limit of {MAX_CELLS}')
    return spec


def laid_beads(request: BeginScan.Request) -> LaidBeads:
    """The beads that were laid last; older records tell none. GridError says what does not fit."""
    if not hasattr(request, 'laid'):
        return LaidBeads()
    try:
        paths = paths_from_msg(request.laid)
    except ValueError as e:
        raise GridError(f'laid: {e}') from None
    widths = np.asarray(request.laid_width, np.float32).astype(float)
    if len(widths) != sum(len(p) for p in paths):
        raise GridError(f'laid_width has {len(widths)} values for {sum(map(len, paths))} points')
    if not all(np.isfinite(p).all() for p in paths) or not ((widths > 0) & (widths < 0.1)).all():
        raise GridError('laid must be finite, laid_width must be above 0 and below 0.1 m')
    split = np.split(widths, np.cumsum([len(p) for p in paths])[:-1]) if paths else []
    return LaidBeads(tuple(paths), tuple(split))


def map_to_msg(session: Session, found: ScanMap) -> HeightMap:
    """The map of a scan, stamped with its newest used profile; plausible when there are no doubts."""
    fused, counts, width = found.fused, session.counts, found.width
    return to_msg(
        HeightMap, stamp=stamp_ns(session.newest_used_ns or 0), frame='work', job_id=session.job_id,
        scan_id=session.scan_id, layer=session.layer, grid=fused.spec, z=fused.z, sigma=fused.sigma,
        count=fused.count, coverage=fused.coverage, residual=fused.residual,
        plausible=not found.doubts, reasons=found.doubts + session.notes(), profiles_used=counts.used,
        profiles_rejected=counts.rejected, points_used=fused.points_used, points_rejected=fused.points_rejected,
        bead_width=width.width, bead_width_u=width.u, bead_width_expected=width.expected,
        bead_width_sections=width.sections,
    )  # fmt: skip


def mounting_to_msg(mounting: Mounting, stamp: Time) -> TransformStamped:
    """The frame of the scanner at the torch, as it is calibrated."""
    turned = Rotation.from_matrix(mounting.rotation).as_quat()
    return transform_to_msg('torch_tcp', 'scanner', mounting.offset.tolist(), turned, stamp)


def answer(response: Response, code: int, message: str) -> Response:
    """The response of begin or finish with its code and text."""
    response.error_code, response.message = code, message
    return response
