"""The recorder as a process over DDS, driven as the job drives it, judged by a third-party reader."""

import dataclasses
import json
import signal
import time
from array import array
from pathlib import Path

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from recorder_graph import SLOW_DISK, START, STOP_SOON, Graph
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock

from waam_msgs.action import RunJob
from waam_msgs.msg import Heartbeat, HeightMap, JobStatus, LeaseTick, Telemetry
from waam_msgs.srv import Record
from waam_node.params import markdown
from waam_node.qos import BEAT, EVENTS, LATCHED, TELEMETRY
from waam_record.bag_copy import recover
from waam_record.bag_reader import check, info
from waam_record.node_session import RecorderParams

# what a program before START changes
SMALL_HISTORY = 'from waam_record import node_taps, node_thread\nnode_taps.DEPTH, node_thread.POLL_S = 20, 0.1\n'
METADATA_SOON = 'from waam_record import recording\nrecording.METADATA_S = 1.0\n'


def fill(node: Node) -> HeightMap:
    msg = HeightMap(job_id='j', scan_id=3, reasons=['a', 'bc'], coverage=0.5)
    msg.z = array('f', [1.0, float('nan'), 3.0])
    msg.count = array('H', [1, 0, 65535])
    node.create_publisher(HeightMap, 'height_map', LATCHED).publish(msg)
    return msg


def test_a_job_is_recorded_whole(graph, tmp_path):
    g = graph()
    height_map = fill(g.node)
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    kind = RunJob.Impl.FeedbackMessage
    feedback = g.node.create_publisher(kind, 'job_sequencer/run_job/_action/feedback', 10)
    folder = tmp_path / 'jobs/x/record'
    answer = g.call(Record.Request.START, directory=str(folder), custom_data=['wire=G3Si1'])
    assert answer.success, answer.message
    for i in range(300):  # from the first moment after the answer
        telemetry.publish(Telemetry(sequence=i, arc_current=i * 0.5))
        if i == 150:
            assert g.call(Record.Request.SPLIT).success
    status = kind()
    status.feedback.status.layer = 7
    status.feedback.status.message = 'seven'
    feedback.publish(status)
    ticks = g.node.create_publisher(LeaseTick, 'lease_tick', BEAT)  # appears after START
    beats = []
    g.node.create_subscription(Heartbeat, 'heartbeat', beats.append, BEAT)
    g.spin_until(lambda: ticks.get_subscription_count() >= 2, 30)
    ticks.publish(LeaseTick(controller_us=42))
    g.spin_until(lambda: beats, 30)
    answer = g.call(Record.Request.STOP)
    assert answer.success and 'verified' in answer.message and '0 lost' in answer.message
    assert answer.lost == 0

    with AnyReader([folder]) as reader:  # compares our definitions with the type hashes as well
        assert reader.message_count == answer.messages
        got: dict[str, list] = {}
        assert any('/srv/' in c.msgtype for c in reader.connections)
        plain = [
            c for c in reader.connections if '/srv/' not in c.msgtype
        ]  # rosbags knows none of those
        for connection, _, raw in reader.messages(plain):
            got.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    assert [m.sequence for m in got['/telemetry']] == list(range(300))
    assert [m.arc_current for m in got['/telemetry']] == [i * 0.5 for i in range(300)]
    seen = got['/height_map'][0]
    assert bytes(seen.z.tobytes()) == height_map.z.tobytes()
    assert list(seen.count) == [1, 0, 65535] and seen.reasons == ['a', 'bc']
    shown = got['/job_sequencer/run_job/_action/feedback'][0].feedback.status
    assert (shown.layer, shown.message) == (7, 'seven')
    assert [m.controller_us for m in got['/lease_tick']] == [42]
    assert [m.node for m in got['/heartbeat']] == ['recorder']
    found = info(folder)
    assert found.custom_data['wire'] == 'G3Si1' and found.custom_data['lost'] == '0'
    assert [f.name for f in found.files] == ['record_0.mcap', 'record_1.mcap']


def test_what_the_middleware_loses_is_counted(graph, tmp_path):
    g = graph(program=SMALL_HISTORY + START)
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'record')).success
    telemetry.publish(Telemetry())  # counting begins with the first that is heard
    time.sleep(0.3)
    for i in range(1, 900):
        telemetry.publish(Telemetry(sequence=i))
        time.sleep(0.0005)  # slow enough for the transport, too fast for a history of 20
    time.sleep(0.3)  # one look of the recorder
    telemetry.publish(Telemetry(sequence=900))  # shows the gap
    answer = g.call(Record.Request.STOP)
    topic = info(tmp_path / 'record').topics['/telemetry']
    assert answer.success and topic.lost == answer.lost > 0
    assert topic.messages + topic.lost == 901


def test_kill_9_in_the_middle(graph, tmp_path):
    g = graph()
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'record')).success
    sent, start = 0, time.monotonic()
    while time.monotonic() - start < 2.6:
        telemetry.publish(Telemetry(sequence=sent))
        sent += 1
        time.sleep(0.002)
    g.process.send_signal(signal.SIGKILL)
    rate = sent / (time.monotonic() - start)
    g.process.wait()
    assert not check(tmp_path / 'record').sound
    recover(tmp_path / 'record', tmp_path / 'saved')
    saved = info(tmp_path / 'saved').topics['/telemetry'].messages
    assert saved > 0
    assert saved >= sent - 1.4 * rate
    assert check(tmp_path / 'saved').sound


def test_simulated_time_is_the_log_time(graph, tmp_path):
    g = graph('use_sim_time:=true')
    clock = g.node.create_publisher(Clock, '/clock', 10)
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'record')).success
    telemetry.publish(Telemetry())  # before the first clock
    g.spin_until(lambda: clock.get_subscription_count() >= 2, 30)
    for t in (100, 101):
        msg = Clock()
        msg.clock.sec = t
        clock.publish(msg)
        time.sleep(0.1)
        telemetry.publish(Telemetry(sequence=t))
        time.sleep(0.1)
    assert g.call(Record.Request.STOP).success
    with AnyReader([tmp_path / 'record']) as reader:
        times = {t for c, t, _ in reader.messages() if c.topic == '/telemetry'}
    assert times == {100 * 10**9, 101 * 10**9}


def test_pause_and_refusals(graph, tmp_path):
    g = graph()
    telemetry = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    needless = g.call(Record.Request.STOP)
    assert needless.success and 'nothing is being recorded' in needless.message
    assert 'exists already' in g.call(Record.Request.START, directory=str(tmp_path)).message
    folder = str(tmp_path / 'record')
    bad = g.call(Record.Request.START, directory=folder, custom_data=['novalue'])
    assert 'novalue' in bad.message and not Path(folder).exists()
    assert g.call(Record.Request.START, directory=folder).success
    assert 'stop that first' in g.call(Record.Request.START, directory=folder + '2').message
    assert 'code 77' in g.call(77).message
    assert g.call(Record.Request.PAUSE).success
    telemetry.publish(Telemetry(sequence=1))
    time.sleep(0.2)
    assert g.call(Record.Request.RESUME).success
    telemetry.publish(Telemetry(sequence=2))
    time.sleep(0.2)
    g.process.terminate()  # closes what is open
    assert g.process.wait(10) == 0
    assert check(tmp_path / 'record').sound
    assert info(tmp_path / 'record').topics['/telemetry'].messages == 1


def test_choice_split_and_parameters(graph, tmp_path):
    """All but what is left out; the next file when asked for, with latched messages; the parameters of the nodes."""
    g = graph('exclude:=telemetry|heartbeat', program=METADATA_SOON + START)
    fill(g.node)
    other = g.node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
    status = g.node.create_publisher(JobStatus, 'any_name', EVENTS)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'record')).success
    for count in (3, 1, 2):
        if count < 3:
            assert g.call(Record.Request.SPLIT).success
        for _ in range(count):
            status.publish(JobStatus())
            other.publish(Telemetry())
        g.spin_until(lambda: True, 1)
        time.sleep(0.3)
    found: dict = {}
    g.node.create_subscription(
        DiagnosticArray, '/diagnostics', lambda m: found.update(diagnosed(m)), 10
    )
    g.spin_until(lambda: found.get('messages', 0) >= 7, 30)
    assert found['lost'] == 0
    g.spin_until(lambda: b'parameters.recorder' in metadata(tmp_path), 60)
    assert g.call(Record.Request.STOP).success
    listed = info(tmp_path / 'record')
    assert {'/height_map', '/any_name'} <= set(listed.topics)
    assert not {'/telemetry', '/heartbeat'} & set(listed.topics)
    assert [info(f).topics['/any_name'].messages for f in listed.files] == [3, 1, 2]
    assert all(info(f).topics['/height_map'].messages == 1 for f in listed.files)
    parameters = json.loads(listed.custom_data['parameters.recorder'])
    assert parameters['min_free_mb'] == 200 and listed.custom_data['version.mcap']


def longest_silence(g: Graph, act) -> float:
    """The longest time without a heartbeat while `act` runs, s. Ticks go out every 50 ms."""
    ticks = g.node.create_publisher(LeaseTick, 'lease_tick', BEAT)
    beats: list[float] = []
    g.node.create_subscription(
        Heartbeat, 'heartbeat', lambda _: beats.append(time.monotonic()), BEAT
    )
    timer = g.node.create_timer(0.05, lambda: ticks.publish(LeaseTick()))
    g.spin_until(lambda: len(beats) > 5, 30)
    del beats[:-1]
    act()
    count = len(beats)
    g.spin_until(lambda: len(beats) > count, 30)
    timer.cancel()
    return max(b - a for a, b in zip(beats, beats[1:], strict=False))


def test_a_slow_disk_never_silences_the_node(graph, tmp_path):
    g = graph(program=SLOW_DISK.format(seconds=1.5) + START)
    folder = str(tmp_path / 'record')

    def record() -> None:
        answer = g.call(Record.Request.START, directory=folder)
        assert answer.success, answer.message
        answer = g.call(Record.Request.STOP)
        assert answer.success and 'verified' in answer.message

    g.call(0)
    assert longest_silence(g, record) < 1.0


def test_stop_answers_although_the_disk_does_not_and_the_next_start_need_not_wait(graph, tmp_path):
    g = graph(program=SLOW_DISK.format(seconds=1.0) + STOP_SOON + START)
    assert g.call(Record.Request.START, directory=str(tmp_path / 'first')).success
    answer = g.call(Record.Request.STOP)
    assert not answer.success and 'first is not closed yet' in answer.message
    assert g.call(Record.Request.START, directory=str(tmp_path / 'second')).success
    g.spin_until(lambda: (tmp_path / 'first/first_0.mcap').exists(), 10)
    end = time.monotonic() + 120
    while not check(tmp_path / 'first').sound and time.monotonic() < end:
        g.executor.spin_once(timeout_sec=0.2)
    assert check(tmp_path / 'first').sound
    g.process.terminate()
    assert g.process.wait(30) == 0
    assert check(tmp_path / 'second').sound


def diagnosed(message: DiagnosticArray) -> dict[str, int]:
    values = {v.key: v.value for s in message.status for v in s.values}
    return {k: int(values[k]) for k in ('messages', 'lost') if k in values}


def metadata(folder: Path) -> bytes:
    return (folder / 'record/metadata.yaml').read_bytes()


def test_unknown_parameter_is_refused_by_name(graph):
    g = graph('quueue_mb:=3')
    _, err = g.process.communicate(timeout=60)
    assert g.process.returncode == 2 and "unknown parameter 'quueue_mb'" in err


def test_yaml_lists_every_parameter():
    file = Path(__file__).parents[1] / 'config/recorder.yaml'
    listed = yaml.safe_load(file.read_text())['/**/recorder']['ros__parameters']
    assert markdown(RecorderParams) in file.parents[1].joinpath('README.md').read_text()
    assert listed == {f.name: f.default for f in dataclasses.fields(RecorderParams)}
