"""The demo job, open loop and closed loop on the same part and seed, as real processes on the simulated cell.

On the preset that users get, or on that of WAAM_BENCH_PRESET.

loop.rms_ratio: closed / open RMS height error (the open loop of the same run is the baseline);
loop.sim_speed: simulated seconds per second of wall time, start-up and reports included (baseline: real time);
link.telemetry_lost: frames missing in both jobs (baseline: frames that the bridge received).
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from lib.demo import demo
from lib.preset import emit_on_cell as emit
from lib.preset import preset

from waam_process.operating import DEFAULT_PRESET


def loop() -> None:
    """Runs the demo in a temporary folder and reads its report."""
    cell = preset(DEFAULT_PRESET)
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        report, wall = demo(Path(scratch), 7, ('open_loop', 'closed_loop'), cell)
    opened, closed = report['open_loop'], report['closed_loop']
    ratio = closed['rms_mm'] / opened['rms_mm']
    machine = opened['duration_s'] + closed['duration_s']
    emit('loop.rms_ratio', ratio, '1', 'open loop, same run', 1.0, cell)
    emit('loop.sim_speed', machine / wall, 's/s', 'real time', 1.0, cell)
    lost = opened['telemetry_lost'] + closed['telemetry_lost']
    emit('link.telemetry_lost', lost, 'frames', 'frames of the two jobs', machine * 100, cell)


FIGURES = dict.fromkeys(('loop.rms_ratio', 'loop.sim_speed', 'link.telemetry_lost'), loop)
