"""Kills while a layer is corrected within, in the laboratory: job, bridge core and the controller's code.

Of the nodes only their heartbeats exist here; bench/lib/inlayer_cuts.py kills real processes. A kill is a copy of this
process (fork) in which something dies; the job itself goes on to its end.
"""

from __future__ import annotations

import json
import os
import signal
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from waam_lab.cell import LabCell

CHANGED = {
    'job_sequencer': {'in_layer': True, 'in_layer_period': 3.0, 'in_layer_preview': 2.0},
    # the wire gives less than the table says: there is something to correct
    'cell': {'metal_transfer': 0.7},
}
NODES = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'recorder', 'job_sequencer',
)  # fmt: skip
KINDS = (*NODES, 'bridge')
OUT_LIMIT = 3.0  # s after which an arc counts as never out
MEAN = 3.0  # s of arc between two kills
SOON = 1.0  # s after a correction in which one falls, too
HANGS = 60  # s on the wall after which a copy is given up


@dataclass(frozen=True)
class Kill:
    """kind: what died; at: s of arc after the first correction; since: s after the last one; off: s until the arc was
    out; replaced: corrections that were in force."""

    kind: str
    at: float
    since: float
    off: float
    replaced: int


def long_part(folder: Path, depth: float = 2.0) -> tuple[Path, Path]:
    """A long narrow trough: its far end is under the scanner while beads begin at the near one."""
    from waam_node.stl import write_worn_block

    x, y = np.linspace(0, 96, 49), np.linspace(0, 30, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(np.abs(gx - 48) / 44, np.abs(gy - 15) / 12)
    return write_worn_block(folder, x, y, 12.0, depth * np.clip(6 * (1 - away), 0, 1))


class Watched(LabCell):
    """With the heartbeats of NODES; kills copies of itself."""

    def __init__(self, seed, *args):
        self.kills: list[Kill] = []
        self._rng = np.random.default_rng([seed, 8])
        self._kind, self._died, self._pipe = '', 0.0, 0
        self._when = (0.0, 0.0, 0)
        self._burnt, self._replaced, self._last = 0.0, 0, 0.0
        self._due, self._soon = self._rng.exponential(MEAN), np.inf
        self._turn = seed
        super().__init__(*args)

    def _on_frame(self, t):
        bridge = self.device.bridge
        for node in NODES:
            if node != self._kind:
                bridge.beat(node, t.t_us, bridge.link.boot, self.device.now)
        super()._on_frame(t)

    def replace(self, job_id, segments, last):
        answer = super().replace(job_id, segments, last)
        if answer[1]:
            self._replaced, self._last = self._replaced + 1, self.now()
            self._soon = self._last + self._rng.uniform(0, SOON)
        return answer

    def _on_exchange(self, samples, plant):
        super()._on_exchange(samples, plant)
        if self._kind:
            self._out(plant)
        elif plant.arc_on and self._replaced:
            self._burnt += 0.01
            if self._burnt >= self._due or self.now() >= self._soon:
                self._due = max(self._due, self._burnt + self._rng.exponential(MEAN))
                self._soon = np.inf if self.now() >= self._soon else self._soon
                self._kill_a_copy()

    def _out(self, plant):
        """Ends the copy when the arc is out, and tells after how long."""
        off = self.now() - self._died
        if not plant.arc_on or off > OUT_LIMIT:
            at, since, replaced = self._when
            kill = Kill(self._kind, at, since, off, replaced)
            os.write(self._pipe, json.dumps(asdict(kill)).encode())
            os._exit(0)

    def _kill_a_copy(self):
        self._turn += 1
        kind = KINDS[self._turn % len(KINDS)]
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            signal.alarm(HANGS)
            self._die(kind, write)
            return
        os.close(write)
        told = os.read(read, 4096)
        os.close(read)
        os.waitpid(child, 0)
        if not told:
            raise RuntimeError(f'the copy in which {kind} died said nothing')
        self.kills.append(Kill(**json.loads(told)))

    def _die(self, kind, pipe):
        """Of the copy: nobody but what is left of the cell does anything."""
        self._kind, self._died, self._pipe = kind, self.now(), pipe
        self._when = self._burnt, self.now() - self._last, self._replaced
        if kind == 'bridge':
            self.device.bridge.poll = lambda now: b''
        # the job does nothing any more; `_out` ends this
        while kind in ('bridge', 'job_sequencer'):
            self.device.step()


def of_seed(folder: Path, seed: int) -> list[Kill]:
    """Kills in a job of one layer, from its first correction within the layer on: at random moments, and one within
    SOON s after every correction. What dies goes through KINDS."""
    from waam_lab import laboratory, restore

    made = []

    def cell(*args):
        made.append(Watched(seed, *args))
        return made[-1]

    own = {**CHANGED, 'job_sequencer': {**CHANGED['job_sequencer'], 'lease_nodes': NODES}}
    nominal, worn = long_part(folder)
    job = restore(nominal, worn, seed, layers=1, strategy='zigzag', overrides=own)
    kept, laboratory.LabCell = laboratory.LabCell, cell
    try:
        result = laboratory.run(job)
    finally:
        laboratory.LabCell = kept
    if result.failed or not made[0].kills:
        raise RuntimeError(f'seed {seed}: nothing was corrected within the layer; {result.message}')
    return made[0].kills
