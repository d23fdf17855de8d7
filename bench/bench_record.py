"""The recorder beside a plain single-file MCAP writer, on the same topics in the same run: 1 kHz telemetry, 10
batches of profiles and one 1 MB map per second, each from a process of its own.

record.lost: messages missing in the record (baseline: missing in the plain file);
record.cpu_percent: of one core (baseline: the plain writer's);
record.dispatch_p99_ms: publication to time stamp in the record, telemetry (baseline: the plain writer's);
record.recovered_gap_s: kill -9 while recording: what is missing at the end (baseline: 1 s, which is asked for).

BENCH_RECORD_S: seconds of the first part, default 30 (600 for the long run). Everything is local to ROS domain 79.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.limit import within
from lib.node import cpu_seconds

SECONDS = float(os.environ.get('BENCH_RECORD_S', '30'))
RATES = {'telemetry': 1000, 'profiles': 10, 'height_map': 1}
DOMAIN = '79'

PUBLISH = """
import sys, time, rclpy
from array import array
from rclpy.serialization import serialize_message
from waam_msgs.msg import HeightMap, ProfileBatch, Telemetry
from waam_node.qos import LATCHED, PROFILES, TELEMETRY
name, rate, seconds = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
rclpy.init()
node = rclpy.create_node('bench_' + name)
kinds = {'telemetry': (Telemetry, TELEMETRY), 'profiles': (ProfileBatch, PROFILES)}
kind, qos = kinds.get(name, (HeightMap, LATCHED))
msg = kind()
if name == 'profiles':
    msg.profile_count, msg.points_per_profile = 10, 640
    msg.x = msg.z = array('f', [0.1 * i for i in range(6400)])
if name == 'height_map':
    msg.z = msg.sigma = array('f', [1e-3 * (i % 977) for i in range(125_000)])
data = serialize_message(msg)
out = node.create_publisher(kind, name, qos)
while out.get_subscription_count() < 2:
    time.sleep(0.05)
time.sleep(1.0)
start = time.perf_counter()
for i in range(int(rate * seconds)):
    wait = start + i / rate - time.perf_counter()
    if wait > 0:
        time.sleep(wait)
    out.publish(data)
out.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
time.sleep(1.0)
"""

PLAIN = """
import signal, sys, time, rclpy
from mcap.writer import Writer, CompressionType
from rclpy.experimental import EventsExecutor
from waam_msgs.msg import HeightMap, ProfileBatch, Telemetry
from waam_node.qos import LATCHED, PROFILES, TELEMETRY
rclpy.init()
node = rclpy.create_node('plain_writer')
stream = open(sys.argv[1], 'wb')
writer = Writer(stream, compression=CompressionType.ZSTD)
writer.start(profile='ros2', library='plain')
schema = writer.register_schema('x', 'ros2msg', b'')
def take(channel):
    def keep(data):
        writer.add_message(channel, time.time_ns(), data, time.time_ns())
    return keep
topics = (('telemetry', Telemetry, TELEMETRY), ('profiles', ProfileBatch, PROFILES), ('height_map', HeightMap, LATCHED))
for name, kind, qos in topics:
    node.create_subscription(kind, name, take(writer.register_channel(name, 'cdr', schema)), qos, raw=True)
going = [True]
signal.signal(signal.SIGTERM, lambda *_: going.clear())
executor = EventsExecutor()
executor.add_node(node)
while going:
    executor.spin_once(timeout_sec=0.1)
writer.finish()
stream.close()
"""
STARTED: list[subprocess.Popen] = []
RECORDER = 'from waam_record.recorder_node import main; main()'


def start(code: str, *arguments: str) -> subprocess.Popen:
    env = {**os.environ, 'ROS_DOMAIN_ID': DOMAIN, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    process = subprocess.Popen([sys.executable, '-c', code, *arguments], env=env, stdout=sys.stderr)
    STARTED.append(process)
    return process


def end_all() -> None:
    for process in STARTED:
        if process.poll() is None:
            process.kill()
            process.wait()


def until(condition: Callable[[], bool]) -> None:
    """Returns when it holds; `within` ends the wait."""
    while not condition():
        time.sleep(0.05)


def counts(path: Path) -> tuple[int, list[float]]:
    """Messages of the benchmark, and for telemetry log time - publish time in ms."""
    from waam_record.bag_copy import Selection, messages
    from waam_record.bag_reader import bag_files

    names = tuple(f'/{n}' for n in RATES)
    found, delays = 0, []
    for topic, m in messages(bag_files(path), Selection(topics=names)):
        found += 1
        if topic.name == '/telemetry':
            delays.append((m.log_time - m.publish_time) * 1e-6)
    return found, delays


def plain_count(path: Path) -> int:
    from mcap.reader import make_reader

    with open(path, 'rb') as f:
        return make_reader(f).get_summary().statistics.message_count


def on_the_graph(scratch: Path) -> None:
    record, plain = scratch / 'record', scratch / 'plain.mcap'
    writers = [
        start(RECORDER, '--ros-args', '-p', f'directory:={record}', '-p', 'discovery_period:=0.2'),
        start(PLAIN, str(plain)),
    ]
    publishers = [start(PUBLISH, name, str(rate), str(SECONDS)) for name, rate in RATES.items()]
    time.sleep(3.0)
    before, began = [cpu_seconds(w.pid) for w in writers], time.monotonic()
    for p in publishers:
        p.wait()
    wall = time.monotonic() - began
    used = [cpu_seconds(w.pid) - b for w, b in zip(writers, before, strict=True)]
    for w in writers:
        w.send_signal(signal.SIGTERM)
    for w in writers:
        w.wait()
    sent = sum(int(rate * SECONDS) for rate in RATES.values())
    found, delays = counts(record)
    emit(
        'record.lost',
        sent - found,
        'messages',
        f'plain writer, {sent} sent',
        sent - plain_count(plain),
    )
    emit('record.cpu_percent', 100 * used[0] / wall, '%', 'plain writer', 100 * used[1] / wall)
    p99 = float(np.percentile(delays, 99)) if delays else float('nan')
    emit('record.dispatch_p99_ms', p99, 'ms', 'median of the same', float(np.median(delays)))


def killed(scratch: Path) -> None:
    """Wall time between the last message that was sent and the last that is recovered."""
    from waam_record.bag_copy import recover
    from waam_record.bag_reader import info

    record = scratch / 'killed'
    recorder = start(
        RECORDER, '--ros-args', '-p', f'directory:={record}', '-p', 'discovery_period:=0.2'
    )
    start(PLAIN, str(scratch / 'unused.mcap'))  # the publisher waits for two
    start(PUBLISH, 'telemetry', '1000', '60')
    until(lambda: sum(f.stat().st_size for f in record.glob('*.mcap')) > 100_000)
    time.sleep(2.5)
    at = time.time_ns()
    recorder.kill()
    recorder.wait()
    end_all()
    recover(record, scratch / 'saved')
    emit(
        'record.recovered_gap_s',
        (at - info(scratch / 'saved').last_ns) * 1e-9,
        's',
        'asked for',
        1.0,
    )


def within_scratch(
    seconds: float, what: str, measure: Callable[[Path], None]
) -> Callable[[], None]:
    """The measurement in a temporary folder; after so many seconds, or when it fails, its processes are ended."""

    def run() -> None:
        with tempfile.TemporaryDirectory(prefix='waam_bench_') as name:
            try:
                with within(seconds, what):
                    measure(Path(name))
            finally:
                end_all()

    return run


RECORD = within_scratch(SECONDS * 1.5 + 180, 'recording on the graph', on_the_graph)
KILL = within_scratch(120, 'the killed recorder', killed)
FIGURES = {
    'record.lost': RECORD,
    'record.cpu_percent': RECORD,
    'record.dispatch_p99_ms': RECORD,
    'record.recovered_gap_s': KILL,
}
