"""Surface, correction and beads for RViz and Foxglove: PointCloud2 and MarkerArray. Nothing is received or computed
while nobody subscribes to them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from waam_msgs.msg import CorrectionMap, HeightMap, LayerPlan, Segment
from waam_node.conversions import grid_from_msg
from waam_node.node import WaamNode
from waam_node.qos import LATCHED
from waam_process.grid import GridSpec

LOOK_S = 0.5  # between two looks whether somebody subscribes
COLOURS = np.array(
    [[40, 90, 220], [230, 230, 230], [220, 50, 40]]
)  # of psi -1, 0, 1: slower, as it is, faster
BEAD = ColorRGBA(r=0.95, g=0.6, b=0.15, a=1.0)


class LayerTopics:
    """`height_points`, `correction_points` and `bead_markers`, latched, made of the newest height_map, correction_map
    and layer_plan."""

    def __init__(self, node: WaamNode) -> None:
        self._node = node
        self._map: HeightMap | None = None
        self._psi: CorrectionMap | None = None
        make = node.create_publisher
        self._points = make(PointCloud2, 'height_points', LATCHED)
        self._correction = make(PointCloud2, 'correction_points', LATCHED)
        self._beads = make(MarkerArray, 'bead_markers', LATCHED)
        self._sources = (
            (HeightMap, 'height_map', self._on_map, (self._points, self._correction)),
            (CorrectionMap, 'correction_map', self._on_correction, (self._correction,)),
            (LayerPlan, 'layer_plan', self._on_plan, (self._beads,)),
        )
        self._heard: dict[str, Any] = {}  # subscriptions, by topic
        node.create_timer(LOOK_S, self._look, clock=node.steady)

    def _look(self) -> None:
        for kind, topic, take, outs in self._sources:
            wanted = any(out.get_subscription_count() for out in outs)
            if wanted and topic not in self._heard:
                heard = partial(self._take, topic, take)
                self._heard[topic] = self._node.create_subscription(kind, topic, heard, LATCHED)
            elif not wanted and topic in self._heard:
                self._node.destroy_subscription(self._heard.pop(topic))

    def _take(self, topic: str, take: Callable[[Any], None], msg: Any) -> None:
        try:
            take(msg)
        except ValueError as e:
            self._node.get_logger().warning(f'{topic}: {e}')

    def _on_map(self, msg: HeightMap) -> None:
        z, sigma = (np.array(values, np.float32) for values in (msg.z, msg.sigma))
        xy = places(grid_from_msg(msg.grid), z)
        self._points.publish(cloud(msg.header, xy, z=z, sigma=sigma))
        self._map = msg
        if self._psi is not None:  # it came before its map
            self._on_correction(self._psi)

    def _on_correction(self, msg: CorrectionMap) -> None:
        self._psi = msg
        psi = np.array(msg.psi, np.float32)
        xy = places(grid_from_msg(msg.grid), psi)
        on_map = self._map is not None and self._map.grid == msg.grid
        z = np.array(self._map.z if self._map and on_map else np.full(len(psi), np.nan), np.float32)
        self._correction.publish(cloud(msg.header, xy, z=z, psi=psi, rgb=coloured(psi)))

    def _on_plan(self, msg: LayerPlan) -> None:
        self._beads.publish(markers(msg))


def places(grid: GridSpec, values: np.ndarray) -> np.ndarray:
    """(n, 2) m: the middles of the cells, in the order of values (n,). ValueError where there are not as many."""
    if len(values) != grid.rows * grid.cols:
        raise ValueError(f'{len(values)} values for {grid.rows} x {grid.cols} cells')
    x = grid.origin_x + (np.arange(grid.cols) + 0.5) * grid.resolution
    y = grid.origin_y + (np.arange(grid.rows) + 0.5) * grid.resolution
    return np.column_stack([np.tile(x, grid.rows), np.repeat(y, grid.cols)])


def coloured(psi: np.ndarray) -> np.ndarray:
    """(n,) float32 that hold red, green, blue, as RViz has them."""
    n = len(COLOURS)
    at = np.linspace(-1, 1, n)
    red, green, blue = (np.interp(psi, at, COLOURS[:, i]).astype(np.uint32) for i in range(3))
    return (red << 16 | green << 8 | blue).astype(np.uint32).view(np.float32)


def cloud(header: Header, xy: np.ndarray, **values: np.ndarray) -> PointCloud2:
    """Points at xy (n, 2), m, with float32 values (n,), of which z is one; those without a height are left out."""
    if len({len(v) for v in (xy, *values.values())}) > 1:
        raise ValueError('not as many values of one kind as of another')
    seen = np.isfinite(values['z'])
    columns = {'x': xy[:, 0], 'y': xy[:, 1], **values}
    data = np.column_stack([v[seen].astype(np.float32) for v in columns.values()])
    fields = [
        PointField(name=name, offset=4 * n, datatype=PointField.FLOAT32, count=1)
        for n, name in enumerate(columns)
    ]
    made = PointCloud2(header=header, height=1, width=len(data), fields=fields, is_dense=True)
    made.point_step, made.row_step = 4 * len(fields), data.nbytes
    made.data.frombytes(data.tobytes())
    return made


def markers(plan: LayerPlan) -> MarkerArray:
    """A strip for each bead of a layer, as wide as it; what stood there before goes."""
    made = MarkerArray(markers=[Marker(header=plan.header, action=Marker.DELETEALL)])
    before: Segment | None = None
    for s in plan.segments:
        if s.kind != Segment.DEPOSIT:
            before = None
            continue
        if before is None or before.bead != s.bead or before.end != s.start:
            strip = Marker(header=plan.header, ns='beads', id=len(made.markers), color=BEAD)
            strip.type, strip.scale.x = Marker.LINE_STRIP, s.width
            strip.pose.orientation.w = 1.0
            strip.points = [_point(s.start)]
            made.markers.append(strip)
        made.markers[-1].points.append(_point(s.end))
        before = s
    return made


def _point(p: Point) -> Point:
    return Point(x=p.x, y=p.y, z=p.z)
