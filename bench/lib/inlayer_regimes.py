"""Jobs in which there is something to know within the layer: parts that are long against the scanner's 60 mm."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

PARTS = {'rail': (170.0, 30.0), 'plate': (130.0, 60.0)}  # length, width, mm
HEIGHT, DEPTH = 12.0, 2.0  # mm
REGIMES: dict[str, dict[str, float]] = {
    'usual': {},
    # the wire behind the measuring wheel: slip, spool, another lot; a layer takes some three minutes
    'drift': {'arc_feed_wander': 0.08, 'arc_feed_wander_time': 60.0},
    'wrong_map': {'part_moved_z': 0.4e-3, 'part_moved_tilt_x': 5e-3},
    # a wire that gives a sixth less than the table says: another lot, a worn roll, much spatter
    'spool': {'metal_transfer': 0.76},
    'warp': {'part_warp': 1.5e-3, 'part_warp_energy': 8e4},
}


def trough(folder: Path, part: str = 'rail') -> tuple[Path, Path]:
    """Nominal and worn: a flat trough along x that takes one layer."""
    from waam_node.stl import write_worn_block

    length, width = PARTS[part]
    x, y = np.linspace(0, length, int(length / 2) + 1), np.linspace(0, width, int(width) + 1)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(
        np.abs(gx - length / 2) / (length / 2 - 4), np.abs(gy - width / 2) / (width / 2 - 3)
    )
    return write_worn_block(folder, x, y, HEIGHT, DEPTH * np.clip(6 * (1 - away), 0, 1))


def jobs(
    regime: str,
    part: str,
    seeds: tuple[int, ...],
    settings: dict[str, object],
    workers: int,
    layers: int = 1,
    strategy: str = 'zigzag',
) -> list:
    """Results, one per seed; RuntimeError with the message of a job that failed. settings: of job_sequencer."""
    from waam_lab import over_seeds, restore, run_many

    own: dict[str, dict[str, object]] = {'cell': dict(REGIMES[regime]), 'job_sequencer': settings}
    with tempfile.TemporaryDirectory() as folder:
        files = trough(Path(folder), part)
        job = restore(*files, tolerance=0.2e-3, layers=layers, strategy=strategy, overrides=own)
        found = run_many(over_seeds(job, seeds), workers=workers)
    for result in found:
        if result.failed:
            raise RuntimeError(f'{regime}, {part}, seed {result.seed}: {result.message}')
    return found
