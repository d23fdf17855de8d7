"""The demo job, open loop and closed loop on the same part and seed, as real processes on the simulated cell.

loop.rms_ratio: closed / open RMS height error (the open loop of the same run is the baseline);
loop.sim_speed: simulated seconds per second of wall time, start-up and reports included (baseline: real time);
loop.seconds_per_simulated_hour: the same, the other way round;
link.telemetry_lost: frames missing in both jobs (baseline: frames that the bridge received);
scan.profile_to_map_ms: last profile in to map out, worst of the scans (baseline: what issue "Scan" asks for).
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

from emit import emit

NAMES = [
    'loop.rms_ratio',
    'loop.sim_speed',
    'loop.seconds_per_simulated_hour',
    'link.telemetry_lost',
    'scan.profile_to_map_ms',
]


def main() -> None:
    """Runs the demo in a temporary folder and reads its report and record."""
    from waam_bringup.demo import run_demo

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        args = SimpleNamespace(
            seed=7, jobs=Path(scratch), layers=0, profiles=['open_loop', 'closed_loop'], rate=0.0
        )
        started = time.monotonic()
        stdout, sys.stdout = sys.stdout, sys.stderr
        try:
            run_demo(args)
        finally:
            sys.stdout = stdout
        wall = time.monotonic() - started
        folder = (Path(scratch) / 'latest').resolve()
        report = json.loads((folder / 'report.json').read_text())
        opened, closed = report['open_loop'], report['closed_loop']
        emit('loop.rms_ratio', closed['rms_mm'] / opened['rms_mm'], '1', 'open loop, same run', 1.0)
        machine = opened['duration_s'] + closed['duration_s']
        emit('loop.sim_speed', machine / wall, 's/s', 'real time', 1.0)
        emit('loop.seconds_per_simulated_hour', 3600 * wall / machine, 's', 'real time', 3600.0)
        lost = opened['telemetry_lost'] + closed['telemetry_lost']
        emit('link.telemetry_lost', lost, 'frames', 'frames of the two jobs', machine * 100)
        emit('scan.profile_to_map_ms', worst_latency(folder), 'ms', 'limit of the scan issue', 50.0)


def worst_latency(folder: Path) -> float:
    """Largest map latency (ms) that scan_fusion reported in /diagnostics, from the records of both jobs."""
    from rosbags.highlevel import AnyReader

    worst = float('nan')
    for record in folder.glob('*/record'):
        with AnyReader([record]) as reader:
            connections = [c for c in reader.connections if c.topic == '/diagnostics']
            for connection, _, raw in reader.messages(connections=connections):
                for status in reader.deserialize(raw, connection.msgtype).status:
                    if status.hardware_id != 'scan_fusion':
                        continue
                    values = {v.key: v.value for v in status.values}
                    latency = float(values.get('map_latency_ms', 'nan'))
                    worst = max(worst, latency) if worst == worst else latency
    return worst


if __name__ == '__main__':
    main()
