"""Profile batches, telemetry and height maps: message <-> array."""

from __future__ import annotations

from array import array
from typing import TypeVar

import numpy as np
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from waam_msgs.msg import GridInfo, HeightMap, ProfileBatch
from waam_msgs.srv import BeginScan, FinishScan
from waam_node.conversions import floats, grid_from_msg, grid_to_msg, nanoseconds, paths_from_msg
from waam_process.grid import GridError, GridSpec

from .bead_width import BeadWidth
from .fusion.height_map import FusedMap
from .stream.point_fields import CloudLayout, profiles_of
from .stream.profiles import ProfileBlock, block_of
from .stream.session import LaidBeads, Session

Response = TypeVar('Response', BeginScan.Response, FinishScan.Response)


def block_from_msg(msg: ProfileBatch) -> ProfileBlock:
    """ValueError names the array whose length does not fit the counts."""
    return block_of(
        msg.sequence, msg.profile_count, msg.points_per_profile, nanoseconds(msg.header.stamp),
        np.frombuffer(msg.stamp_offsets_ns, np.int64),
        *(np.frombuffer(v, np.float32) for v in (msg.x, msg.z, msg.intensity)),
    )  # fmt: skip


def block_from_cloud(msg: PointCloud2, down: bool, nearest: float, period_ns: int) -> ProfileBlock:
    """A driver's cloud: one profile per row, `period_ns` apart. ValueError says what is wrong with it."""
    fields = tuple((f.name, f.offset, f.datatype, f.count) for f in msg.fields)
    layout = CloudLayout(
        fields, msg.width, msg.height, msg.point_step, msg.row_step, msg.is_bigendian
    )
    if msg.height > 1 and period_ns <= 0:
        raise ValueError(
            f'the cloud holds {msg.height} profiles but one stamp: set the parameter points_period'
        )
    x, z, light = profiles_of(layout, msg.data, down, nearest)
    stamps = nanoseconds(msg.header.stamp) + period_ns * np.arange(len(x), dtype=np.int64)
    return ProfileBlock(stamps, x, z, light)


def checked_grid(msg: GridInfo, max_cells: int) -> GridSpec:
    """GridError also for a rotated grid and for more cells than the node may hold."""
    q = msg.origin.orientation
    if abs(q.x) + abs(q.y) + abs(q.z) > 1e-9:
        raise GridError('a rotated grid is not supported: origin.orientation must be the identity')
    spec = grid_from_msg(msg)
    if spec.rows * spec.cols > max_cells:
        raise GridError(
            f'{spec.rows} x {spec.cols} cells are more than the limit of {max_cells} (parameter max_cells)'
        )
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


def map_to_msg(session: Session, fused: FusedMap, doubts: list[str], width: BeadWidth) -> HeightMap:
    """The map of a scan, stamped with its newest used profile; plausible when there are no `doubts`."""
    stamp_ns = session.assembler.newest_used_ns or 0
    header = Header(frame_id='work')
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    counts = session.assembler.counts
    msg = HeightMap(
        header=header, job_id=session.job_id, scan_id=session.scan_id, layer=session.layer
    )
    msg.grid = grid_to_msg(fused.spec)
    msg.z, msg.sigma = floats(fused.z), floats(fused.sigma)
    msg.count = array('H', fused.count.tobytes())
    msg.coverage, msg.residual = fused.coverage, fused.residual
    msg.plausible, msg.reasons = not doubts, doubts + session.notes()
    msg.profiles_used, msg.profiles_rejected = counts.used, counts.rejected
    msg.points_used, msg.points_rejected = fused.points_used, fused.points_rejected
    msg.bead_width, msg.bead_width_u = width.width, width.u
    msg.bead_width_expected, msg.bead_width_sections = width.expected, width.sections
    return msg


def answer(response: Response, code: int, message: str) -> Response:
    """The response of begin or finish with its code and text."""
    response.error_code, response.message = code, message
    return response
