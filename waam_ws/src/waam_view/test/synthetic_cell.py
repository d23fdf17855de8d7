"""Publishes what a running cell would: telemetry, maps, plan, corrections, states of one short job."""

from __future__ import annotations

import math
from array import array

import numpy as np
from geometry_msgs.msg import Point, Pose
from rclpy.node import Node
from sensor_msgs.msg import Temperature
from std_msgs.msg import Header

from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    GridInfo,
    HeatFactor,
    HeightMap,
    JobStatus,
    LayerPlan,
    LayerReport,
    MachineState,
    Segment,
    Telemetry,
)
from waam_node.conversions import floats, time_to_msg
from waam_node.qos import BEAT, EVENTS, LATCHED, TELEMETRY

START = 1_800_000_000.0
ROWS, COLS, CELL = 80, 140, 0.5e-3
ORIGIN = (0.01, 0.02)  # of the grid, as in synthetic_job.py


class Cell:
    """All publishers of one node."""

    def __init__(self, node: Node) -> None:
        make = node.create_publisher
        self.telemetry_ = make(Telemetry, 'telemetry', TELEMETRY)
        self.height_map_ = make(HeightMap, 'height_map', LATCHED)
        self.correction_ = make(CorrectionMap, 'correction_map', LATCHED)
        self.plan_ = make(LayerPlan, 'layer_plan', LATCHED)
        self.heat_ = make(HeatFactor, 'heat_factor', LATCHED)
        self.temperature_ = make(Temperature, 'temperature', BEAT)
        self.status_ = make(JobStatus, 'job_status', LATCHED)
        self.report_ = make(LayerReport, 'layer_report', EVENTS)
        self.machine_ = make(MachineState, 'machine_state', LATCHED)
        self.anomaly_ = make(Anomaly, 'anomaly', EVENTS)
        self.count = 0
        self.job_id, self.scans = 'demo_job', 0
        x, y = np.meshgrid(np.arange(COLS) / COLS, np.arange(ROWS) / ROWS)
        self.wear = 0.5e-3 * np.sin(6 * x) * np.cos(5 * y)
        self.wear[:4, :9] = np.nan

    def header(self, t: float) -> Header:
        return Header(stamp=time_to_msg(START + t), frame_id='work')

    def status(self, t: float, state: int, job_dir: str = '', layer: int = 0) -> None:
        self.status_.publish(
            JobStatus(
                header=self.header(t), job_id='demo_job', job_dir=job_dir, state=state, layer=layer,
                loop_mode='closed_loop', layers=2, beads=8, progress=0.4, time_left=90.0,
                height_error_rms=2e-4, height_error_max=9e-4, message='synthetic',
            )
        )  # fmt: skip

    def resume(self, run: int) -> None:
        """The job goes on: towards the other nodes that is a job of its own, with scans from 0."""
        self.job_id, self.scans = f'demo_job.r{run}', 0

    def telemetry(self, t: float, layer: int = 1, arc: bool = True) -> None:
        s = (t * 0.2) % 1.0
        self.telemetry_.publish(
            Telemetry(
                header=self.header(t), controller_us=int(t * 1e6), sequence=self.count,
                state=Telemetry.STATE_RUN, travel_speed=0.0101, arc_established=arc,
                position=Point(x=0.012 + 0.045 * s, y=0.01 + 0.0044 * int(t * 0.2 % 5), z=0.002 * layer),
                wire_feed_commanded=0.0833, wire_feed_speed=0.083 + 1e-3 * math.sin(3 * t),
                arc_current=180 + 4 * math.sin(7 * t), arc_voltage=22 + 0.3 * math.sin(5 * t),
            )
        )  # fmt: skip
        self.count += 1

    def grid(self, scale: int = 1) -> GridInfo:
        corner = Pose(position=Point(x=ORIGIN[0], y=ORIGIN[1]))
        return GridInfo(
            resolution=CELL / scale, rows=ROWS * scale, cols=COLS * scale, origin=corner
        )

    def height_map(self, t: float, layer: int, scale: int = 1) -> None:
        """A scan after `layer` layers; its number counts every scan of the run."""
        z = np.kron(self.wear * 0.3**layer, np.ones((scale, scale)))
        z = np.where(np.isfinite(z), z + 0.002 * layer, np.nan)
        self.height_map_.publish(
            HeightMap(
                header=self.header(t), job_id=self.job_id, layer=layer, scan_id=self.scans, grid=self.grid(scale),
                z=floats(z), sigma=floats(z * 0), count=array('H', bytes(2 * z.size)), plausible=True,
            )
        )  # fmt: skip
        self.scans += 1

    def plan(self, t: float, layer: int) -> None:
        segments = []
        for bead in range(5):
            y = 0.01 + 0.0044 * bead
            for i in range(9):
                a, b = (Point(x=0.012 + 0.005 * k, y=y, z=0.002 * (layer - 1)) for k in (i, i + 1))
                segments.append(
                    Segment(index=len(segments), layer=layer, bead=bead + 1, kind=Segment.DEPOSIT,
                            arc=True, start=a, end=b, speed=0.01, height=0.002, width=0.006)
                )  # fmt: skip
        self.plan_.publish(
            LayerPlan(header=self.header(t), job_id='demo_job', layer=layer, segments=segments)
        )

    def correction(self, t: float, layer: int) -> None:
        psi = np.nan_to_num(np.clip(self.wear / 0.4e-3, -1, 1))
        self.correction_.publish(
            CorrectionMap(header=self.header(t), layer=layer, grid=self.grid(), psi=floats(psi),
                          confidence=floats(np.abs(psi)))
        )  # fmt: skip

    def slow(self, t: float) -> None:
        self.temperature_.publish(Temperature(header=self.header(t), temperature=40 + t))
        self.heat_.publish(HeatFactor(header=self.header(t), factor=0.97, interpass_limit=150.0))

    def events(self, t: float) -> None:
        self.machine_.publish(MachineState(header=self.header(t), message='armed for demo_job'))
        self.anomaly_.publish(
            Anomaly(header=self.header(t), severity=1, class_name='scan', text='3 % drop-outs',
                    reaction='none', layer=1, bead=2)
        )  # fmt: skip
        self.report_.publish(LayerReport(header=self.header(t), layer=1, height_error_rms=4e-4))
