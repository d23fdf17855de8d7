"""scan_fusion as a real process: telemetry, profiles and the scanner are published by the test over real DDS."""

import time
from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_srvs.srv import SetBool

from waam_msgs.msg import Anomaly, HeightMap, JobStatus, ProfileBatch, Telemetry
from waam_msgs.srv import BeginScan, FinishScan
from waam_node import testing_graph
from waam_node.conversions import floats, grid_to_msg, map_from_msg, seconds, time_to_msg
from waam_node.qos import EVENTS, LATCHED, PROFILES, SENSOR, TELEMETRY
from waam_process.grid import GridSpec

SPEC = GridSpec(0.0, 0.0, 1e-3, 20, 30)
NOISE = 20e-6
BEGIN, FINISH = BeginScan.Response, FinishScan.Response


def surface(x, y):
    """m, work frame"""
    return 5e-3 + 0.05 * x - 0.02 * y


class Cell(Node):
    """The rest of the graph: machine and scanner."""

    def __init__(self, context: Context, with_scanner: bool) -> None:
        super().__init__('test_cell', context=context)
        self.telemetry = self.create_publisher(Telemetry, 'telemetry', TELEMETRY)
        self.profiles = self.create_publisher(ProfileBatch, 'profiles', PROFILES)
        self.points = self.create_publisher(PointCloud2, 'points', SENSOR)
        self.maps, self.images, self.anomalies, self.values = [], [], [], {}
        self.enabled = []
        self.create_subscription(HeightMap, 'height_map', self.maps.append, LATCHED)
        self.create_subscription(Image, 'height_image', self.images.append, LATCHED)
        self.create_subscription(Anomaly, 'anomaly', self.anomalies.append, EVENTS)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, EVENTS)
        self.begin = self.create_client(BeginScan, 'scan_fusion/begin')
        self.finish = self.create_client(FinishScan, 'scan_fusion/finish')
        self.status = self.create_publisher(JobStatus, 'job_status', LATCHED)
        self.sequence = 0
        if with_scanner:
            self.create_service(SetBool, 'scanner/enable', self._on_enable)

    def _on_enable(self, request, response):
        self.enabled.append(request.data)
        response.success = True
        return response

    def _on_diagnostics(self, msg):
        self.values |= {v.key: v.value for v in msg.status[0].values}

    def send_pose(self, t: float, x: float) -> None:
        msg = Telemetry()
        msg.header.stamp = time_to_msg(t)
        msg.position.x, msg.position.y, msg.position.z = x - 0.060, 10e-3, 30e-3
        self.telemetry.publish(msg)

    def send_batch(self, t: float, x: np.ndarray, rng, cut: int = 0, points: int = 200) -> None:
        """Ten profiles 10 ms apart, scanner over x (10,)."""
        lateral = np.broadcast_to(np.linspace(-9e-3, 9e-3, points), (10, points))
        z = (
            surface(x[:, None], 10e-3 + lateral)
            - 30e-3
            - 0.120
            + rng.normal(0, NOISE, lateral.shape)
        )
        z[rng.random(z.shape) < 0.05] = np.nan
        msg = ProfileBatch(sensor_id='test', sequence=self.sequence, profile_count=10)
        self.sequence += 1
        msg.header.stamp, msg.header.frame_id = time_to_msg(t), 'scanner'
        msg.points_per_profile = points
        msg.stamp_offsets_ns = array('q', [i * 10_000_000 for i in range(10)])
        msg.x, msg.z = floats(lateral), floats(z.ravel()[: z.size - cut])
        self.profiles.publish(msg)


class Graph(testing_graph.Graph):
    """The node under test and the cell."""

    def __init__(self, with_scanner: bool = True, parameters: tuple = ()) -> None:
        super().__init__(lambda context: Cell(context, with_scanner))
        self.cell = cell = self.node
        self.clock = 0.0
        self.start('waam_scan', 'scan_fusion', *(a for p in parameters for a in ('-p', p)))
        self.wait(
            lambda: (
                cell.telemetry.get_subscription_count() and cell.profiles.get_subscription_count()
            )
        )

    def begin(self, job: str = 'a', layer: int = 0, keep: bool = False, spec: GridSpec = SPEC):
        grid = grid_to_msg(spec)
        return self.call(
            self.cell.begin, BeginScan.Request(job_id=job, layer=layer, grid=grid, keep=keep)
        )

    def finish(self, scan_id: int, until: float):
        return self.call(
            self.cell.finish, FinishScan.Request(scan_id=scan_id, until=time_to_msg(until))
        )

    def scan(self, seed=0, poses: bool = True, start: float = -3e-3) -> float:
        """4 s of scan in 10 ms steps over 40 mm, telemetry after the profiles; returns the time of its end."""
        rng, cell = np.random.default_rng(seed), self.cell
        t0 = max(time.time(), self.clock)
        self.clock = t0 + 4.1  # scans are faster than their stamps
        for k in range(40):
            x = start + 1e-3 * k + 1e-4 * np.arange(10)
            cell.send_batch(t0 + 0.1 * k, x, rng)
            if poses:
                for i in range(11 if k == 39 else 10):
                    cell.send_pose(t0 + 0.1 * k + 0.01 * i, start + 1e-3 * k + 1e-4 * i)
            self.executor.spin_once(timeout_sec=0)
        return t0 + 3.99


@pytest.fixture(scope='module')
def running():
    g = Graph()
    yield g
    g.close()


@pytest.fixture
def graph(running):
    """One node for all tests here; what former ones received is forgotten. Each test has jobs of its own."""
    cell = running.cell
    for received in (cell.maps, cell.images, cell.anomalies, cell.enabled, cell.values):
        received.clear()
    return running


def test_a_scan_becomes_a_map_that_is_returned_and_latched(graph):
    g = graph
    begun = g.begin(layer=3)
    assert begun.error_code == BEGIN.OK, begun.message
    assert g.cell.enabled == [True]
    until = g.scan()
    done = g.finish(begun.scan_id, until)
    assert done.error_code == FINISH.OK, done.message
    assert g.cell.enabled == [True, False]
    m = done.map
    assert (m.job_id, m.layer, m.scan_id, m.header.frame_id) == ('a', 3, 0, 'work')
    assert m.plausible, list(m.reasons)
    assert m.profiles_used == 400 and m.profiles_rejected == 0
    assert abs(seconds(m.header.stamp) - until) < 1e-3
    z = map_from_msg(m.z, SPEC)
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    known = np.isfinite(z)
    assert known[2:-2].all() and not known[0].any(), 'the field of view covers rows 1 to 18'
    assert np.sqrt(np.nanmean((z - surface(x, y)) ** 2)) < 15e-6
    assert m.points_used + m.points_rejected == 400 * 200
    g.wait(lambda: g.cell.maps and g.cell.images)
    assert g.cell.maps[0].z.tobytes() == m.z.tobytes()
    image = g.cell.images[0]
    assert (image.encoding, image.height, image.width) == ('32FC1', 20, 30)
    g.wait(lambda: 'map_latency_ms' in g.cell.values)
    assert 0 < float(g.cell.values['map_latency_ms']) < 2000
    assert float(g.cell.values['sigma_mm']) < 0.02
    assert {'holes', 'unseen', 'steep_cells', 'edge_cells', 'longest_pause_s'} <= set(g.cell.values)


def test_a_second_layer_is_compared_and_keep_merges(graph):
    g = graph
    first = g.begin('two')
    assert g.finish(first.scan_id, g.scan()).map.plausible
    second = g.begin('two', 1)
    assert second.scan_id == first.scan_id + 1
    half = g.finish(second.scan_id, g.scan(start=18e-3)).map
    assert not half.plausible, 'half of the grid is missing that was there before'
    third = g.begin('two', 1, keep=True)
    both = g.finish(third.scan_id, g.scan(seed=1, start=-20e-3)).map
    assert both.coverage > half.coverage + 0.2
    assert both.plausible, list(both.reasons)
    other = g.begin('two', keep=True, spec=GridSpec(0.0, 0.0, 2e-3, 10, 10))
    assert other.error_code == BEGIN.BAD_GRID


def test_profiles_without_telemetry_give_no_map_but_a_reason(graph):
    g = graph
    begun = g.begin('blind')
    done = g.finish(begun.scan_id, g.scan(poses=False))
    assert done.error_code == FINISH.EMPTY
    assert 'telemetry' in done.message
    begun = g.begin('blind')
    done = g.finish(begun.scan_id, time.time())
    assert done.error_code == FINISH.EMPTY and 'no profiles' in done.message
    g.wait(lambda: len(g.cell.anomalies) >= 2)
    assert not g.cell.maps


def test_malformed_batches_are_refused_counted_and_said(graph):
    g = graph
    g.wait(lambda: g.cell.points.get_subscription_count())
    begun = g.begin('malformed')
    flat = PointCloud2(height=1, width=1, point_step=4, row_step=4, data=array('B', bytes(4)))
    flat.header.frame_id = 'scanner'
    flat.fields = [PointField(name='range', offset=0, datatype=PointField.FLOAT32, count=1)]

    def said():
        g.cell.points.publish(flat)  # of warnings there is one a second
        return g.cell.anomalies

    g.wait(said)
    assert 'no field x and z (it has range)' in g.cell.anomalies[0].text
    time.sleep(1.0)
    g.cell.send_batch(time.time(), np.zeros(10), np.random.default_rng(0), cut=7)
    until = g.scan()
    done = g.finish(begun.scan_id, until)
    assert done.error_code == FINISH.OK
    g.wait(lambda: len(g.cell.anomalies) > 1 and int(g.cell.values.get('refused_batches', 0)) > 1)
    anomaly = g.cell.anomalies[1]
    assert anomaly.class_name == 'scan' and 'z has 1993 values' in anomaly.text


@pytest.fixture
def without_scanner():
    g = Graph(False, ('scanner_wait:=0.3',))
    yield g
    g.close()


def test_no_scanner_bad_grid_and_no_scan_are_answered(without_scanner):
    g = without_scanner
    bad = BeginScan.Request(job_id='a')
    answer = g.call(g.cell.begin, bad)
    assert answer.error_code == BEGIN.BAD_GRID and 'resolution' in answer.message
    waiting = g.cell.begin.call_async(BeginScan.Request(job_id='a', grid=grid_to_msg(SPEC)))
    busy = g.begin()
    assert busy.error_code == BEGIN.BUSY, 'a begin that waits does not block the node'
    g.wait(waiting.done)
    assert waiting.result().error_code == BEGIN.NO_SCANNER
    message = waiting.result().message
    assert 'nothing comes on `points`' in message and 'scanner/enable is not there' in message
    nothing = g.finish(0, time.time())
    assert nothing.error_code == FINISH.NO_SCAN


def test_a_scan_ends_with_its_job_and_a_late_request_of_that_job_begins_none(graph):
    """Its client may have given the request up, or died."""
    g = graph
    g.wait(lambda: g.cell.status.get_subscription_count() > 0)
    g.cell.status.publish(JobStatus(job_id='ends', state=JobStatus.SCANNING))
    begun = g.begin('ends.r2')
    assert begun.error_code == BEGIN.OK and g.cell.enabled == [True]
    g.cell.status.publish(JobStatus(job_id='ends', state=JobStatus.FAILED))
    g.wait(lambda: g.cell.enabled == [True, False])
    assert g.finish(begun.scan_id, time.time()).error_code == FINISH.NO_SCAN
    late = g.begin('ends.r2')
    assert late.error_code == BEGIN.BUSY and 'ends has ended' in late.message
    assert g.cell.enabled == [True, False]
    assert g.begin('b').error_code == BEGIN.OK, 'the next job'


def test_an_unknown_parameter_is_refused_by_name():
    g = testing_graph.Graph()
    assert g.start('waam_scan', 'scan_fusion', '-p', 'cel:=1.0').wait(30) == 2
    assert "unknown parameter 'cel'" in g.close()
