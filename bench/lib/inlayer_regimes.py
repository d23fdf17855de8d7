"""Jobs in which there is something to know within the layer: a rail that is long against the scanner's 60 mm."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

LENGTH, WIDTH, HEIGHT, DEPTH = 170.0, 30.0, 12.0, 2.0  # mm
REGIMES: dict[str, dict[str, float]] = {
    'usual': {},
    # the wire behind the measuring wheel: slip, spool, another lot; a layer takes some three minutes
    'drift': {'arc_feed_wander': 0.08, 'arc_feed_wander_time': 60.0},
    'wrong_map': {'part_moved_z': 0.4e-3, 'part_moved_tilt_x': 5e-3},
    'warp': {'part_warp': 1.5e-3, 'part_warp_energy': 8e4},
}


def rail(folder: Path) -> tuple[Path, Path]:
    """Nominal and worn: a flat trough along x that takes one layer."""
    from waam_node.stl import write_worn_block

    x, y = np.linspace(0, LENGTH, 86), np.linspace(0, WIDTH, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(
        np.abs(gx - LENGTH / 2) / (LENGTH / 2 - 4), np.abs(gy - WIDTH / 2) / (WIDTH / 2 - 3)
    )
    return write_worn_block(folder, x, y, HEIGHT, DEPTH * np.clip(6 * (1 - away), 0, 1))


def jobs(
    regime: str, seeds: tuple[int, ...], within: bool, workers: int, level: float | None = None
) -> list:
    """Results, one per seed; RuntimeError with the message of a job that failed."""
    from waam_lab import over_seeds, restore, run_many

    own: dict[str, dict[str, object]] = {
        'cell': dict(REGIMES[regime]),
        'job_sequencer': {'in_layer': within},
    }
    if level is not None:
        own['correction_server'] = {'in_layer_level': level}
    with tempfile.TemporaryDirectory() as folder:
        part = rail(Path(folder))
        job = restore(*part, tolerance=0.2e-3, layers=1, strategy='zigzag', overrides=own)
        found = run_many(over_seeds(job, seeds), workers=workers)
    for result in found:
        if result.failed:
            raise RuntimeError(f'{regime}, seed {result.seed}: {result.message}')
    return found
