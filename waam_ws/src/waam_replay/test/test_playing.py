"""Replay by time: the clock, what may be published, and the player on a graph."""

import os
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from waam_node.testing import fresh_domain
from waam_record.bag_writer import BagWriter, Topic
from waam_record.definitions import ament_prefixes, full_text
from waam_replay.play_clock import PlayClock
from waam_replay.player_node import offered
from waam_replay.playlist import Playlist, Wanted, against_live, parse_remap

DOMAIN = fresh_domain()
T0 = 1_700_000_000 * 10**9


def test_clock_runs_pauses_and_jumps():
    clock = PlayClock(1000, 2.0, False, now=10.0)
    assert clock.now_ns(11.0) == 1000 + 2 * 10**9
    clock.pause(11.0)
    assert clock.now_ns(50.0) == 1000 + 2 * 10**9
    clock.resume(60.0)
    clock.set_rate(0.5, 61.0)
    assert clock.now_ns(63.0) == 1000 + 5 * 10**9
    clock.seek(7, 100.0)
    assert clock.now_ns(100.0) == 7
    with pytest.raises(ValueError, match='rate is 0'):
        clock.set_rate(0.0, 100.0)


def text(value: str) -> bytes:
    data = value.encode() + b'\0'
    return b'\0\1\0\0' + len(data).to_bytes(4, 'little') + data


@pytest.fixture(scope='module')
def record(tmp_path_factory):
    """Ten seconds of three topics at 10 Hz, one that commands, and one latched message at the beginning."""
    folder = tmp_path_factory.mktemp('play') / 'record'
    writer = BagWriter(folder)
    kind = 'std_msgs/msg/String'
    names = ('/a', '/b', '/override', '/heartbeat', '/x/_service_event', '/clock')
    numbers = [writer.add_topic(Topic(n, kind, full_text(kind, ament_prefixes()))) for n in names]
    held = writer.add_topic(Topic('/held', kind, full_text(kind, ament_prefixes()), latched=True,
                                  qos=({'reliability': 'reliable', 'durability': 'transient_local'},)))  # fmt: skip
    writer.write(held, T0, T0, 1, text('held'))
    for i in range(100):
        for number in numbers:
            t = T0 + i * 10**8
            writer.write(number, t, t, i, text(f'{i}'))
    writer.close()
    return folder


def test_commands_are_never_published_unless_forced(record):
    chosen, refused = Playlist(record, Wanted()).allowed(set())
    assert set(chosen) == {'/a', '/b', '/held'}
    assert set(refused) == {'/override', '/heartbeat'}
    forced, _ = Playlist(record, Wanted(force=True)).allowed({'/a'})
    assert set(forced) == {'/a', '/b', '/held', '/override', '/heartbeat'}


def test_a_remapped_command_is_judged_by_where_it_goes(record):
    away = Wanted(remap=parse_remap(['/override:=/replay/seen']))
    assert '/override' in Playlist(record, away).allowed(set())[0]
    into = Wanted(remap=parse_remap(['a:=override']))
    chosen, refused = Playlist(record, into).allowed(set())
    assert '/a' not in chosen and 'commands a machine' in refused['/a']


def test_topics_that_others_publish_are_left_out(record):
    chosen, refused = Playlist(record, Wanted()).allowed({'/a'})
    assert '/a' not in chosen and 'has a publisher' in refused['/a']


def test_a_graph_with_a_machine_gets_named_topics_and_nothing_by_force():
    named, forced = Wanted(topics=('a',)), Wanted(topics=('a',), force=True)
    for node in ('bridge', 'job_sequencer', 'joint_trajectory_controller'):
        assert f"'{node}' runs" in against_live({'x', node}, Wanted())
        assert f"'{node}' runs" in against_live({node}, forced)
        assert against_live({node}, named) == ''
    assert against_live({'x', 'scan_fusion'}, Wanted(force=True)) == ''


def test_choice_and_its_errors(record):
    assert set(Playlist(record, Wanted(topics=('a',))).allowed(set())[0]) == {'/a'}
    assert set(Playlist(record, Wanted(exclude='a|held')).allowed(set())[0]) == {'/b'}
    with pytest.raises(ValueError, match="no topic 'nothing'"):
        Playlist(record, Wanted(topics=('nothing',)))
    with pytest.raises(ValueError, match='from:=to'):
        parse_remap(['a=b'])


def test_messages_from_and_until(record):
    playlist = Playlist(record, Wanted(until=3.0))
    found = [m.log_time for _, m in playlist.messages({'/a', '/b'}, T0 + 10**9)]
    assert found == sorted(found) and len(found) == 2 * 21
    assert found[0] == T0 + 10**9 and found[-1] == T0 + 3 * 10**9
    topics, _ = playlist.allowed(set())
    assert [n for n, _ in playlist.latched_before(topics, T0 + 10**9)] == ['/held']
    assert playlist.latched_before(topics, T0) == []


def test_all_fixed_frames_are_there_for_who_comes_late(tmp_path):
    """Bridge and scan_fusion both publish /tf_static: the last message alone would lose frames."""
    writer, kind = BagWriter(tmp_path / 'record'), 'std_msgs/msg/String'
    held = ({'reliability': 'reliable', 'durability': 'transient_local'},)
    for name in ('/tf_static', '/held'):
        topic = Topic(name, kind, full_text(kind, ament_prefixes()), latched=True, qos=held)
        number = writer.add_topic(topic)
        for n in range(2):
            writer.write(number, T0 + n, T0 + n, n, text(f'{n}'))
    writer.close()
    playlist = Playlist(tmp_path / 'record', Wanted())
    topics, _ = playlist.allowed(set())
    names = [n for n, _ in playlist.latched_before(topics, T0 + 10)]
    assert sorted(names) == ['/held', '/tf_static', '/tf_static']
    depths = {n: offered(t).depth for n, t in topics.items()}
    assert depths['/held'] == 1 and depths['/tf_static'] > 1


class Listener:
    """A player process and a node that listens to it."""

    def __init__(self, *parameters: str) -> None:
        command = [
            sys.executable,
            '-c',
            'from waam_replay.player_node import main; main()',
            '--ros-args',
        ]
        command += [a for p in parameters for a in ('-p', p)]
        self.context = Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = Node('listener', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.got: dict[str, list[str]] = {}
        for name in ('/a', '/b', '/override', '/heartbeat', '/held'):
            self.got[name] = []
            self.node.create_subscription(String, name, self._keep(name), QoSProfile(depth=1000))
        self.clock = 0
        self.node.create_subscription(Clock, '/clock', self._on_clock, 10)
        env = {**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)}
        self.process = subprocess.Popen(command, env=env)

    def _keep(self, name: str):
        def keep(msg: String) -> None:
            self.got[name].append(msg.data)

        return keep

    def _on_clock(self, msg: Clock) -> None:
        self.clock = msg.clock.sec * 10**9 + msg.clock.nanosec

    def until(self, condition, seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f'timeout; got {self.got}'
            self.executor.spin_once(timeout_sec=0.05)

    def trigger(self, name: str) -> Trigger.Response:
        """Repeated until answered; pause and resume may be asked twice."""
        client = self.node.create_client(Trigger, f'player/{name}')
        self.until(client.service_is_ready)
        while True:
            future = client.call_async(Trigger.Request())
            end = time.monotonic() + 3
            while not future.done() and time.monotonic() < end:
                self.executor.spin_once(timeout_sec=0.05)
            if future.done():
                return future.result()

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        self.process.wait(20)
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def listener():
    made = []

    def make(*parameters: str) -> Listener:
        made.append(Listener(*parameters))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_everything_comes_in_order_and_the_player_ends(listener, record):
    g = listener(f'record:={record}', 'rate:=20.0', 'paused:=true')
    g.until(lambda: all(g.node.count_publishers(n) for n in ('/a', '/b', '/held')))
    time.sleep(1.5)  # for the player to find the listener as well
    assert g.trigger('resume').success
    g.until(lambda: g.process.poll() is not None)
    g.until(lambda: len(g.got['/a']) >= 100 and len(g.got['/b']) >= 100)
    assert g.process.returncode == 0
    assert g.got['/a'] == g.got['/b'] == [str(i) for i in range(100)]
    assert g.got['/held'] == ['held']
    assert g.got['/override'] == g.got['/heartbeat'] == []
    assert T0 + 9 * 10**9 <= g.clock <= T0 + 10 * 10**9


def test_a_player_refuses_the_domain_of_a_bridge(record, tmp_path):
    """`waam replay play`, as a person calls it; topics that are named are played."""
    context, domain = Context(), fresh_domain()
    rclpy.init(context=context, domain_id=domain)
    bridge = Node('bridge', context=context)
    orders = []
    bridge.create_subscription(String, '/override', orders.append, 10)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(bridge)
    play = [sys.executable, '-m', 'waam_bringup.cli', 'replay', 'play', str(record), '--rate', '50']
    env = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}

    def run(*options):
        return subprocess.run(
            [*play, *options], env=env, capture_output=True, text=True, timeout=60
        )

    try:
        for options in ((), ('--force',), ('--force', '--topics', '/override')):
            done = run(*options)
            assert done.returncode == 2 and "'bridge' runs in this ROS domain" in done.stderr
            assert 'Traceback' not in done.stderr
        assert run('--topics', '/a').returncode == 0
        executor.spin_once(timeout_sec=0.2)
        assert not orders
    finally:
        bridge.destroy_node()
        context.try_shutdown()


def test_pause_step_seek_and_rate(listener, record):
    g = listener(f'record:={record}', 'paused:=true', 'topics:=/a')
    assert g.trigger('pause').success
    time.sleep(0.3)
    g.executor.spin_once(timeout_sec=0.2)
    # nor what lies at the beginning itself, when the listener was found in time
    assert g.got['/a'] == []
    assert g.trigger('step').success
    g.until(lambda: g.got['/a'])
    assert set(g.got['/a']) <= {'0', '1'}  # a repeated question is a second step
    seek = g.node.create_publisher(Float64, 'player/seek', 10)
    rate = g.node.create_publisher(Float64, 'player/rate', 10)
    g.until(lambda: seek.get_subscription_count() and rate.get_subscription_count())
    seek.publish(Float64(data=9.0))
    rate.publish(Float64(data=50.0))
    g.until(lambda: g.clock >= T0 + 9 * 10**9)
    g.got['/a'].clear()
    assert g.trigger('resume').success
    g.until(lambda: g.process.poll() is not None)
    g.until(lambda: '99' in g.got['/a'])
    # the message at 9.0 s itself may have come with the seek
    assert g.got['/a'][-9:] == [str(i) for i in range(91, 100)] and set(g.got['/a'][:-9]) <= {'90'}
