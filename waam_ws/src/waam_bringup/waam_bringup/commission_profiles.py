"""Profiles of the scanner while the machine moves, as its driver publishes them, with the poses beside them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import LaserScan, PointCloud2
from std_srvs.srv import SetBool

from waam_msgs.msg import ProfileBatch, Telemetry
from waam_node.conversions import nanoseconds
from waam_node.qos import PROFILES, subscribe_to_driver
from waam_scan.calibration.scan_pass import Pass
from waam_scan.conversions import block_from_cloud, block_from_scan
from waam_scan.stream.profiles import ProfileBlock, read_batch

from .client import MATCHING_S, ClientError
from .commission_cell import CommissionedCell

WANTED = (
    'calibration',
    'points_topic',
    'scan_topic',
    'scanner_frame',
    'points_down',
    'points_period',
)
ASIDE_S = 1.0  # telemetry before and after the motion, for stamps that are off
DRIVER_DEPTH = 1000
THERE_S = 2.0  # until a service that is there is found


def scanner_settings(cell: CommissionedCell) -> dict[str, Any]:
    """What scan_fusion runs with. ClientError."""
    request = GetParameters.Request(names=list(WANTED))
    answer = cell.ask(GetParameters, 'scan_fusion/get_parameters', request)
    if len(answer.values) != len(WANTED):
        raise ClientError('scan_fusion does not say its parameters')
    return {n: parameter_value_to_python(v) for n, v in zip(WANTED, answer.values, strict=True)}


class Profiles:
    """Listens; `blocks` in the order in which they came, `bad`: what could not be read."""

    def __init__(self, cell: CommissionedCell) -> None:
        self.cell, self.told = cell, scanner_settings(cell)
        self.blocks: list[ProfileBlock] = []
        self.bad: list[str] = []
        node, told = cell.node, self.told
        node.create_subscription(ProfileBatch, 'profiles', self._on_batch, PROFILES, raw=True)
        for kind, topic, take in (
            (PointCloud2, told['points_topic'], self._on_cloud),
            (LaserScan, told['scan_topic'], self._on_scan),
        ):
            subscribe_to_driver(node, kind, topic, take, DRIVER_DEPTH)

    def _on_batch(self, data: bytes) -> None:
        self._take(lambda: read_batch(data)[1])

    def _on_cloud(self, message: PointCloud2) -> None:
        period = round(1e9 * self.told['points_period'])
        self._driven(message, lambda: block_from_cloud(message, self.told['points_down'], period))

    def _on_scan(self, message: LaserScan) -> None:
        self._driven(message, lambda: block_from_scan(message))

    def _driven(self, message: Any, read: Any) -> None:
        if message.header.frame_id == self.told['scanner_frame']:  # another one is another device
            self._take(read)

    def _take(self, read: Any) -> None:
        try:
            self.blocks.append(read())
        except ValueError as e:
            self.bad.append(str(e))

    @contextlib.contextmanager
    def on(self) -> Iterator[None]:
        """The scanner measures inside; one without a service always does. ClientError."""
        switched = self.cell.offers(SetBool, 'scanner/enable', THERE_S)
        self.cell.until(lambda: False, MATCHING_S)
        if switched:
            self._switch(True)
        try:
            self.cell.frames.clear()
            self.blocks.clear()
            self.cell.until(lambda: self._seconds() > ASIDE_S, 30.0)
            self.blocks.clear()
            yield
            begun = self._seconds()
            self.cell.until(lambda: self._seconds() > begun + ASIDE_S, 30.0)
        finally:
            if switched:
                self._switch(False)

    def _switch(self, on: bool) -> None:
        answer = self.cell.ask(SetBool, 'scanner/enable', SetBool.Request(data=on))
        if not answer.success:
            raise ClientError(f'the scanner: {answer.message}')

    def _seconds(self) -> float:
        """Of the stamps of the telemetry that is kept."""
        frames = self.cell.frames
        return 1e-9 * (_stamp(frames[-1]) - _stamp(frames[0])) if frames else 0.0

    def taken(self) -> Pass:
        """All that was seen as one pass. ClientError when that is nothing."""
        if not self.blocks:
            why = f' ({self.bad[0]})' if self.bad else ''
            topics = f"profiles, {self.told['points_topic']} and {self.told['scan_topic']}"
            raise ClientError(f'no profile came on {topics}{why}: driver, laser, frame_id')
        points = max(b.x.shape[1] for b in self.blocks)
        x, z = (
            np.concatenate([_wide(getattr(b, name), points) for b in self.blocks])
            for name in ('x', 'z')
        )
        stamps = np.concatenate([b.stamps for b in self.blocks])
        frames = list(self.cell.frames)
        at, first = np.unique([_stamp(f) for f in frames], return_index=True)
        place = np.array([(f.position.x, f.position.y, f.position.z) for f in frames])[first]
        order = np.argsort(stamps, kind='stable')
        return Pass(stamps[order], x[order], z[order], at.astype(np.int64), place, 'commissioning')


def _stamp(frame: Telemetry) -> int:
    return nanoseconds(frame.header.stamp)


def _wide(values: np.ndarray, points: int) -> np.ndarray:
    out = np.full((len(values), points), np.nan, np.float32)
    out[:, : values.shape[1]] = values
    return out
