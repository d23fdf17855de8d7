"""The three nodes as real processes over real DDS."""

import dataclasses
import math
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Temperature

from waam_adapt.conversions import bead_paths, correction_input, next_thickness, ratio_high
from waam_adapt.feed.params import FeedParams
from waam_adapt.laws.corrector import CorrectionParams
from waam_adapt.process_control.params import ProcessControlParams
from waam_adapt.thermal.params import ThermalParams
from waam_msgs.msg import (
    CorrectionMap,
    HeatFactor,
    JobStatus,
    LayerReport,
    NextLayer,
    ProcessEstimate,
    Segment,
)
from waam_msgs.srv import ComputeCorrection, ComputeFeed
from waam_node import qos
from waam_node.conversions import floats, grid_to_msg, map_from_msg, paths_to_msg, time_to_msg
from waam_node.params import markdown
from waam_node.testing_graph import Graph
from waam_process.grid import GridSpec
from waam_process.learned import nothing, parse

CONFIGS = {
    'correction_server': CorrectionParams,
    'feed_forward': FeedParams,
    'process_control': ProcessControlParams,
    'thermal_compensator': ThermalParams,
}
SPEC = GridSpec(0.0, 0.0, 0.5e-3, 80, 120)
HOLLOW = (slice(30, 50), slice(50, 70))


@pytest.fixture(scope='module')
def graph():
    g = Graph()
    for name in CONFIGS:
        config = f'{get_package_share_directory("waam_adapt")}/config/{name}.yaml'
        g.start('waam_adapt', name, '--params-file', config)
    yield g
    g.close()


@pytest.fixture(scope='module')
def correct(graph):
    client = graph.node.create_client(ComputeCorrection, 'correction_server/compute')
    return lambda request: graph.call(client, request)


@pytest.fixture(scope='module')
def feed(graph):
    client = graph.node.create_client(ComputeFeed, 'feed_forward/compute')
    return lambda request: graph.call(client, request)


def latched(graph, kind, topic):
    """The newest message that the test has received on a latched topic, in a list."""
    got = []
    graph.node.create_subscription(kind, topic, got.append, qos.LATCHED)
    return got


def request_with_hollow(graph, layer=1, spec=SPEC, hollow=HOLLOW, job='a'):
    z = np.zeros(spec.shape)
    z[hollow] = -0.4e-3
    inside = np.zeros(spec.shape, bool)
    inside[8:-8, 8:-8] = True
    r = ComputeCorrection.Request(job_id=job, layer=layer, bead_width=6e-3, temperature=20.0)
    r.map.header.stamp = graph.node.get_clock().now().to_msg()
    r.map.header.frame_id = 'work'
    r.map.job_id, r.map.layer, r.map.plausible = job, layer - 1, True
    r.map.grid = grid_to_msg(spec)
    r.map.z, r.map.sigma = floats(z), floats(np.full(spec.shape, 2e-5))
    r.target = floats(np.where(inside, 0.0, np.nan))
    r.planned_height = floats(np.where(inside, 2e-3, 0.0))
    r.k_gain = math.nan
    r.direction.x = 1.0
    return r


def segments(y=20e-3, n=10):
    out = []
    for i in range(n):
        s = Segment(index=i, layer=1, bead=1, kind=Segment.DEPOSIT, arc=True)
        s.start.x, s.end.x = (10 + 4 * i) * 1e-3, (14 + 4 * i) * 1e-3
        s.start.y = s.end.y = y
        s.tool_axis.z = 1.0
        s.height, s.width, s.speed = 2e-3, 6e-3, 10e-3
        out.append(s)
    return out


@pytest.mark.parametrize('name', CONFIGS)
def test_parameter_files_list_every_parameter_with_its_default(name):
    path = f'{get_package_share_directory("waam_adapt")}/config/{name}.yaml'
    values = yaml.safe_load(Path(path).read_text())[f'/**/{name}']['ros__parameters']
    defaults = {f.name: f.default for f in dataclasses.fields(CONFIGS[name])}
    assert list(values) == list(defaults)
    for key, value in defaults.items():
        assert values[key] == pytest.approx(value, nan_ok=True), key


def test_hollow_gets_a_slower_torch_and_the_answer_is_published(graph, correct):
    maps = latched(graph, CorrectionMap, 'correction_map')
    estimates = latched(graph, ProcessEstimate, 'process_estimate')
    before = time.monotonic()
    answer = correct(request_with_hollow(graph))
    waited = time.monotonic() - before
    assert answer.error_code == ComputeCorrection.Response.OK, answer.message
    psi = map_from_msg(answer.correction.psi, SPEC)
    assert psi[40, 60] < -0.3
    assert abs(psi[40, 15]) < 0.05
    assert not answer.correction.fallback
    assert answer.correction.k_gain == pytest.approx(0.3)
    assert 0 < answer.correction.latency < waited
    low, high = answer.correction.expected_rms_low, answer.correction.expected_rms_high
    assert 1e-6 < low < answer.correction.expected_rms < high < 5e-3
    graph.wait(lambda: maps and estimates, what='latched answers')
    assert list(maps[-1].psi) == list(answer.correction.psi)
    assert estimates[-1].efficiency_ratio == 1.0


def test_efficiency_is_learned_from_the_last_layer(graph, correct):
    before = np.zeros(SPEC.shape)
    r = request_with_hollow(graph, layer=2, hollow=(slice(0), slice(0)), job='learn')
    r.previous_surface = floats(before - 1.7e-3)
    r.previous_growth = floats(np.where(np.frombuffer(r.planned_height, 'f4') > 0, 2e-3, np.nan))
    answer = correct(r)
    assert answer.correction.flow_factor == pytest.approx(1 / 0.85, abs=0.01)
    assert answer.learned == ''  # nothing was told of former jobs
    r.learned = nothing('mill', 'er70s-6', 'w600_h200').text()
    taught = parse(correct(r).learned)
    assert taught.jobs == 1 and taught.last_job == 'learn'
    assert taught.efficiency == pytest.approx(0.85, abs=0.01)
    r.previous_feed_factor = 1.7 / 2 / 0.85 * 1.2  # the feed was 1.2 times the table's
    again = correct(r)  # the same layer again replaces its evidence
    assert again.correction.flow_factor == pytest.approx(1.2 / 0.85, abs=0.02)


@pytest.mark.parametrize(
    ('spoil', 'word'),
    [
        (lambda r: setattr(r.map, 'plausible', False), 'implausible'),
        (lambda r: setattr(r.map, 'layer', 3), 'stale'),
        (lambda r: setattr(r.map, 'job_id', 'other'), 'stale'),
        (lambda r: setattr(r.map.header, 'stamp', time_to_msg(100.0)), 'stale'),
        (lambda r: setattr(r.map, 'z', floats(np.full(SPEC.shape, np.nan))), 'partial'),
        (lambda r: setattr(r.map, 'z', floats(np.full(SPEC.shape, 0.01))), 'implausible'),
        (lambda r: setattr(r.map, 'sigma', floats(np.full(SPEC.shape, 1e-3))), 'uncertain'),
    ],
)
def test_a_map_that_is_not_to_be_trusted_removes_the_correction(graph, correct, spoil, word):
    r = request_with_hollow(graph)
    spoil(r)
    c = correct(r).correction
    assert c.fallback
    assert any(reason.startswith(word) for reason in c.reasons), c.reasons
    assert not np.any(c.psi)
    assert not np.any(c.residual_height)


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('bead_width', math.nan), ('bead_width', 0.0), ('k_gain', 0.5), ('k_gain', math.inf),
        ('layer', 0), ('temperature', math.inf), ('previous_feed_factor', -1.0),
        ('ratio_high', 0.5), ('ratio_high', math.inf), ('next_thickness', -1e-3), ('next_thickness', 1.0),
        ('target', floats(np.zeros(3))), ('planned_height', floats(np.full(SPEC.shape, -1e-3))),
        ('previous_surface', floats(np.zeros(3))), ('learned', '{"kind": "waam learned"}'),
    ],
)  # fmt: skip
def test_bad_request_is_refused_naming_the_field(graph, correct, field, value):
    r = request_with_hollow(graph)
    setattr(r, field, value)
    answer = correct(r)
    assert answer.error_code == ComputeCorrection.Response.BAD_INPUT
    assert field.split('_')[0] in answer.message


def test_beads_reach_the_law_from_the_corner_of_the_map(graph):
    r = request_with_hollow(graph)
    r.paths = paths_to_msg([np.array([[0.01, 0.02], [0.03, 0.02]])])
    corner = np.array([SPEC.origin_x, SPEC.origin_y])
    (path,) = correction_input(r, SPEC, 0.3, 0.3).paths
    assert path + corner == pytest.approx(np.array([[0.01, 0.02], [0.03, 0.02]]))


def test_an_announced_layer_is_prepared_and_a_wrong_one_does_no_harm(graph, correct):
    """Announced: the same answer. Announced without its metal: the request itself is still answered."""
    counts, job = [], f'announced{time.monotonic_ns()}'

    def on_diagnostics(array: DiagnosticArray) -> None:
        for status in array.status:
            counts.extend(int(v.value) for v in status.values if v.key == 'prepared')

    graph.node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, qos.EVENTS)
    publisher = graph.node.create_publisher(NextLayer, 'next_layer', qos.LATCHED)
    r = request_with_hollow(graph, job=job)
    r.paths = paths_to_msg([np.array([[0.01, 0.02], [0.05, 0.02]])])
    unknown = correct(r)
    coming = NextLayer(
        job_id=job, layer=1, grid=r.map.grid, planned_height=r.planned_height,
        bead_width=r.bead_width, direction=r.direction, paths=r.paths,
    )  # fmt: skip
    graph.wait(lambda: publisher.get_subscription_count() and counts, what='server')
    before = counts[-1]
    publisher.publish(coming)
    graph.wait(lambda: counts[-1] == before + 1, what='the layer is prepared')
    prepared = correct(r)
    assert prepared.error_code == ComputeCorrection.Response.OK
    assert any(prepared.correction.psi)
    assert list(prepared.correction.psi) == list(unknown.correction.psi)
    coming.planned_height = floats(np.zeros(7))
    publisher.publish(coming)
    assert correct(r).error_code == ComputeCorrection.Response.OK


def test_paths_whose_lengths_do_not_fit_are_refused(graph, correct):
    r = request_with_hollow(graph)
    r.paths = paths_to_msg([np.array([[0.01, 0.02], [0.03, 0.02]])])
    r.paths.points[0] = 3
    answer = correct(r)
    assert answer.error_code == ComputeCorrection.Response.BAD_INPUT
    assert answer.message == 'paths: 2 x and 2 y for paths of 3 points'


def test_a_record_of_before_tells_a_polygon_for_each_bead():
    points = [SimpleNamespace(x=0.01, y=0.02), SimpleNamespace(x=0.03, y=0.02)]
    old = SimpleNamespace(beads=[SimpleNamespace(points=points)])
    (path,) = bead_paths(old, SPEC)
    assert path.tolist() == [[0.01, 0.02], [0.03, 0.02]]
    assert ratio_high(old) == next_thickness(old) == 0.0


@pytest.mark.parametrize('points', [[], [(0.0, 0.0)], [(0.0, 0.0), (math.nan, 0.0)]])
def test_a_bead_that_is_no_line_is_refused_by_its_number(graph, correct, points):
    r = request_with_hollow(graph)
    r.paths = paths_to_msg([np.array([[0.0, 0.0], [0.01, 0.0]]), np.reshape(points, (-1, 2))])
    answer = correct(r)
    assert answer.error_code == ComputeCorrection.Response.BAD_INPUT
    assert 'paths[1]' in answer.message


def test_correction_and_feed_together_lay_what_is_missing(graph, correct, feed):
    correction = correct(request_with_hollow(graph)).correction
    r = ComputeFeed.Request(material='er70s-6', apply_correction=True, heat_factor=1.0)
    r.segments, r.correction = segments(), correction
    answer = feed(r)
    assert answer.error_code == ComputeFeed.Response.OK, answer.message
    over = min(answer.segments, key=lambda s: abs(s.start.x - 28e-3))  # the hollow is at x 25..35
    away = answer.segments[0]
    assert over.psi < -0.3
    assert over.speed == pytest.approx(10e-3 * (1 + over.k_gain * over.psi))
    assert over.wire_feed_speed == pytest.approx(over.wire_feed_base, rel=1e-6)
    assert away.speed == pytest.approx(10e-3, rel=0.02)
    assert away.speed_programmed == 10e-3
    assert away.voltage == 22.0


def test_monitor_records_the_terms_and_leaves_the_setpoints(graph, correct, feed):
    correction = correct(request_with_hollow(graph)).correction
    correction.flow_factor = 1.1
    r = ComputeFeed.Request(material='er70s-6', apply_correction=False, heat_factor=0.9)
    r.segments, r.correction = segments(), correction
    for s in feed(r).segments:
        assert s.speed == 10e-3
        assert s.flow_factor == 1.0
        assert s.wire_feed_speed == pytest.approx(0.9 * s.wire_feed_base)
    assert min(s.psi for s in feed(r).segments) < -0.3


@pytest.mark.parametrize(
    ('change', 'code', 'word'),
    [
        (lambda r: setattr(r, 'material', 'cheese'), ComputeFeed.Response.UNKNOWN_MATERIAL, 'cheese'),
        (lambda r: setattr(r, 'heat_factor', math.nan), ComputeFeed.Response.BAD_INPUT, 'heat_factor'),
        (lambda r: setattr(r.segments[3], 'height', math.nan), ComputeFeed.Response.BAD_SEGMENT,
         'segment 3: height'),
        (lambda r: setattr(r.segments[3], 'speed', 0.0), ComputeFeed.Response.BAD_SEGMENT,
         'segment 3: speed'),
        (lambda r: setattr(r.segments[3], 'kind', 9), ComputeFeed.Response.BAD_SEGMENT,
         'segment 3: kind'),
        (lambda r: setattr(r.correction, 'psi', floats(np.full(SPEC.shape, np.nan))),
         ComputeFeed.Response.BAD_INPUT, 'psi'),
    ],
)  # fmt: skip
def test_bad_feed_request_is_refused_naming_the_field(graph, feed, change, code, word):
    r = ComputeFeed.Request(material='er70s-6', apply_correction=True, heat_factor=1.0)
    r.segments = segments()
    r.correction.grid = grid_to_msg(SPEC)
    r.correction.psi = r.correction.residual_height = floats(np.zeros(SPEC.shape))
    r.correction.flow_factor = 1.0
    change(r)
    answer = feed(r)
    assert answer.error_code == code
    assert word in answer.message


def test_heat_factor_follows_the_pyrometer_and_drops_it_when_silent(graph):
    """Of a stock driver: best effort."""
    got = latched(graph, HeatFactor, 'heat_factor')
    publisher = graph.node.create_publisher(Temperature, 'temperature', qos_profile_sensor_data)
    graph.wait(lambda: publisher.get_subscription_count() == 1, what='thermal_compensator')
    graph.wait(lambda: got and not got[-1].plausible, what='not plausible before any sample')
    assert not got[-1].ready
    sent = [0.0]

    def cool_down():
        now = graph.node.get_clock().now()
        if now.nanoseconds * 1e-9 - sent[0] > 0.05:
            sent[0] = now.nanoseconds * 1e-9
            sample = Temperature(temperature=300.0 - 2 * (sent[0] - begin))
            sample.header.stamp = now.to_msg()
            publisher.publish(sample)
        return got[-1].plausible and got[-1].estimated_wait > 0

    begin = graph.node.get_clock().now().nanoseconds * 1e-9
    graph.wait(cool_down, what='hot and cooling')
    hot = got[-1]
    assert not hot.ready
    assert hot.factor == pytest.approx(1 - 7.5e-4 * (hot.temperature - 200), abs=1e-4)
    assert hot.temperature_rate == pytest.approx(-2.0, abs=0.5)
    graph.wait(lambda: not got[-1].plausible, what='silence noticed')
    assert not got[-1].ready
    assert got[-1].factor == 1.0
    assert 'silent' in got[-1].reasons[0]


class Spot:
    """A pyrometer at 20 Hz of real time that reads `value` degC."""

    def __init__(self, graph, value):
        self.graph, self.value, self.sent = graph, value, 0.0
        self.publisher = graph.node.create_publisher(Temperature, 'temperature', qos.BEAT)
        self.rng = np.random.default_rng(1)

    def now(self):
        return self.graph.node.get_clock().now()

    def until(self, condition, what):
        def step():
            now = self.now()
            if now.nanoseconds * 1e-9 - self.sent > 0.05:
                self.sent = now.nanoseconds * 1e-9
                sample = Temperature(temperature=self.value + self.rng.normal(0, 0.3))
                sample.header.stamp = now.to_msg()
                self.publisher.publish(sample)
            return condition()

        self.graph.wait(step, what=what)


@pytest.fixture
def jobs(graph):
    """Publishes job_status of a job; at the end the material is the default again."""
    publisher = graph.node.create_publisher(JobStatus, 'job_status', qos.LATCHED)
    graph.wait(lambda: publisher.get_subscription_count() == 1, what='thermal_compensator')

    def say(state, material, layer=0):
        publisher.publish(
            JobStatus(job_id='job', state=state, material=material, pass_number=1, layer=layer)
        )

    yield say
    say(JobStatus.PREPARING, 'er70s-6')
    graph.settle()
    graph.node.destroy_publisher(publisher)


def test_the_material_of_the_job_decides_the_interpass_limit(graph, jobs):
    """180 degC: er70s-6 may go on (250), 316l may not (150)."""
    got = latched(graph, HeatFactor, 'heat_factor')
    spot = Spot(graph, 180.0)
    spot.until(lambda: got and got[-1].ready and got[-1].material == 'er70s-6', 'ready as er70s-6')
    assert got[-1].interpass_limit == 250.0
    jobs(JobStatus.PREPARING, '316l')
    spot.until(lambda: got[-1].material == '316l' and got[-1].plausible, '316l')
    assert got[-1].interpass_limit == 150.0
    assert not got[-1].ready
    jobs(JobStatus.PREPARING, 'unobtainium')
    spot.until(lambda: got[-1].material == 'unobtainium', 'unknown material')
    assert not got[-1].ready
    assert "unknown material 'unobtainium'" in got[-1].reasons[0]


def test_a_temperature_that_does_not_answer_to_a_layer_is_told(graph, jobs):
    got = latched(graph, HeatFactor, 'heat_factor')
    reports = graph.node.create_publisher(LayerReport, 'layer_report', qos.EVENTS)
    graph.wait(lambda: reports.get_subscription_count() == 1, what='thermal_compensator')
    spot = Spot(graph, 21.0)
    jobs(JobStatus.PREPARING, 'er70s-6')
    spot.until(lambda: got and got[-1].plausible and got[-1].temperature < 25, 'cold')
    assert got[-1].believed
    jobs(JobStatus.DEPOSITING, 'er70s-6', layer=1)
    begin = spot.now().nanoseconds
    spot.until(lambda: spot.now().nanoseconds - begin > 1e9, 'a layer of one second')
    report = LayerReport(
        job_id='job', layer=1, energy=180e3, arc_on_time=60.0, travel_speed_mean=0.01
    )
    report.header.stamp = spot.now().to_msg()
    reports.publish(report)
    spot.until(lambda: not got[-1].believed, 'doubt')
    assert got[-1].plausible
    assert 'layer 1 brought 144 kJ' in got[-1].doubt
    jobs(JobStatus.PREPARING, 'er70s-6')
    spot.until(lambda: got[-1].believed, 'a new job begins without doubt')


def test_unknown_parameter_is_refused_by_name():
    g = Graph()
    try:
        process = g.start('waam_adapt', 'correction_server', '-p', 'gian:=0.5')
        assert process.wait(120) == 2
        assert "unknown parameter 'gian'; did you mean 'gain'" in g.said()
    finally:
        g.close()


def test_readme_shows_the_parameters_as_they_are():
    readme = (Path(__file__).parents[1] / 'README.md').read_text()
    for params in CONFIGS.values():
        assert markdown(params) in readme
