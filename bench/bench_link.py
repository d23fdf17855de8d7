"""The link between bridge and controller: speed, overrides, telemetry, clock.

link.segments_per_s: segments per second of wall time through bridge core, transport and a real pseudo-terminal into
    the virtual controller (`--rate 0`), executed; link.host_us_per_segment: CPU of the host process per segment;
    baselines: lines of Printrun's printcore, as once measured
link.override_p99_ms: wall time from the request for an override to the first telemetry frame (1 kHz) that shows it in
    force, while segments are streamed in real time; baseline: limit of 5 ms
link.telemetry_1khz_lost: frames missing (sequence numbers) at 1 kHz while segments are streamed in real time;
    baseline: frames received. WAAM_BENCH_LINK_S seconds (60; 600 for a verdict)
link.clock_residual_p99_ms: over the same time, how far the fitted line was from the fastest round trip of the next
    two seconds, before it was fitted anew. Limit: 0.2 ms
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lib.emit import emit
from lib.paths import SOURCES

if TYPE_CHECKING:
    from bridge_light import Light

sys.path.insert(0, str(SOURCES / 'waam_bridge' / 'test'))
JOB = 20_000  # segments of the speed run
PRINTCORE_PER_S, PRINTCORE_US = 49.0, 1056.0  # as measured beside it (docs/performance.md)
OVERRIDES = 400
SWITCH_INTERVAL = 0.001  # s, as in the node
START = '0.5,0.5,199.5'  # mm, where the machine stands
STEADY_S = float(os.environ.get('WAAM_BENCH_LINK_S', '60'))


@contextmanager
def controller(*options: str) -> Iterator[Path]:
    """A virtual controller's port. Its process ends with the block, whatever happens in it."""
    from bridge_harness import virtual_controller

    with tempfile.TemporaryDirectory(prefix='waam_link_') as folder:
        path = Path(folder) / 'tty'
        command = [virtual_controller(), '--null-plant', '--pty-link', path, *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                said = process.stdout.readline()
                assert said.startswith('ready'), f'the controller does not start: {said!r}'
                yield path
            finally:
                process.kill()


@contextmanager
def connected(rate: int, **params) -> Iterator[Light]:
    """The bridge's core and transport on a controller of `rate` times real time, homed."""
    from bridge_light import Light

    with controller('--rate', str(rate), '--start', START) as path:
        light = Light(str(path), quiet=True, **params)
        try:
            home(light)
            yield light
        finally:
            light.transport.close()


def home(light: Light) -> None:
    """A controller that was just switched on is in ALARM and not homed."""
    from waam_bridge import commands, frames

    bridge = light.bridge
    light.until(lambda: bridge.connected)
    if bridge.state == frames.ALARM:
        light.command(commands.RESET)
    light.command(commands.HOME)
    light.until(lambda: bridge.flags & frames.HOMED and bridge.state == frames.IDLE)


def zigzag(count: int, start, first: int, step: float, speed: float):
    """`count` segments of `step` m to and fro along x."""
    from waam_process.segment import Kind, Segment

    x, y, z = start
    ends = [(x, y, z), (x + step, y, z)]
    way = [(ends[i % 2], ends[(i + 1) % 2]) for i in range(count)]
    return [Segment(first + i, Kind.IDLE, a, b, speed) for i, (a, b) in enumerate(way)]


def give(light, segments, job: str) -> None:
    from waam_bridge import program

    with light.lock:
        permit = light.bridge.permit(job, segments)
    batch = program.prepare(permit, segments, True)
    with light.lock:
        light.bridge.commit(permit, batch)


def speed() -> None:
    """As fast as the controller takes them."""
    with connected(rate=0) as light:
        segments = zigzag(JOB, light.bridge.position, 0, 5e-5, 0.5)
        wall, cpu = time.monotonic(), time.process_time()
        give(light, segments, 'speed')
        light.until(lambda: not light.bridge.queued)
        rate = JOB / (time.monotonic() - wall)
        each = (time.process_time() - cpu) / JOB * 1e6
    emit('link.segments_per_s', rate, '1/s', 'printcore of Printrun, lines', PRINTCORE_PER_S)
    emit('link.host_us_per_segment', each, 'us CPU', 'printcore of Printrun, lines', PRINTCORE_US)


def steady() -> None:
    """Real time, 1 kHz telemetry, segments of 1 mm at 50 mm/s without end, overrides in between."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    with connected(rate=1, telemetry_rate=1000.0) as light, streaming(light):
        link = light.bridge.link
        received, lost = link.received, link.lost
        pause = STEADY_S / OVERRIDES
        shown = [override_wait(light, 900 + n % 200, pause) for n in range(OVERRIDES)]
        received, lost = link.received - received, link.lost - lost
        residual = link.clock.residual
    p50, p99 = np.quantile(shown, (0.5, 0.99))
    print(f'link: overrides shown p50 {p50:.2f} p99 {p99:.2f} ms', file=sys.stderr)
    emit('link.override_p99_ms', p99, 'ms', 'limit', 5.0)
    emit('link.telemetry_1khz_lost', lost, 'frames', 'frames received', float(received))
    emit('link.clock_residual_p99_ms', residual * 1e3, 'ms', 'limit', 0.2)


@contextmanager
def streaming(light: Light) -> Iterator[None]:
    """Segments are streamed without end during the block."""
    stop = threading.Event()
    feeder = threading.Thread(target=keep_streaming, args=(light, stop), daemon=True)
    feeder.start()
    try:
        light.until(lambda: light.bridge.queued > 100)
        yield
    finally:
        stop.set()
        feeder.join()


def keep_streaming(light, stop: threading.Event) -> None:
    bridge, start, index = light.bridge, light.bridge.position, 0
    while not stop.is_set():
        if bridge.queued < 300:
            give(light, zigzag(200, start, index, 1e-3, 0.05), 'steady')
            index += 200
        time.sleep(0.05)


def override_wait(light, permille: int, pause: float) -> float:
    """ms until a frame has shown the override in force; inf after 2 s."""
    shown, times = threading.Event(), [math.inf]

    def look(frame) -> None:
        if frame.speed_permille == permille and not shown.is_set():
            times[0] = (time.monotonic() - began) * 1e3
            shown.set()

    light.on_frame = look
    with light.lock:
        began = time.monotonic()
        light.bridge.link.ask('V', f'{permille} 1000', lambda code, text: None, began)
        light.on_idle()
    shown.wait(2.0)
    time.sleep(max(0.0, began + pause - time.monotonic()))
    return times[0]


FIGURES = {
    'link.segments_per_s': speed, 'link.host_us_per_segment': speed, 'link.override_p99_ms': steady,
    'link.telemetry_1khz_lost': steady, 'link.clock_residual_p99_ms': steady,
}  # fmt: skip
