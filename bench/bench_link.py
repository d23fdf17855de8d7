"""The link between bridge and controller: speed beside Printrun's printcore, overrides, telemetry, clock, noise, kills.

link.segments_per_s: segments per second of wall time through bridge core, transport and a real pseudo-terminal into
    the virtual controller (`--rate 0`), executed; baseline: lines per second of printcore, same run
link.host_us_per_segment: CPU of the host process per segment; baseline: printcore's per line
link.override_p99_ms: wall time from the request for an override to the first telemetry frame (1 kHz) that shows it in
    force, while segments are streamed in real time; baseline: limit of 5 ms. The time to the controller's answer, which
    is shorter, goes to stderr, and so does the longest time that this process was kept from running meanwhile
link.telemetry_1khz_lost: frames missing (sequence numbers) at 1 kHz while segments are streamed in real time;
    baseline: frames received. WAAM_BENCH_LINK_S seconds (60; 600 = the requirement)
link.clock_residual_p99_ms: over the same time, how far the fitted line was from the fastest round trip of the next
    two seconds, before it was fitted anew. Limit: 0.2 ms
link.third_outcomes: the noise campaign (waam_bridge/test/bridge_campaign.py: the real bridge core and the real C core
    in one process, real bytes both ways); baseline: segments. WAAM_BENCH_NOISE segments (20000; 1000000 = the
    requirement)
arc.off_max_ms: age of the lease, in controller time, when the arc went off after kill -9 of the host or a pulled
    terminal; the outputs of a killed controller die with it and count 0. Limit: 500 ms.
    WAAM_BENCH_KILLS moments (9; 200 = the requirement). A scene that a busy computer has upset is set up anew, five
    times at most; how often goes to stderr

Without Printrun the two baselines are null. With the defaults it takes about 3 minutes, with WAAM_BENCH_LINK_S=600 and
WAAM_BENCH_KILLS=200 some 20; WAAM_BENCH_NOISE=1000000 takes an hour of its own. Each part says on stderr how long it
took, and nothing waits without a limit.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from emit import emit

NAMES = [
    'link.segments_per_s',
    'link.host_us_per_segment',
    'link.override_p99_ms',
    'link.telemetry_1khz_lost',
    'link.clock_residual_p99_ms',
    'link.third_outcomes',
    'arc.off_max_ms',
]
ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / 'waam_ws/src/waam_bridge/test'
JOB = 20_000  # segments of the speed run
PRINTCORE_JOB = 2_000  # it sends about 600 lines per second
OVERRIDES = 400
SWITCH_INTERVAL = 0.001  # s, as in the node
UPSET_MOST = 5


def main() -> None:
    sys.path.insert(0, str(TESTS))
    with tempfile.TemporaryDirectory(prefix='waam_link_') as scratch:
        folder = Path(scratch)
        part('speed', speed, folder)
        part('steady', steady, folder, float(os.environ.get('WAAM_BENCH_LINK_S', '60')))
        part('noise', noise, int(os.environ.get('WAAM_BENCH_NOISE', '20000')))
        part('kills', kills, folder, int(os.environ.get('WAAM_BENCH_KILLS', '9')))


def part(name: str, run, *args) -> None:
    """One part that fails does not take the others with it."""
    began = time.monotonic()
    try:
        run(*args)
        said = 'took'
    except (AssertionError, TimeoutError, OSError) as e:
        said = f'failed: {e}; after'
    print(f'bench_link: {name} {said} {time.monotonic() - began:.0f} s', file=sys.stderr)


class Controller:
    """A virtual controller process."""

    def __init__(self, folder: Path, *options: str) -> None:
        from bridge_harness import virtual_controller

        self.path = folder / 'tty'
        self.process = subprocess.Popen(
            [virtual_controller(), '--null-plant', '--pty-link', self.path, *options],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout.readline().startswith('ready')

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(10)
        self.process.stdout.close()


def connect(path: Path, **params):
    """The bridge's core and transport on this port, homed."""
    from bridge_light import Light

    from waam_bridge import commands, frames

    light = Light(str(path), quiet=True, **params)
    bridge = light.bridge
    light.until(lambda: bridge.connected and bridge.position)
    if bridge.state == frames.ALARM:  # just switched on
        light.command(commands.RESET)
    light.command(commands.HOME)
    light.until(lambda: bridge.flags & frames.HOMED and bridge.state == frames.IDLE)
    return light


def zigzag(count: int, start, first: int, step: float, speed: float):
    """`count` segments of `step` m to and fro along x."""
    from waam_process.segment import Kind, Segment

    x, y, z = start
    ends = [(x, y, z), (x + step, y, z)]
    return [
        Segment(
            index=first + i, kind=Kind.IDLE, start=ends[i % 2], end=ends[(i + 1) % 2], speed=speed
        )
        for i in range(count)
    ]


def give(light, segments, job: str) -> None:
    from waam_bridge import program

    with light.lock:
        permit = light.bridge.permit(job, segments)
    batch = program.prepare(permit, segments, True)
    with light.lock:
        light.bridge.commit(permit, batch)


def speed(folder: Path) -> None:
    """Both hosts on the same kind of job; each measured alone, in its own process time."""
    controller = Controller(folder, '--rate', '0', '--start', '0.5,0.5,199.5')
    light = connect(controller.path)
    segments = zigzag(JOB, light.bridge.position, 0, 5e-5, 0.5)
    wall, cpu = time.monotonic(), time.process_time()
    give(light, segments, 'speed')
    light.until(lambda: not light.bridge.queued)
    ours = JOB / (time.monotonic() - wall)
    ours_cpu = (time.process_time() - cpu) / JOB * 1e6
    light.transport.close()
    controller.close()
    theirs, theirs_cpu = printcore_speed(folder)
    emit('link.segments_per_s', ours, '1/s', 'printcore, same run', theirs)
    emit('link.host_us_per_segment', ours_cpu, 'us CPU', 'printcore, same run', theirs_cpu)


def printcore_speed(folder: Path) -> tuple[float | None, float | None]:
    """Lines per second and CPU per line (us) of Printrun, or None where it is not installed."""
    try:
        from printrun import gcoder, printcore
    except ImportError:
        print('bench_link: Printrun is not installed, no baseline', file=sys.stderr)
        return None, None
    controller = Controller(folder, '--rate', '0', '--start', '0.5,0.5,199.5')
    core = printcore.printcore()
    core.connect(str(controller.path), 115200)
    until(lambda: core.online, 'printcore is online')
    core.send_now('M999')  # leaves the ALARM of a controller that was just switched on
    job = [
        'G28',
        'G91',
        *(f'G1 X{0.05 if i % 2 else -0.05} F30000' for i in range(1, PRINTCORE_JOB)),
    ]
    wall, cpu = time.monotonic(), time.process_time()
    core.startprint(gcoder.LightGCode(job))
    until(lambda: not core.printing, 'printcore has printed')
    lines = PRINTCORE_JOB / (time.monotonic() - wall)
    used = (time.process_time() - cpu) / PRINTCORE_JOB * 1e6
    core.disconnect()
    controller.close()
    return lines, used


def until(condition, what: str, limit: float = 120.0) -> None:
    end = time.monotonic() + limit
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f'{what}: not within {limit:.0f} s')
        time.sleep(0.005)


def steady(folder: Path, seconds: float) -> None:
    """Real time, 1 kHz telemetry, segments of 1 mm at 50 mm/s without end, overrides in between."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    controller = Controller(folder, '--rate', '1', '--start', '0.5,0.5,199.5')
    light = connect(controller.path, telemetry_rate=1000.0)
    bridge, link = light.bridge, light.bridge.link
    stop = threading.Event()
    feeder = threading.Thread(target=keep_streaming, args=(light, stop), daemon=True)
    feeder.start()
    light.until(lambda: bridge.queued > 100)
    stalls = Stalls()
    received, lost = link.received, link.lost
    end = time.monotonic() + seconds
    pause = seconds / OVERRIDES
    waits = [override_wait(light, 900 + n % 200, pause) for n in range(OVERRIDES)]
    while time.monotonic() < end:
        time.sleep(0.1)
    received, lost = link.received - received, link.lost - lost
    stop.set()
    feeder.join()
    residual = link.clock.residual
    light.transport.close()
    controller.close()
    answered, shown = (sorted(column) for column in zip(*waits, strict=True))
    p99 = int(0.99 * OVERRIDES)
    print(
        f'bench_link: overrides answered p50 {answered[OVERRIDES // 2]:.2f} p99 {answered[p99]:.2f} ms, '
        f'shown p50 {shown[OVERRIDES // 2]:.2f} p99 {shown[p99]:.2f} ms; '
        f'kept from running for {stalls.end():.1f} ms at most',
        file=sys.stderr,
    )
    emit('link.override_p99_ms', shown[p99], 'ms', 'limit', 5.0)
    emit('link.telemetry_1khz_lost', lost, 'frames', 'frames received', float(received))
    emit('link.clock_residual_p99_ms', residual * 1e3, 'ms', 'limit', 0.2)


def keep_streaming(light, stop: threading.Event) -> None:
    bridge, start, index = light.bridge, light.bridge.position, 0
    while not stop.is_set():
        if bridge.queued < 300:
            give(light, zigzag(200, start, index, 1e-3, 0.05), 'steady')
            index += 200
        time.sleep(0.05)


def override_wait(light, permille: int, pause: float) -> tuple[float, float]:
    """ms until the controller has answered, and until a frame has shown it in force; inf after 2 s."""
    answered, shown = threading.Event(), threading.Event()
    times = [math.inf, math.inf]

    def mark(which: int, event: threading.Event) -> None:
        if not event.is_set():
            times[which] = (time.monotonic() - began) * 1e3
            event.set()

    light.on_frame = lambda frame: frame.speed_permille == permille and mark(1, shown)
    with light.lock:
        began = time.monotonic()
        light.bridge.link.ask('V', f'{permille} 1000', lambda code, text: mark(0, answered), began)
        light.on_idle()
    shown.wait(2.0)
    time.sleep(max(0.0, began + pause - time.monotonic()))
    return times[0], times[1]


class Stalls:
    """How long the computer keeps a thread waiting that asks for a millisecond of sleep: what no program can better."""

    def __init__(self) -> None:
        self._worst, self._stop = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            before = time.monotonic()
            time.sleep(0.001)
            self._worst = max(self._worst, time.monotonic() - before - 0.001)

    def end(self) -> float:
        """ms."""
        self._stop.set()
        self._thread.join()
        return self._worst * 1e3


def noise(segments: int) -> None:
    from bridge_campaign import Campaign
    from rich.progress import Progress

    with Progress(transient=True) as bar:
        task = bar.add_task('noise campaign', total=segments)
        report = Campaign(segments, seed=11).run(lambda done: bar.update(task, completed=done))
    for text in report.third:
        print(f'bench_link: third outcome: {text}', file=sys.stderr)
    print(f'bench_link: {report}', file=sys.stderr)
    emit('link.third_outcomes', len(report.third), '1', 'segments', float(report.segments))


def kills(folder: Path, count: int) -> None:
    from bridge_harness import virtual_controller
    from bridge_kill import KINDS, Scene
    from rich.progress import track

    ages: list[float] = []
    upset = 0
    scene = Scene(folder, virtual_controller(), seed=7)
    try:
        for n in track(range(count), 'kills', transient=True):
            try:
                ages.append(scene.kill(KINDS[n % 3]))
            except (AssertionError, OSError) as e:
                upset += 1
                print(f'bench_link: {KINDS[n % 3]}, moment {n}: {e}', file=sys.stderr)
                if upset > UPSET_MOST or 'struck' in str(e):
                    raise
                scene.close()
                scene = Scene(folder, virtual_controller(), seed=7 + n)
    finally:
        scene.close()
    print(f'bench_link: {len(ages)} kills, {upset} scenes upset', file=sys.stderr)
    emit('arc.off_max_ms', max(ages), 'ms', 'limit', 500.0)


if __name__ == '__main__':
    main()
