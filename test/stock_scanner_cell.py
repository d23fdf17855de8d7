"""The simulated cell with a scanner as stock drivers are: it always measures, has no scanner/enable, and publishes one
cloud per profile, best effort. Arguments: those of the executable `cell`."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2, PointField

from waam_msgs.msg import ProfileBatch
from waam_node.conversions import nanoseconds
from waam_node.node import main
from waam_sim.cell_node import Cell

FIELDS = [
    PointField(name=n, offset=4 * i, datatype=PointField.FLOAT32, count=1)
    for i, n in enumerate(('x', 'y', 'z'))
]


class StockScannerCell(Cell):
    """In place of `cell`."""

    def create_service(self, kind: type, name: str, *args: Any, **options: Any) -> Any:
        """All but one."""
        return (
            None
            if name == 'scanner/enable'
            else super().create_service(kind, name, *args, **options)
        )

    def create_publisher(self, kind: type, topic: str, *args: Any, **options: Any) -> Any:
        """`profiles` leave as clouds."""
        if topic != 'profiles':
            return super().create_publisher(kind, topic, *args, **options)
        self._clouds = super().create_publisher(PointCloud2, 'points', qos_profile_sensor_data)
        return self

    def _prepare(self) -> None:
        self._plant.scanning = True

    def publish(self, batch: ProfileBatch) -> None:
        """One cloud per profile: distances, infinity where nothing returns."""
        n, m = batch.profile_count, batch.points_per_profile
        points = np.zeros((n, m, 3), np.float32)
        z = np.frombuffer(batch.z, np.float32).reshape(n, m)
        points[..., 0] = np.frombuffer(batch.x, np.float32).reshape(n, m)
        points[..., 2] = np.where(np.isfinite(z), -z, np.inf)
        for own, offset in zip(points, batch.stamp_offsets_ns, strict=True):
            msg = PointCloud2(height=1, width=m, point_step=12, row_step=12 * m, fields=FIELDS)
            msg.header.frame_id = 'scanner'
            stamp = msg.header.stamp
            stamp.sec, stamp.nanosec = divmod(nanoseconds(batch.header.stamp) + offset, 10**9)
            msg.data = array('B', own.tobytes())
            self._clouds.publish(msg)


if __name__ == '__main__':
    main(StockScannerCell)
