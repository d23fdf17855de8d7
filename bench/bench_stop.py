"""STOP while one resource at a time is taken away from a simulated cell.

Each try is a request (the page's STOP, which goes two ways at once; `waam job abort`, from its start; the service of
the bridge; the page's STOP of a robot's cell) and ends when the controller has received the line. One monotonic clock
has both: that of a cable which notes what goes through (lib/stop_tap.py), or of the robot's controller.

stop.latency_p99_ms, stop.latency_worst_ms: over all tries while something is taken away (baseline: idle cell).
stop.latency.bodies_of_strangers_worst_ms, stop.latency.bodies_of_operators_worst_ms,
stop.latency.threads_worst_ms, stop.latency.descriptors_worst_ms, stop.latency.panel_hung_worst_ms,
stop.latency.audit_lock_worst_ms, stop.latency.queue_lock_worst_ms, stop.latency.slow_disk_worst_ms,
stop.latency.hung_disk_worst_ms, stop.latency.full_disk_worst_ms, stop.latency.read_only_disk_worst_ms,
stop.latency.recorder_hung_worst_ms, stop.latency.audit_broken_worst_ms, stop.latency.queue_broken_worst_ms,
stop.latency.busy_worst_ms (40 processes that compute): the worst of each (baseline: idle cell).

What is done to take something away: lib/stop_loads.py. Disks are filled and made read-only only as root, who may mount
them. WAAM_STOP_SHARE=0.2 in the environment makes a fifth of the tries.
"""

from __future__ import annotations

import os
import random
import sys
import time

import numpy as np
from lib.emit import emit
from lib.stop_cell import StopCell
from lib.stop_loads import LOADS, MOUNTS

TRIES = {'gantry': {'panel': 13, 'command': 11, 'service': 9}, 'robot': {'panel': 5}}
SETTLE_S = 0.7  # after something was taken away, and after it was given back
APART_S = (0.03, 0.12)  # between two tries


def measure() -> None:
    share = float(os.environ.get('WAAM_STOP_SHARE', '1'))
    found: dict[str, list[float]] = {name: [] for name in LOADS}
    for machine, ways in TRIES.items():
        with StopCell(machine) as cell:
            for name, load in LOADS.items():
                if name in MOUNTS and not cell.disks:
                    print(f'# {name}: left out, this account may not mount', file=sys.stderr)
                    continue
                with load(cell):
                    time.sleep(SETTLE_S)
                    for way, count in ways.items():
                        took = tries(getattr(cell, way), max(1, round(share * count)))
                        found[name] += took
                        print(
                            f'# {machine} {name} {way}: {told(took)}', file=sys.stderr, flush=True
                        )
                time.sleep(SETTLE_S)
    report(found)


def tries(way, count: int) -> list[float]:
    took = []
    for _ in range(count):
        took.append(way())
        time.sleep(random.uniform(*APART_S))
    return took


def told(took: list[float]) -> str:
    return f'{len(took)} tries, median {np.median(took):.1f} ms, worst {max(took):.1f} ms'


def report(found: dict[str, list[float]]) -> None:
    idle = found.pop('idle')
    loaded = [x for took in found.values() for x in took]
    print(f'# {len(loaded) + len(idle)} tries', file=sys.stderr)
    p99, base = (float(np.percentile(x, 99)) for x in (loaded, idle))
    emit('stop.latency_p99_ms', p99, 'ms', 'idle cell', round(base, 3))
    emit('stop.latency_worst_ms', max(loaded), 'ms', 'idle cell', round(max(idle), 3))
    for name, took in found.items():
        if took:
            emit(f'stop.latency.{name}_worst_ms', max(took), 'ms', 'idle cell', round(max(idle), 3))


FIGURES = {
    'stop.latency_p99_ms': measure, 'stop.latency_worst_ms': measure,
    **{f'stop.latency.{name}_worst_ms': measure for name in LOADS if name != 'idle'},
}  # fmt: skip
