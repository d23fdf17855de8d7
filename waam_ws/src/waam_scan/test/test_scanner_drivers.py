"""scan_fusion with stock-like drivers over real DDS: no scanner/enable, best effort, bursts, LaserScan."""

import time
from array import array
from functools import partial

import numpy as np
import pytest
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from test_scan_fusion_node import BEGIN, FINISH, NOISE, SPEC, Graph, surface

from waam_msgs.msg import ProfileBatch
from waam_msgs.srv import BeginScan, FinishScan
from waam_node.conversions import floats, grid_to_msg, map_from_msg, nanoseconds, time_to_msg

FIRST, APART = (
    float(np.float32(-0.08)),
    float(np.float32(0.0008)),
)  # rad, as a LaserScan can have them
ANGLES = FIRST + APART * np.arange(200)
COUNT, BURST = 400, 50  # profiles; of a burst
STEP = 0.01  # s between profiles
BIG = QoSProfile(depth=1000)


def ranges(x: float, rng) -> np.ndarray:
    """(200,) m from the scanner over x to the surface along its rays, 5 % without return."""
    level = surface(x, 10e-3) - 150e-3
    r = -level / (np.cos(ANGLES) - 0.02 * np.sin(ANGLES)) + rng.normal(0, NOISE, len(ANGLES))
    r[rng.random(len(r)) < 0.05] = np.inf
    return r.astype(np.float32)


def profile(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x, z float32 m of ranges, scanner frame with z up; NaN = no return."""
    r = np.where(np.isfinite(r), r, np.nan).astype(float)
    return (r * np.sin(ANGLES)).astype(np.float32), (-r * np.cos(ANGLES)).astype(np.float32)


def cloud(t: float, r: np.ndarray, frame: str = 'scanner') -> PointCloud2:
    x, z = profile(r)
    points = np.zeros((len(r), 4), np.float32)
    points[:, 0], points[:, 2], points[:, 3] = x, np.where(np.isfinite(z), -z, np.inf), 500.0
    msg = PointCloud2(height=1, width=len(r), point_step=16, row_step=16 * len(r))
    msg.header.stamp, msg.header.frame_id = time_to_msg(t), frame
    msg.fields = [
        PointField(name=n, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, n in enumerate(('x', 'y', 'z', 'intensity'))
    ]
    msg.data = array('B', points.tobytes())
    return msg


def laser_scan(t: float, r: np.ndarray) -> LaserScan:
    msg = LaserScan(angle_min=FIRST, angle_max=float(ANGLES[-1]), angle_increment=APART)
    msg.header.stamp, msg.header.frame_id = time_to_msg(t), 'scanner'
    msg.range_min, msg.range_max, msg.scan_time = 0.05, 0.5, STEP
    msg.ranges, msg.intensities = floats(r), floats(np.full(len(r), 500.0))
    return msg


def batch(t: float, r: np.ndarray) -> ProfileBatch:
    """r: (n, 200) m"""
    x, z = profile(r)
    msg = ProfileBatch(profile_count=len(r), points_per_profile=len(ANGLES))
    msg.x, msg.z = floats(x), floats(z)
    stamps = [nanoseconds(time_to_msg(t + STEP * i)) for i in range(len(r))]
    msg.header.stamp = time_to_msg(t)
    msg.stamp_offsets_ns = array('q', [s - stamps[0] for s in stamps])
    batch.number = msg.sequence = getattr(batch, 'number', 0) + 1
    return msg


class Driver:
    """Measures always; its messages leave in bursts. Scans are faster than their stamps."""

    clock = 0.0  # s, newest stamp of all drivers

    def __init__(self, g: Graph, kind: type, topic: str, make, qos) -> None:
        self.g, self.make = g, make
        self.publisher = g.cell.create_publisher(kind, topic, qos)
        g.wait(lambda: self.publisher.get_subscription_count() > 0, 20)
        g.executor.spin_once(timeout_sec=0.5)  # the reader knows the writer, too

    def send(self, t: float, rows: list[np.ndarray]) -> None:
        """Profiles from t on, STEP apart."""
        Driver.clock = t + STEP * len(rows)
        if self.make is batch:
            self.publisher.publish(batch(t, np.array(rows)))
        else:
            for i, r in enumerate(rows):
                self.publisher.publish(self.make(t + STEP * i, r))

    def begin(self):
        """Answer to a begin, while the scanner stands still. Telemetry comes later, so that none of this is used."""
        g, rng = self.g, np.random.default_rng(9)
        future = g.cell.begin.call_async(
            BeginScan.Request(job_id="drivers", grid=grid_to_msg(SPEC))
        )
        while not future.done():
            self.send(max(time.time(), Driver.clock), [ranges(-3e-3, rng)])
            time.sleep(STEP)
            g.executor.spin_once(timeout_sec=0)
        return future.result()

    def scan(self):
        """Answer to the finish of a whole scan of 40 mm; the scanner goes on afterwards."""
        begun, g = self.begin(), self.g
        assert begun.error_code == BEGIN.OK, begun.message
        rng, t0 = np.random.default_rng(0), Driver.clock + 0.05
        for k in range(0, COUNT, BURST):
            places = range(k, k + BURST)
            self.send(t0 + STEP * k, [ranges(-3e-3 + 1e-4 * i, rng) for i in places])
            for i in places:
                g.cell.send_pose(t0 + STEP * i, -3e-3 + 1e-4 * i)
            g.executor.spin_once(timeout_sec=0.02)
        until = t0 + STEP * (COUNT - 1)
        future = g.cell.finish.call_async(
            FinishScan.Request(scan_id=begun.scan_id, until=time_to_msg(until))
        )
        for i in range(COUNT, 3000):
            self.send(t0 + STEP * i, [ranges(37e-3, rng)])
            if i % 7 == 0:
                g.cell.send_pose(t0 + STEP * i, 37e-3)
            g.executor.spin_once(timeout_sec=1e-3)
            if future.done():
                return future.result()
        pytest.fail('a scanner that never stops keeps its scan from ending')


@pytest.fixture(scope='module')
def graph():
    g = Graph(with_scanner=False)
    yield g
    g.close()


@pytest.fixture(scope='module')
def reference(graph):
    """The map of the project's own profiles."""
    done = Driver(graph, ProfileBatch, 'profiles', batch, BIG).scan()
    assert done.error_code == FINISH.OK, done.message
    assert done.map.profiles_used >= COUNT and done.map.plausible, list(done.map.reasons)
    z = map_from_msg(done.map.z, SPEC)
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    assert np.isfinite(z).mean() > 0.8 and np.nanmax(np.abs(z - surface(x, y))) < 60e-6
    return z


@pytest.mark.parametrize(
    'kind,topic,make,qos',
    [
        (PointCloud2, 'points', cloud, qos_profile_sensor_data),
        (PointCloud2, 'points', cloud, BIG),
        (LaserScan, 'scan', laser_scan, qos_profile_sensor_data),
        (ProfileBatch, 'profiles', batch, qos_profile_sensor_data),
    ],
)  # fmt: skip
def test_a_driver_without_enable_gives_the_same_map(graph, reference, kind, topic, make, qos):
    """Fifty messages at once, none of them lost."""
    driver = Driver(graph, kind, topic, make, qos)
    try:
        done = driver.scan()
    finally:
        graph.cell.destroy_publisher(driver.publisher)
    assert done.error_code == FINISH.OK, done.message
    m = done.map
    assert m.plausible and COUNT <= m.profiles_used < COUNT + 100, list(m.reasons)
    assert not [r for r in m.reasons if 'lost' in r or 'quiet' in r]
    z = map_from_msg(m.z, SPEC)
    both = np.isfinite(z) & np.isfinite(reference)
    assert np.array_equal(np.isfinite(z), np.isfinite(reference))
    apart = np.abs(z - reference)[:, :-2][
        both[:, :-2]
    ]  # at its end it stands for as long as the answer takes
    print(
        f'{topic}: {m.profiles_used} used, median {np.median(apart)}, max {apart.max()} {list(m.reasons)}'
    )
    assert apart.max() < 1e-6  # m


def test_another_frame_is_refused_by_name_and_does_not_count_against_the_map(graph, reference):
    """A safety scanner on the same topic: no scanner by itself, no harm beside one."""
    g = graph
    stranger = Driver(g, PointCloud2, 'points', partial(cloud, frame='safety'), BIG)
    refused = stranger.begin()
    assert refused.error_code == BEGIN.NO_SCANNER
    assert "`points` is in frame 'safety', not 'scanner'" in refused.message
    assert 'nothing comes on `points`' in refused.message
    timer = g.cell.create_timer(
        0.01, lambda: stranger.publisher.publish(cloud(Driver.clock, np.ones(200), 'safety'))
    )
    driver = Driver(g, PointCloud2, 'points', cloud, BIG)
    try:
        done = driver.scan()
    finally:
        g.cell.destroy_timer(timer)
        for d in (stranger, driver):
            g.cell.destroy_publisher(d.publisher)
    assert done.error_code == FINISH.OK and done.map.plausible, list(done.map.reasons)
    assert "in frame 'safety'" in g.cell.anomalies[-1].text
    assert np.array_equal(map_from_msg(done.map.z, SPEC)[:, :-2], reference[:, :-2], equal_nan=True)


def test_a_scanner_with_a_clock_of_its_own_is_told_at_once(graph):
    driver = Driver(graph, LaserScan, 'scan', lambda t, r: laser_scan(t - 1e6, r), BIG)
    try:
        refused = driver.begin()
    finally:
        graph.cell.destroy_publisher(driver.publisher)
    assert refused.error_code == BEGIN.NO_SCANNER
    assert 'profiles from before the scan began' in refused.message
