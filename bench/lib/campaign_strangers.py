"""A stranger on the bus while an arc burns: what it publishes, and what the graph makes of it."""

from __future__ import annotations

import math
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import PointCloud2, Temperature
from std_srvs.srv import Trigger

from waam_bringup.client import GraphClient
from waam_msgs import msg as m

from .campaign_graph import DONE, FAILED, JOB_S, LEASE_MS, Graph, Job, until

SECONDS = 3.0  # that a stranger publishes
PERIOD = 0.02  # s between two of its messages
PARTICIPANTS = 50
UNDISTURBED_MM = 0.16  # RMS that the job of the trials never has without a stranger


def _moved(message: Any, rng: random.Random) -> None:
    message.position.x += rng.uniform(-0.05, 0.05)
    message.sequence += 1000


def _junk(message: Any, rng: random.Random) -> None:
    message.height, message.width, message.point_step, message.row_step = 1, 100, 12, 1200
    message.data = rng.randbytes(1200)


def _later(field: str, by: int) -> Callable[[Any, random.Random], None]:
    return lambda message, _: setattr(message, field, getattr(message, field) + by)


def _higher(message: Any, _: random.Random) -> None:
    message.z = [v + 0.005 for v in message.z]


def _far(message: Any, _: random.Random) -> None:
    message.point.x = 1000.0


# name -> type, topic, name of the quality of service, and what is changed in the last true message (or an empty one):
# fields, or a function of the message
SAYS: dict[str, tuple[Any, str, str, Any]] = {
    'telemetry of another place': (m.Telemetry, 'telemetry', 'TELEMETRY', _moved),
    'segments done that are not': (m.SegmentDone, 'segment_done', 'EVENTS', _later('index', 10_000)),
    'ticks of an hour ahead': (m.LeaseTick, 'lease_tick', 'BEAT', _later('controller_us', 3_600_000_000)),
    'machine state of an alarm': (m.MachineState, 'machine_state', 'LATCHED', {'state': 3, 'fault': 300}),
    'machine state disconnected': (m.MachineState, 'machine_state', 'LATCHED', {'connected': False}),
    'override of an operator': (
        m.Override, 'override', 'NEWEST', {'speed_factor': 0.5, 'wire_factor': 1.2, 'source': 'stranger'},
    ),
    'override of NaN and 1000': (m.Override, 'override', 'NEWEST', {'speed_factor': 1000.0, 'wire_factor': math.nan}),
    'factors of a process control': (
        m.Override, 'process_override', 'NEWEST', {'speed_factor': 0.5, 'wire_factor': 0.5},
    ),
    'height maps 5 mm higher': (m.HeightMap, 'height_map', 'LATCHED', _higher),
    'heat factor of 0.3': (m.HeatFactor, 'heat_factor', 'LATCHED', {'factor': 0.3}),
    'heat factor of NaN': (m.HeatFactor, 'heat_factor', 'LATCHED', {'factor': math.nan}),
    'temperature of 3000 degrees': (Temperature, 'temperature', 'BEAT', {'temperature': 3000.0}),
    'temperature of NaN': (Temperature, 'temperature', 'BEAT', {'temperature': math.nan}),
    'temperature of -40 degrees': (Temperature, 'temperature', 'BEAT', {'temperature': -40.0}),
    'clouds of junk': (PointCloud2, 'points', 'SENSOR', _junk),
    'profiles without points': (m.ProfileBatch, 'profiles', 'PROFILES', {}),
    'aim of a pyrometer 1 km away': (PointStamped, 'pyrometer_aim', 'LATCHED', _far),
    'job status failed': (m.JobStatus, 'job_status', 'LATCHED', {'state': 10}),
    'job status of another job': (m.JobStatus, 'job_status', 'LATCHED', {'job_id': 'stranger', 'material': 'unknown'}),
    'next layer without cells': (m.NextLayer, 'next_layer', 'LATCHED', {}),
    'layer plan without segments': (m.LayerPlan, 'layer_plan', 'LATCHED', {}),
    'layer reports of NaN': (m.LayerReport, 'layer_report', 'EVENTS', {}),
}  # fmt: skip


class Stranger:
    """A process on the bus. It speaks from `go` on: what `name` says, or as a node that `beats`."""

    def __init__(self, domain: int, name: str, seed: int = 0) -> None:
        here = Path(__file__).resolve().parent.parent
        code = f'import sys; sys.path.insert(0, {str(here)!r}); from lib.campaign_strangers import speak; speak()'
        command = [sys.executable, '-c', code, str(domain), name, str(seed)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout
        if self._process.stdout.readline().strip() != 'here':
            raise RuntimeError('the stranger did not come')

    def go(self) -> None:
        """Begins to speak."""
        assert self._process.stdin
        self._process.stdin.write('go\n')
        self._process.stdin.flush()

    def wait(self) -> None:
        """Until it has said all."""
        self._process.wait(30.0)

    def close(self) -> None:
        """Leaves the bus."""
        self._process.kill()
        self._process.wait()


def speak() -> None:
    """In the process of a stranger; arguments: domain, what it says ('beats NODE' or one of `names`), seed."""
    import rclpy
    from rclpy.experimental import EventsExecutor

    domain, name, seed = int(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    rclpy.init(domain_id=domain)
    node = rclpy.create_node('stranger')
    executor = EventsExecutor()
    executor.add_node(node)
    turn = _beats(node, name.split()[1]) if name.startswith('beats ') else _says(node, name, seed)
    waiting = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), waiting.set()), daemon=True).start()
    print('here', flush=True)
    while not waiting.is_set():
        executor.spin_once(timeout_sec=PERIOD)
    end = time.monotonic() + (60.0 if name.startswith('beats ') else SECONDS)
    while time.monotonic() < end:
        turn()
        executor.spin_once(timeout_sec=PERIOD)
    os._exit(0)  # what is left of the executor is of no interest


def _says(node: Any, name: str, seed: int) -> Callable[[], None]:
    from waam_node import qos

    kind, topic, quality, change = SAYS[name]
    heard, profile, rng, due = [kind()], getattr(qos, quality), random.Random(seed), [0.0]
    node.create_subscription(kind, topic, heard.append, profile)
    publisher = node.create_publisher(kind, topic, profile)

    def turn() -> None:
        if time.monotonic() >= due[0]:
            due[0], message = time.monotonic() + PERIOD, heard[-1]
            if callable(change):
                change(message, rng)
            else:
                for field, value in change.items():
                    setattr(message, field, value)
            publisher.publish(message)
        del heard[:-1]

    return turn


def _beats(node: Any, name: str) -> Callable[[], None]:
    """Repeats every tick as the node `name`, from the first turn on."""
    from waam_msgs.msg import Heartbeat, LeaseTick
    from waam_node.qos import BEAT

    publisher, speaks = node.create_publisher(Heartbeat, 'heartbeat', BEAT), []

    def repeat(tick: Any) -> None:
        if speaks:
            beat = Heartbeat(node=name, controller_us=tick.controller_us, boot_id=tick.boot_id)
            publisher.publish(beat)

    node.create_subscription(LeaseTick, 'lease_tick', repeat, BEAT)
    return lambda: speaks.append(True) if not speaks else None


def says(name: str) -> Callable[[Graph, random.Random], dict]:
    """A trial in which a stranger publishes `name` for SECONDS while an arc burns."""

    def trial(graph: Graph, rng: random.Random) -> dict:
        live = graph.live()
        stranger, job = Stranger(live.domain, name, rng.randrange(1000)), Job(graph)
        try:
            if not until(lambda: graph.burns() or not job.runs(), 60.0):
                raise RuntimeError('no arc')
            stranger.go()
            stranger.wait()
        finally:
            stranger.close()
        facts = judged(graph, job)
        if 'override' in name or 'factors' in name:
            graph.down()  # they stay in force
        return facts

    return trial


def judged(graph: Graph, job: Job, dead_is_wrong: bool = True) -> dict:
    """The job ended by itself, as if nothing were or with a reason, and no node died. One that pauses and says why is
    aborted, as its text says."""
    until(lambda: not job.runs() or _pause(job), JOB_S)
    paused = _pause(job)
    if paused and job.runs():
        with GraphClient(graph.live().domain) as client:
            client.call(Trigger, 'job_sequencer/abort', Trigger.Request())
    ended = job.wait(JOB_S)
    until(lambda: job.told()[0] in (DONE, *FAILED), 5.0)
    state, message = job.told()
    dead = graph.dead()
    if not ended or dead:
        graph.down()
    rms = job.rms_mm()
    as_ever = state == DONE and rms is not None and rms < UNDISTURBED_MM
    named = state != DONE and bool(message)
    right = ended and not (dead and dead_is_wrong) and (as_ever or named)
    said = (paused or message)[:200]
    return {'ended': state, 'message': said, 'rms_mm': rms, 'dead': dead, 'right': right}


def _pause(job: Job) -> str:
    """Why the job waits for a person; '' = it does not."""
    state, message = job.told()
    return message if state == 'PAUSED' else ''


def beats_of_the_dead(node: str) -> Callable[[Graph, random.Random], dict]:
    """A trial in which a stranger repeats the ticks as `node`, which is killed: its death must not be hidden."""

    def trial(graph: Graph, rng: random.Random) -> dict:
        live = graph.live()
        stranger, job = Stranger(live.domain, f'beats {node}'), Job(graph)
        try:
            if not until(lambda: graph.burns() or not job.runs(), 60.0):
                raise RuntimeError('no arc')
            stranger.go()
            time.sleep(rng.uniform(0.5, 1.5))
            until(lambda: graph.burns() or not job.runs(), 20.0)
            on = graph.burns()
            live.kill(node)
            out = until(lambda: not graph.burns(), 20.0)
            off = graph.off_ms(on)
            facts = judged(graph, job, dead_is_wrong=False)
        finally:
            stranger.close()
        graph.down()
        named = node in f'{facts["message"]} {job.error}'
        return facts | {
            'node': node, 'off_ms': None if off != off else round(off, 1),
            'right': out and facts['right'] and named and not off > LEASE_MS,
        }  # fmt: skip

    return trial


_CROWD = """
import sys, time, rclpy
nodes = []
for i in range(int(sys.argv[2])):
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=int(sys.argv[1]))
    nodes.append(rclpy.create_node(f'participant_{i}', context=context))
print('here', flush=True)
time.sleep(float(sys.argv[3]))
"""


def crowd(graph: Graph, rng: random.Random) -> dict:
    """A trial with PARTICIPANTS more participants on the bus, which come while an arc burns."""
    live, job = graph.live(), Job(graph)
    until(lambda: graph.burns() or not job.runs(), 60.0)
    code = [sys.executable, '-c', _CROWD, str(live.domain), str(PARTICIPANTS), '60']
    with subprocess.Popen(code, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        came = process.stdout.readline().strip() == 'here'
        facts = judged(graph, job)
        process.kill()
    return facts | {'participants': PARTICIPANTS if came else 0}
