"""The node as a real process against a fake controller: clock, temperature, profiles, services, reconnection."""

from __future__ import annotations

import time

import numpy as np
import pytest
from geometry_msgs.msg import Point, PointStamped, Vector3
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from waam_msgs.msg import JobStatus, ProfileBatch
from waam_msgs.srv import InjectFault, LoadPart
from waam_node.conversions import nanoseconds
from waam_node.qos import LATCHED
from waam_node.testing_graph import Graph
from waam_process.grid import HeightGrid


class Observer(Graph):
    """A node of the test's own that listens to everything the cell says."""

    def __init__(self) -> None:
        super().__init__()
        self.seen = {'/clock': [], 'temperature': [], 'profiles': []}
        qos = QoSProfile(depth=500, reliability=ReliabilityPolicy.RELIABLE)
        for name, kind in (
            ('/clock', Clock),
            ('temperature', Temperature),
            ('profiles', ProfileBatch),
        ):
            self.node.create_subscription(kind, name, self.seen[name].append, qos)

    def until(self, condition, timeout=60.0) -> bool:
        return self.reached(condition, timeout)

    def ask(self, kind, name, **fields):
        client = self.node.create_client(kind, name)
        answer = self.call(client, kind.Request(**fields))
        self.node.destroy_client(client)
        return answer


@pytest.fixture
def cell(controller, tmp_path):
    observer = Observer()
    words = (f'plant_socket:={controller.path}', f'truth_dir:={tmp_path}', 'seed:=3')
    process = observer.start('waam_sim', 'cell', *(a for w in words for a in ('-p', w)))
    controller.accept()
    yield process, observer, controller
    observer.close()


def test_a_job_in_small(cell, tmp_path):
    process, observer, controller = cell
    seen = observer.seen
    loaded = observer.ask(
        LoadPart, 'cell/load_part', plate=Vector3(x=0.05, y=0.03, z=0.01), seed=-1
    )
    assert loaded.success, loaded.message

    def discovered() -> bool:
        controller.run((0.01, 0.015, 0.01), 0.1)
        return bool(seen['/clock'] and seen['temperature'])

    assert observer.until(discovered)
    controller.run((0.01, 0.015, 0.01), 0.4, wire=5 / 60, voltage=22.0, outputs=3)
    answers = controller.run((0.04, 0.015, 0.01), 3.0, wire=5 / 60, voltage=22.0, outputs=3)
    assert all(a[0] == 0x57414D41 for a in answers)
    assert 80 < np.median([a[2] for a in answers]) < 160
    assert answers[-1][1] == 2 and answers[-1][4] == pytest.approx(5 / 60, rel=0.02)
    assert observer.until(lambda: len(seen['/clock']) >= 50)
    stamps = np.array([nanoseconds(c.clock) for c in seen['/clock']])
    assert (np.diff(stamps) > 0).all() and np.median(np.diff(stamps)) == 50_000_000
    assert stamps[-1] <= controller.time_us * 1000
    assert observer.until(lambda: len(seen['temperature']) >= 25)
    assert max(t.temperature for t in seen['temperature']) > 40.0
    assert not seen['profiles'], 'profiles come only while the scanner is enabled'

    assert observer.ask(SetBool, 'scanner/enable', data=True).success
    controller.run((-0.06, 0.015, 0.03), 0.5)
    controller.run((0.0, 0.015, 0.03), 0.55)
    assert observer.until(lambda: len(seen['profiles']) >= 10)
    assert observer.ask(SetBool, 'scanner/enable', data=False).success
    assert observer.until(lambda: sum(b.profile_count for b in seen['profiles']) >= 105)
    times = np.concatenate(
        [nanoseconds(b.header.stamp) + np.array(b.stamp_offsets_ns) for b in seen['profiles']]
    )
    assert set(np.diff(times)) == {10_000_000} and len(times) == 105
    assert [b.sequence for b in seen['profiles']] == list(range(len(seen['profiles'])))
    assert seen['profiles'][-1].profile_count == 5 and len(seen['profiles'][-1].z) == 5 * 640

    saved = observer.ask(Trigger, '/cell/save_truth')
    assert saved.success, saved.message
    truth = HeightGrid.load_npz(saved.message)
    assert truth.z.max() > 0.0115
    last = seen['profiles'][-1]
    z = np.array(last.z).reshape(-1, 640)[-1] + 0.03 + 0.12
    x = 0.0 + 0.06
    expected = truth.sample(x, 0.015 + np.array(last.x[:640]))
    good = np.isfinite(z) & np.isfinite(expected)
    assert good.sum() > 300 and np.median(np.abs(z - expected)[good]) < 1e-4
    assert process.poll() is None


def test_the_pyrometer_follows_its_aim_in_machine_coordinates(cell):
    """The middle of the plate gets hot; a pyrometer that looks at its edge does not see it."""
    _, observer, controller = cell
    seen, start, middle = observer.seen['temperature'], (0.09, 0.1, 0.01), (0.11, 0.1, 0.01)
    plate = Vector3(x=0.2, y=0.2, z=0.01)
    assert observer.ask(LoadPart, 'cell/load_part', plate=plate, seed=-1).success
    aim = observer.node.create_publisher(PointStamped, 'pyrometer_aim', LATCHED)

    def look_at(x: float, y: float) -> float:
        """Highest temperature while metal is laid in the middle of the plate."""
        message = PointStamped(point=Point(x=0.1 + x, y=0.08 + y, z=0.02))  # work_zero of the cell
        message.header.frame_id = 'machine'
        aim.publish(message)
        observer.until(lambda: False, 1.0)
        controller.run(start, 0.1)
        controller.run(middle, 2.0, wire=5 / 60, voltage=22.0, outputs=3)
        seen.clear()
        controller.run(middle, 2.0)
        assert observer.until(lambda: len(seen) >= 10)
        return max(t.temperature for t in seen)

    assert observer.until(lambda: aim.get_subscription_count() == 1)
    edge = look_at(0.01, 0.01)
    assert look_at(0.1, 0.1) > edge + 30.0


def test_time_does_not_run_ahead_of_a_job_that_computes(cell):
    _, observer, controller = cell
    here, seconds = (0.0, 0.0, 0.05), 0.5
    status = observer.node.create_publisher(JobStatus, 'job_status', LATCHED)
    status.publish(JobStatus(state=JobStatus.CORRECTING))

    def took() -> float:
        began = time.monotonic()
        controller.run(here, seconds)
        return time.monotonic() - began

    controller.run(here, 0.1)
    assert observer.until(lambda: took() > 0.8 * seconds)
    status.publish(JobStatus(state=JobStatus.COOLING))
    assert observer.until(lambda: took() < 0.8 * seconds)


def test_bad_requests_are_refused_by_name(cell):
    _, observer, controller = cell
    answer = observer.ask(LoadPart, 'cell/load_part', mesh_path='/nowhere/part.stl', seed=-1)
    assert not answer.success and '/nowhere/part.stl' in answer.message
    answer = observer.ask(LoadPart, 'cell/load_part', plate=Vector3(x=0.1, y=-1.0, z=0.01), seed=-1)
    assert not answer.success and 'plate.y' in answer.message
    answer = observer.ask(LoadPart, 'cell/load_part', plate=Vector3(x=0.04, y=0.06, z=0.0), seed=-1)
    assert not answer.success and 'this cell has none (chuck.steps_per_turn)' in answer.message
    answer = observer.ask(InjectFault, 'cell/inject_fault', fault='flood', value=0.0)
    assert not answer.success and 'flood' in answer.message and 'arc_loss' in answer.message
    controller.run((0.0, 0.0, 0.05), 0.1)


def test_a_part_that_is_asked_for_too_late_is_not_changed_in_the_midst_of_a_job(cell):
    _, observer, controller = cell
    status = observer.node.create_publisher(JobStatus, 'job_status', LATCHED)

    def said(state: int, words: str) -> bool:
        status.publish(JobStatus(state=state))
        controller.run((0.0, 0.0, 0.05), 0.05)
        plate = Vector3(x=0.1, y=0.1, z=0.01)
        return words in observer.ask(LoadPart, 'cell/load_part', plate=plate, seed=-1).message

    assert observer.until(lambda: said(JobStatus.COOLING, 'a job runs'))
    assert observer.until(lambda: said(JobStatus.DONE, 'part on the table'))


def test_controller_gone_and_back(cell):
    _, observer, controller = cell
    clocks = observer.seen['/clock']

    def time_passes(count: int) -> bool:
        controller.run((0.0, 0.0, 0.05), 0.1)
        return len(clocks) >= count

    assert observer.until(lambda: time_passes(5))
    controller.client.close()
    controller.accept()
    before = len(clocks)
    assert observer.until(lambda: time_passes(before + 5))


def test_unknown_parameter_is_refused_by_name():
    g = Graph()
    assert g.start('waam_sim', 'cell', '-p', 'metal_leveling:=0.5').wait(30) == 2
    said = g.close()
    assert "unknown parameter 'metal_leveling'" in said and 'metal_levelling' in said
