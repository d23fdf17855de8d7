"""The recorder: 1 kHz telemetry, 10 batches of profiles and one 1 MB map per second, each from a process of its own.

record.lost: messages missing in the record (baseline: messages sent);
record.cpu_percent: of one core;
record.dispatch_p99_ms: publication to time stamp in the record, telemetry (baseline: the median);
record.recovered_gap_s: kill -9 while recording: what is missing at the end (baseline: 1 s, which is asked for).

BENCH_RECORD_S: seconds of the first part, default 30 (600 for the long run).
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.limit import within
from lib.node import NodeUnderTest, cpu_seconds

SECONDS = float(os.environ.get('BENCH_RECORD_S', '30'))
RATES = {'telemetry': 1000, 'profiles': 10, 'height_map': 1}

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
while out.get_subscription_count() < 1:
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


@contextmanager
def recorder(seconds: float) -> Iterator[tuple[NodeUnderTest, Path]]:
    """A recorder and the folder that it writes; TimeoutError after so many seconds."""
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch, within(seconds, 'recording'):
        record = Path(scratch) / 'record'
        given = (f'directory:={record}', 'discovery_period:=0.2')
        with NodeUnderTest('waam_record.recorder_node', *given) as node:
            yield node, record


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


def on_the_graph() -> None:
    """As long as it runs."""
    with recorder(SECONDS * 1.5 + 180) as (node, record):
        publishers = [
            node.start('-c', PUBLISH, name, str(rate), str(SECONDS)) for name, rate in RATES.items()
        ]
        time.sleep(3.0)
        before, began = cpu_seconds(node.process.pid), time.monotonic()
        for p in publishers:
            p.wait()
        used = (cpu_seconds(node.process.pid) - before) / (time.monotonic() - began)
        node.process.send_signal(signal.SIGTERM)
        node.process.wait()
        found, delays = counts(record)
    sent = sum(int(rate * SECONDS) for rate in RATES.values())
    emit('record.lost', sent - found, 'messages', 'messages sent', sent)
    emit('record.cpu_percent', 100 * used, '%', 'none', None)
    p99, median = (float(np.percentile(delays, q)) for q in (99, 50))
    emit('record.dispatch_p99_ms', p99, 'ms', 'median of the same', median)


def killed() -> None:
    """Wall time between the last message that was sent and the last that is recovered."""
    from waam_record.bag_copy import recover
    from waam_record.bag_reader import info

    with recorder(120) as (node, record):
        node.start('-c', PUBLISH, 'telemetry', '1000', '60')
        node.until(lambda: sum(f.stat().st_size for f in record.glob('*.mcap')) > 100_000)
        time.sleep(2.5)
        at = time.time_ns()
        node.process.kill()
        node.process.wait()
        saved = record.with_name('saved')
        recover(record, saved)
        gap = (at - info(saved).last_ns) * 1e-9
    emit('record.recovered_gap_s', gap, 's', 'asked for', 1.0)


FIGURES = {
    **{f'record.{name}': on_the_graph for name in ('lost', 'cpu_percent', 'dispatch_p99_ms')},
    'record.recovered_gap_s': killed,
}
