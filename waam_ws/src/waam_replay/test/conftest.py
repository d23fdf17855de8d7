"""A small recorded job, made without a graph: profiles and telemetry over a stepped surface, the questions of a job,
and the answers that the real nodes give to them (their methods are called, nothing is sent)."""

from __future__ import annotations

import os
from array import array
from dataclasses import dataclass, field
from pathlib import Path

os.environ.setdefault('ROS_DOMAIN_ID', '76')

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import Point, Vector3
from rclpy.serialization import deserialize_message, serialize_message
from service_msgs.msg import ServiceEventInfo

from waam_adapt.correction_server_node import CorrectionServer
from waam_adapt.feed_forward_node import FeedForward
from waam_msgs.msg import CorrectionMap, HeightMap, ProfileBatch, Segment, Telemetry
from waam_msgs.srv import BeginScan, ComputeCorrection, ComputeFeed, FinishScan
from waam_node.conversions import floats, grid_to_msg, time_to_msg
from waam_process.grid import GridSpec
from waam_process.learned import Taught, nothing
from waam_record.bag_writer import BagWriter, Topic
from waam_record.definitions import ament_prefixes, full_text
from waam_scan.conversions import block_from_msg, map_to_msg
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion_params import FusionParams
from waam_scan.map_maker import MapMaker
from waam_scan.stream.session import Session

START_NS = 1_700_000_000_000_000_000
MS = 1_000_000
SPEC = GridSpec(0.0, 0.0, 1e-3, 24, 30)
PROFILES, POINTS = 10, 60
# the recorded job was not the first one of its cell
LEARNED = nothing('cell', 'er70s-6', 'w400_h150').after(Taught(0.9, 0.02, 5), 'before').text()
JOB = 'j'


def surface(x: np.ndarray, y: np.ndarray, layer: int) -> np.ndarray:
    """m; a hollow that fills up."""
    return 1e-3 * (1.5 * layer - 0.6 * (x > 0.015)) + 1e-4 * np.sin(y * 400)


@dataclass
class Tape:
    """Messages on their way into a recording; `now_ns`: ROS time and publication time at once."""

    writer: BagWriter
    now_ns: int = START_NS
    numbers: dict[str, int] = field(default_factory=dict)
    sequences: dict[str, int] = field(default_factory=dict)

    def put(self, topic: str, type_name: str, msg, latched: bool = False) -> None:
        if topic not in self.numbers:
            text = full_text(type_name, ament_prefixes())
            self.numbers[topic] = self.writer.add_topic(
                Topic(topic, type_name, text, latched=latched)
            )
        n = self.sequences[topic] = self.sequences.get(topic, 0) + 1
        data = bytes(serialize_message(msg))
        self.writer.write(self.numbers[topic], self.now_ns, self.now_ns, n, data)

    def ask(self, kind, service: str, request, response) -> None:
        """Both events of one call."""
        name = f'waam_msgs/srv/{kind.__name__}_Event'
        number = self.sequences.get(service, 0)
        for event_type, fields in ((1, {'request': [request]}), (2, {'response': [response]})):
            self.now_ns += MS
            stamp = time_to_msg(0)
            stamp.sec, stamp.nanosec = divmod(self.now_ns, 10**9)
            info = ServiceEventInfo(event_type=event_type, stamp=stamp, sequence_number=number)
            self.put(f'/{service}/_service_event', name, kind.Event(info=info, **fields))


class Job:
    """Writes a job of two layers and keeps what its scans should give."""

    def __init__(self, folder: Path, late: bool = True) -> None:
        self.params = FusionParams()
        custom = {
            'loop_mode': 'closed_loop',
            'job_id': JOB,
            'parameters.scan_fusion': '{"height_max": 0.3}',
        }
        self.tape = Tape(BagWriter(folder, custom))
        self.maps: list[HeightMap] = []
        self.late = late
        self._frame = self._batch = 0
        self.maker = MapMaker(self.params)
        self.corrector, self.feeder = CorrectionServer(), FeedForward()
        self.corrector.now_s = lambda: self.tape.now_ns * 1e-9
        before = None
        for layer in (0, 1, 2):
            self._scan(layer)
            if layer < 2:
                before = self._layer(layer + 1, before)
        self.tape.writer.close()
        for node in (self.corrector, self.feeder):
            node.destroy_node()

    def _telemetry(self, x: float) -> None:
        self.tape.now_ns += 10 * MS
        msg = Telemetry(sequence=self._frame, position=Point(x=x, y=0.012, z=0.05))
        msg.header.frame_id = 'work'
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(self.tape.now_ns, 10**9)
        self._frame += 1
        self.maker.track.append(self.tape.now_ns, x, 0.012, 0.05)
        self.tape.put('/telemetry', 'waam_msgs/msg/Telemetry', msg)

    def _batch_at(self, x: float, layer: int) -> tuple[np.ndarray, np.ndarray]:
        """One batch of profiles while the tip stands at x; scanner frame: x lateral, z up."""
        lateral = np.tile(np.linspace(-0.011, 0.011, POINTS, dtype=np.float32), (PROFILES, 1))
        place = x + self.params.mount_xyz[0]
        height = surface(np.full(POINTS, place), 0.012 + lateral[0], layer)
        z = np.tile((height - 0.05 - self.params.mount_xyz[2]).astype(np.float32), (PROFILES, 1))
        return lateral, z

    def _profiles(self, x: float, layer: int, session: Session | None) -> None:
        lateral, z = self._batch_at(x, layer)
        msg = ProfileBatch(sequence=self._batch, profile_count=PROFILES, points_per_profile=POINTS)
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(self.tape.now_ns - 9 * MS, 10**9)
        msg.stamp_offsets_ns = array('q', [i * MS // 2 for i in range(PROFILES)])
        msg.x, msg.z = floats(lateral), floats(z)
        self._batch += 1
        self.tape.put('/profiles', 'waam_msgs/msg/ProfileBatch', msg)
        if session is not None:
            session.add_batch(msg.sequence, block_from_msg(msg))
            self.fusion.add(np.tile([x, 0.012, 0.05], (PROFILES, 1)), lateral, z)

    def _scan(self, layer: int) -> None:
        begin = BeginScan.Request(job_id=JOB, layer=layer, grid=grid_to_msg(SPEC))
        self._telemetry(-0.06)
        self.tape.ask(BeginScan, 'scan_fusion/begin', begin, BeginScan.Response(scan_id=layer))
        session = self._session(layer)
        self.fusion = Fusion(SPEC, self.params.mounting, self.params.fusion)
        xs = np.arange(-0.0595, -0.0305, 0.5e-3)
        for x in xs:
            for _ in range(2):  # the tip stands still while a batch is taken
                self._telemetry(float(x))
            self._profiles(float(x), layer, session)
        self._telemetry(float(xs[-1]))
        until = self.tape.now_ns - 15 * MS  # just before the newest profile
        if self.late:  # taken after the motion, arrived after the map was closed
            self._telemetry(0.0)
        request = FinishScan.Request(scan_id=layer)
        request.until.sec, request.until.nanosec = divmod(until, 10**9)
        session.until_ns = until
        found = self._map(session)
        self.maps.append(found)
        if self.late:
            self._profiles(0.0, layer, None)
        self.tape.ask(FinishScan, 'scan_fusion/finish', request, FinishScan.Response(map=found))

    def _session(self, layer: int) -> Session:
        return self.maker.begin(JOB, layer, layer, SPEC, -(2**62))

    def _map(self, session: Session) -> HeightMap:
        """As scan_fusion publishes it; a fusion that was fed directly agrees."""
        found = self.maker.finish(session)
        assert found.fused.z.tobytes() == self.fusion.result().z.tobytes()
        assert not found.doubts
        sent = serialize_message(map_to_msg(session, found))
        return deserialize_message(sent, HeightMap)

    def _layer(self, number: int, before: tuple | None) -> tuple:
        z = np.array(self.maps[-1].z, np.float32).reshape(SPEC.shape)
        planned = np.full(SPEC.shape, 1.5e-3)
        target = np.full(SPEC.shape, 1.5e-3 * (number - 1))
        request = ComputeCorrection.Request(job_id=JOB, layer=number, map=self.maps[-1])
        request.target, request.planned_height = floats(target), floats(planned)
        request.bead_width, request.temperature, request.k_gain = 4e-3, 80.0, float('nan')
        request.direction = Vector3(x=1.0)
        request.learned = LEARNED
        if before is not None:
            request.previous_surface, request.previous_growth = map(floats, before)
            request.previous_feed_factor = 1.05
        found, learned = self.corrector.compute(request)
        computed = serialize_message(found)
        correction = deserialize_message(computed, CorrectionMap)  # rounded as on the wire
        answer = ComputeCorrection.Response(correction=correction, learned=learned)
        self.tape.ask(ComputeCorrection, 'correction_server/compute', request, answer)
        self.tape.put('/correction_map', 'waam_msgs/msg/CorrectionMap', correction, latched=True)
        asked = ComputeFeed.Request(
            job_id=JOB,
            material='er70s-6',
            apply_correction=True,
            heat_factor=0.97,
            correction=correction,
        )
        asked.segments = segments(number)
        unchanged = ComputeFeed.Request(
            job_id=JOB,
            material='er70s-6',
            apply_correction=True,
            heat_factor=0.97,
            correction=correction,
        )
        unchanged.segments = segments(number)
        self.feeder.compute(asked)  # writes into the segments of the request
        self.tape.ask(
            ComputeFeed,
            'feed_forward/compute',
            unchanged,
            ComputeFeed.Response(segments=asked.segments),
        )
        return z, np.full(SPEC.shape, 1.4e-3)


def segments(layer: int) -> list[Segment]:
    made = []
    for i, y in enumerate(np.arange(2e-3, 22e-3, 3e-3)):
        for k, x in enumerate(np.arange(1e-3, 28e-3, 3e-3)):
            s = Segment(index=100 * i + k, layer=layer, bead=i + 1, kind=Segment.DEPOSIT, arc=True)
            s.start, s.end = Point(x=x, y=y), Point(x=x + 3e-3, y=y)
            s.height, s.width, s.speed, s.speed_programmed = 1.5e-3, 6e-3, 1e-2, 1e-2
            s.voltage = 20.0
            made.append(s)
    return made


@pytest.fixture(scope='session')
def ros():
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope='session')
def make_job(ros) -> type[Job]:
    return Job


@pytest.fixture(scope='session')
def job(ros, tmp_path_factory) -> Path:
    """A job folder with a record of two layers and three scans."""
    folder = tmp_path_factory.mktemp('job')
    Job(folder / 'record')
    return folder
