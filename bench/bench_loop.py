"""The demo job, open loop and closed loop on the same part and seed, as real processes on the simulated cell.

On the preset that users get, or on that of WAAM_BENCH_PRESET.

loop.rms_ratio: closed / open RMS height error (the open loop of the same run is the baseline);
loop.sim_speed: simulated seconds per second of wall time, start-up and reports included (baseline: real time);
loop.seconds_per_simulated_hour: the same, the other way round;
link.telemetry_lost: frames missing in both jobs (baseline: frames that the bridge received).
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

from lib.preset import emit_on_cell as emit
from lib.preset import preset

from waam_process.operating import DEFAULT_PRESET


def demo() -> None:
    """Runs the demo in a temporary folder and reads its report and record."""
    from waam_bringup.demo import run_demo
    from waam_node import job_folder

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        modes, cell = ['open_loop', 'closed_loop'], preset(DEFAULT_PRESET)
        args = SimpleNamespace(
            seed=7,
            machine='gantry',
            jobs=Path(scratch),
            layers=0,
            loop_modes=modes,
            rate=0.0,
            fresh=True,
            preset=cell,
        )
        started = time.monotonic()
        stdout, sys.stdout = sys.stdout, sys.stderr
        try:
            run_demo(args)
        finally:
            sys.stdout = stdout
        wall = time.monotonic() - started
        folder = (Path(scratch) / job_folder.LATEST).resolve()
        report = json.loads((folder / job_folder.REPORT).read_text())
        opened, closed = report['open_loop'], report['closed_loop']
        emit(
            'loop.rms_ratio',
            closed['rms_mm'] / opened['rms_mm'],
            '1',
            'open loop, same run',
            1.0,
            cell,
        )
        machine = opened['duration_s'] + closed['duration_s']
        emit('loop.sim_speed', machine / wall, 's/s', 'real time', 1.0, cell)
        emit(
            'loop.seconds_per_simulated_hour', 3600 * wall / machine, 's', 'real time', 3600.0, cell
        )
        lost = opened['telemetry_lost'] + closed['telemetry_lost']
        emit('link.telemetry_lost', lost, 'frames', 'frames of the two jobs', machine * 100, cell)


FIGURES = {
    'loop.rms_ratio': demo,
    'loop.sim_speed': demo,
    'loop.seconds_per_simulated_hour': demo,
    'link.telemetry_lost': demo,
}
