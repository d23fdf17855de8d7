"""One long job on the simulated cell, with the memory of every process looked at as simulated time goes by.

A tall block is built below an interpass limit that is set low, so that the cell waits before most layers, as a real
one does. When the hours are over the job is aborted, which is its ordinary safe end.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .job_part import SEED, goal
from .preset import preset

DOMAIN = int(os.environ.get('WAAM_BENCH_DOMAIN', 217))
BLOCK = (70.0, 50.0, 150.0)  # mm: as high as the machine allows, 75 layers
INTERPASS_C = float(os.environ.get('WAAM_BENCH_INTERPASS', 60.0))  # long enough waits
LAYER = 0.002  # m, height of a layer by the defaults
EVERY = 600.0  # s of simulated time between two samples
NAMES = (
    'idle', 'validating', 'preparing', 'cooling', 'scanning', 'correcting', 'depositing', 'paused', 'finishing',
    'done', 'failed', 'aborted',
)  # fmt: skip
SILENT_S = 120.0  # s without a status after which the run is given up


@dataclass
class Endurance:
    """samples: (simulated s, wall s, {process: MB}); scans: simulated s at which the scan after a layer began."""

    hours: float
    pids: dict[str, int]
    file: Path | None = None
    every: float = EVERY
    begin: float = 0.0
    start: float = 0.0
    now: float = 0.0
    news: float = field(default_factory=time.monotonic)
    samples: list[tuple[float, float, dict[str, float]]] = field(default_factory=list)
    scans: dict[int, float] = field(default_factory=dict)
    asked: bool = False
    phases: dict[str, list[float]] = field(default_factory=dict)  # simulated s, wall s, CPU s
    by_layer: dict[str, dict[int, float]] = field(default_factory=dict)  # phase: layer: simulated s
    last: tuple[str, int, float, float, float] | None = None

    def on_status(self, status) -> None:
        """Callback of the job."""
        self.news = time.monotonic()
        stamp = status.header.stamp
        t = stamp.sec + stamp.nanosec * 1e-9
        if status.state < status.PREPARING or t <= 0:
            return
        if not self.begin:
            self.begin, self.start = t, self.news
        self.now = t - self.begin
        self._phase(NAMES[status.state], status.layer)
        if status.state == status.SCANNING:
            self.scans.setdefault(status.layer, self.now)
        if self.now >= len(self.samples) * self.every:
            self._sample(status.layer)

    @property
    def over(self) -> bool:
        return self.now >= self.hours * 3600

    def _phase(self, name: str, layer: int) -> None:
        """Adds what has passed to the phase in which it passed; looked at when the phase changes."""
        if self.last and self.last[0] == name:
            return
        spent = sum(cpu_seconds(pid) for pid in self.pids.values())
        if self.last:
            old, there, *before = self.last
            gone = (self.now - before[0], self.news - before[1], spent - before[2])
            total = self.phases.setdefault(old, [0.0, 0.0, 0.0])
            self.phases[old] = [a + b for a, b in zip(total, gone, strict=True)]
            layers = self.by_layer.setdefault(old, {})
            layers[there] = layers.get(there, 0.0) + gone[0]
        self.last = (name, layer, self.now, self.news, spent)

    def drift(self, phase: str) -> float:
        """Simulated s that a phase got longer from the third layer to the last, by a straight line."""
        turns = sorted((k, v) for k, v in self.by_layer[phase].items() if k > 2)
        if len(turns) < 3:
            return float('nan')
        layers, seconds = np.array(turns[:-1]).T  # the last one was cut off
        return float(np.polyfit(layers, seconds, 1)[0] * (layers[-1] - layers[0]))

    def _sample(self, layer: int) -> None:
        memory = {name: resident(pid) for name, pid in self.pids.items()}
        wall = time.monotonic() - self.start
        self.samples.append((self.now, wall, memory))
        line = {'sim_s': self.now, 'wall_s': wall, 'layer': layer, 'mb': memory}
        if self.file:
            with open(self.file, 'a') as f:
                f.write(json.dumps(line) + '\n')
        print(
            f'{self.now / 3600:.2f} h of {self.hours:g}: layer {layer}, {sum(memory.values()):.0f} MB, '
            f'{self.now / max(wall, 1e-9):.1f} simulated seconds a second',
            file=sys.stderr,
            flush=True,
        )

    def growth(self) -> tuple[float, float, dict[str, float]]:
        """(growth of all after the first hour, or after the first third of a shorter run, in %; MB then; by process).

        A straight line through the samples after that: one sample is noise.
        """
        settle = min(3600.0, self.hours * 1200)
        later = [(t, m) for t, _, m in self.samples if t >= settle]
        if len(later) < 3:
            raise RuntimeError(f'{len(later)} samples after settling are too few; run longer')
        t = np.array([s[0] for s in later])
        rows = np.array([[s[1][n] for n in self.pids] for s in later])
        slope, first = np.polyfit(t - t[0], rows, 1)
        gained = slope * (t[-1] - t[0])
        by_process = dict(zip(self.pids, 100 * gained / first, strict=True))
        return float(100 * gained.sum() / first.sum()), float(first.sum()), by_process


def resident(pid: int) -> float:
    """MB of a process, 0 when it is gone."""
    with suppress(OSError):
        pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE') / 1e6
    return 0.0


def cpu_seconds(pid: int) -> float:
    """Processor time of a process so far, 0 when it is gone."""
    with suppress(OSError):
        fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    return 0.0


def write_block(folder: Path) -> Path:
    from waam_node.stl import block, write_stl

    folder.mkdir(parents=True, exist_ok=True)
    x, y, z = (np.array([0.0, v]) for v in BLOCK)
    write_stl(folder / 'block.stl', block(np.full((2, 2), z[1]), x, y), 'block')
    return folder / 'block.stl'


def parameters(scratch: Path) -> Path:
    """The interpass limit, and the pyrometer aimed at the block instead of at the middle of the plate."""
    file = scratch / 'parameters.yaml'
    nodes = {
        'thermal_compensator': {'interpass_limit': INTERPASS_C},
        'cell': {'pyrometer_spot_x': 5e-4 * BLOCK[0], 'pyrometer_spot_y': 5e-4 * BLOCK[1]},
    }
    file.write_text(json.dumps({n: {'ros__parameters': p} for n, p in nodes.items()}))
    return file


def run_long_job(scratch: Path, hours: float, file: Path | None) -> tuple[Endurance, dict]:
    """The samples and the report's run. RuntimeError when the job ended by itself before its time."""
    from waam_bringup import run_state
    from waam_bringup.graph import Settings
    from waam_bringup.operate import graph_trouble
    from waam_bringup.test_support import power_on
    from waam_msgs.action import RunJob
    from waam_node import job_folder
    from waam_process.operating import BUILD_PLATE

    scratch.mkdir(parents=True, exist_ok=True)
    settings = Settings(
        run=scratch / 'run', seed=SEED, params_files=(parameters(scratch),), preset=preset()
    )
    with power_on(settings, DOMAIN) as (client, _):
        pids = {n: s.pid for n, s in run_state.load(scratch / 'run').nodes.items()}
        watch = Endurance(hours, pids, file, min(EVERY, hours * 3600 / 24))
        client.load_part('', BUILD_PLATE, SEED)

        def alive() -> str:
            if watch.over and not watch.asked:
                watch.asked = True
                client.trigger('job_sequencer/abort')
            silent = time.monotonic() - watch.news > SILENT_S
            return graph_trouble(scratch / 'run') or ('the job is silent' if silent else '')

        request = goal(
            write_block(scratch / 'part'), scratch / 'jobs', mode='build', name='endurance'
        )
        result = client.run_job(request, watch.on_status, alive)
    if result.error_code != RunJob.Result.ABORTED:
        raise RuntimeError(f'the job ended before its time: {result.message}')
    report = json.loads((Path(result.job_dir) / job_folder.REPORT).read_text())
    return watch, report['closed_loop']


def loop_periods(watch: Endurance, run: dict) -> tuple[np.ndarray, np.ndarray]:
    """(layers (n,), s (n,)): from the scan after one layer to the scan after the next, without the interpass wait, the
    deposition and the planned moves of the scan (the way down to it gets shorter as the block grows): what map,
    correction, setpoints and the job itself take. From the third layer on."""
    layers, periods = [], []
    for record in run['layers']:
        k = record['layer']
        if k > 2 and k in watch.scans and k - 1 in watch.scans:
            whole = watch.scans[k] - watch.scans[k - 1]
            layers.append(k)
            moves = scan_moves((k - 1) * LAYER)
            periods.append(whole - record['wait'] - record['duration'] - moves)
    return np.array(layers), np.array(periods)


def scan_moves(top: float) -> float:
    """Planned s of a scan of the block when it is `top` m high, from the height of idle moves."""
    from waam_job.ros.job_params import JobParams
    from waam_plan.layers.scanning import scan_segments
    from waam_plan.settings import PlanSettings

    settings = PlanSettings()
    (x, y, z), m = (1e-3 * v for v in BLOCK), JobParams().margin
    start = (0.0, 0.0, z + settings.clearance)
    return sum(s.duration for s in scan_segments((-m, -m, x + m, y + m), top, settings, start))
