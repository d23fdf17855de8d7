"""Surface, correction and beads as stock messages, and only while somebody asks for them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import Point
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from waam_msgs.msg import CorrectionMap, HeightMap, LayerPlan, Segment
from waam_node.conversions import grid_to_msg
from waam_node.node import WaamNode
from waam_node.qos import LATCHED
from waam_node.testing import fresh_domain
from waam_process.grid import GridSpec
from waam_view.node_layers import LayerTopics, markers

GRID = GridSpec(0.01, 0.02, 1e-3, 2, 3)
Z = [0.001, 0.002, float('nan'), 0.004, 0.005, 0.006]


@dataclass(frozen=True)
class NoParams:
    """None."""


@pytest.fixture
def cell():
    context = Context()
    rclpy.init(context=context, domain_id=fresh_domain())
    node = WaamNode('dashboard', NoParams, context=context)
    layers, client = LayerTopics(node), Node('cell', context=context)
    executor = SingleThreadedExecutor(context=context)
    for one in (node, client):
        executor.add_node(one)

    def until(condition) -> None:
        end = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end
            executor.spin_once(timeout_sec=0.05)

    yield layers, client, until
    for one in (node, client):
        one.destroy_node()
    context.try_shutdown()


def columns(msg: PointCloud2) -> dict[str, np.ndarray]:
    rows = np.frombuffer(msg.data, np.float32).reshape(msg.width, -1)
    return {f.name: rows[:, f.offset // 4] for f in msg.fields}


def test_a_map_and_its_correction_are_points_while_somebody_subscribes(cell):
    layers, client, until = cell
    maps = client.create_publisher(HeightMap, 'height_map', LATCHED)
    corrections = client.create_publisher(CorrectionMap, 'correction_map', LATCHED)
    height = HeightMap(grid=grid_to_msg(GRID), z=Z, sigma=[1e-5] * 6)
    height.header.frame_id = 'work'
    maps.publish(height)
    assert maps.get_subscription_count() == 0
    got: list[PointCloud2] = []
    seen = client.create_subscription(PointCloud2, 'height_points', got.append, LATCHED)
    until(lambda: got)
    points = columns(got[0])
    assert got[0].header.frame_id == 'work' and got[0].width == 5  # one cell was never seen
    assert points['x'] == pytest.approx([0.0105, 0.0115, 0.0105, 0.0115, 0.0125])
    assert points['y'] == pytest.approx([0.0205, 0.0205, 0.0215, 0.0215, 0.0215])
    assert points['z'] == pytest.approx([0.001, 0.002, 0.004, 0.005, 0.006])

    psi = [-1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    laid: list[PointCloud2] = []
    client.create_subscription(PointCloud2, 'correction_points', laid.append, LATCHED)
    until(lambda: 'correction_map' in layers._heard)
    corrections.publish(CorrectionMap(grid=grid_to_msg(GRID), psi=psi))
    until(lambda: laid)
    points = columns(laid[0])
    assert points['z'] == pytest.approx([0.001, 0.002, 0.004, 0.005, 0.006])
    blue, red = points['rgb'].copy().view(np.uint32)[[0, -1]]
    assert blue & 0xFF > blue >> 16 and red >> 16 > red & 0xFF

    corrections.publish(CorrectionMap(grid=grid_to_msg(GRID), psi=psi[:3]))  # nonsense
    client.destroy_subscription(seen)
    maps.publish(height)
    until(lambda: layers._points.get_subscription_count() == 0)
    assert len(got) == 1


def test_a_correction_that_comes_before_its_map_lies_on_it(cell):
    layers, client, until = cell
    got: list[PointCloud2] = []
    client.create_subscription(PointCloud2, 'correction_points', got.append, LATCHED)
    psi = CorrectionMap(grid=grid_to_msg(GRID), psi=[0.5] * 6)
    client.create_publisher(CorrectionMap, 'correction_map', LATCHED).publish(psi)
    until(lambda: got)
    assert got[0].width == 0  # no height is known
    height = HeightMap(grid=grid_to_msg(GRID), z=Z, sigma=[1e-5] * 6)
    client.create_publisher(HeightMap, 'height_map', LATCHED).publish(height)
    until(lambda: len(got) == 2)
    assert columns(got[1])['z'] == pytest.approx([0.001, 0.002, 0.004, 0.005, 0.006])


def piece(bead: int, a: tuple[float, float], b: tuple[float, float], kind: int) -> Segment:
    (x, y), (u, v) = a, b
    return Segment(bead=bead, kind=kind, start=Point(x=x, y=y), end=Point(x=u, y=v), width=0.005)


def test_beads_are_strips_of_their_width(cell):
    _, client, until = cell
    laid = Segment.DEPOSIT
    plan = LayerPlan(layer=2)
    plan.segments = [
        piece(0, (0.0, 0.0), (0.0, 0.1), Segment.IDLE),
        piece(1, (0.0, 0.1), (0.1, 0.1), laid),
        piece(1, (0.1, 0.1), (0.1, 0.2), laid),
        piece(2, (0.1, 0.2), (0.0, 0.2), laid),
    ]
    got: list[MarkerArray] = []
    client.create_subscription(MarkerArray, 'bead_markers', got.append, LATCHED)
    client.create_publisher(LayerPlan, 'layer_plan', LATCHED).publish(plan)
    until(lambda: got)
    clear, first, second = got[0].markers
    assert clear.action == Marker.DELETEALL and first.id != second.id
    assert [len(m.points) for m in (first, second)] == [3, 2] and first.scale.x == 0.005
    assert (first.points[2].x, first.points[2].y) == (0.1, 0.2)
    assert len(markers(LayerPlan()).markers) == 1
