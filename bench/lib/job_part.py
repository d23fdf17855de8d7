"""The small part of the job benchmarks: a block with a trough that takes two layers of few beads, and its goal."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SEED = 7
LENGTH, WIDTH, HEIGHT, DEPTH = 36.0, 30.0, 12.0, 4.0  # mm


def write_part(folder: Path) -> tuple[Path, Path]:
    """Nominal and worn mesh."""
    from waam_node.stl import write_worn_block

    x, y = np.linspace(0, LENGTH, 37), np.linspace(0, WIDTH, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(np.abs(gx - LENGTH / 2) / 15, np.abs(gy - WIDTH / 2) / 12)
    return write_worn_block(folder, x, y, HEIGHT, DEPTH * np.clip(1.5 - 1.5 * away, 0, 1))


def goal(part: Path, jobs: Path, **fields):
    """Of the action; k_gain as the correction server wants it."""
    from waam_msgs.action import RunJob

    values = {'name': 'bench', 'mode': 'restore', 'k_gain': float('nan'), 'fresh': True, **fields}
    return RunJob.Goal(part=str(part), jobs_dir=str(jobs), **values)
