"""What `waam scan register --sequence` does: frames in; trajectory, merged cloud and picture out."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from ..left_out import LeftOut, tell
from ..registration.clouds import load_points, save_cloud
from ..registration.odometry import Track, track


def track_files(args: argparse.Namespace) -> None:
    """Reads the frames in the order given, tracks, writes trajectory.json, merged.ply and trajectory.png."""
    from rich.progress import Progress

    if not 0.05 <= args.voxel <= 20.0:
        raise ValueError(f'--voxel {args.voxel} mm is outside 0.05 .. 20 mm')
    clouds, frames = _frames(args.clouds, args.scale)
    with Progress(transient=True) as bar:
        task = bar.add_task('odometry', total=len(frames))
        found = track(
            frames, args.voxel * 1e-3, args.change, args.seed,
            lambda done: bar.update(task, completed=done),
        )  # fmt: skip
    for name, pose, ok in zip(clouds, found.poses, found.refined, strict=True):
        x, y, z = pose[:3, 3] * 1e3
        print(f'{name.name}: {x:.3f} {y:.3f} {z:.3f} mm{"" if ok else " (KISS-ICP only)"}')
    for text in found.notes:
        print(f'note: {text}')
    args.out.mkdir(parents=True, exist_ok=True)
    write(args.out, found, frames, [p.name for p in clouds])
    print(f'written: {args.out}')


def _frames(paths: list[Path], scale: float) -> tuple[list[Path], list[np.ndarray]]:
    """Those that can be read; a bad one is left out by name, on stderr. An error when none is left."""
    left_out, found = LeftOut(), {}
    for path in paths:
        try:
            found[path] = load_points(path, scale)
        except ValueError as e:
            left_out.add('scan', path, '', e)
    if not found:
        raise left_out.nothing_left(', '.join(map(str, paths)))
    tell(left_out)
    return list(found), list(found.values())


def write(out: Path, found: Track, frames: list[np.ndarray], names: list[str]) -> None:
    """Matrices take points of a frame (m) to the axes of the first one."""
    data = [
        {'frame': n, 'matrix_m': p.tolist(), 'kiss_icp_matrix_m': c.tolist(), 'refined': bool(ok)}
        for n, p, c, ok in zip(names, found.poses, found.coarse, found.refined, strict=True)
    ]
    text = json.dumps({'frames': data, 'notes': found.notes}, indent=2)
    (out / 'trajectory.json').write_text(text)
    merged = found.merged(frames)
    save_cloud(out / 'merged.ply', merged)
    draw(out / 'trajectory.png', found, merged)


def draw(path: Path, found: Track, merged: np.ndarray) -> None:
    """Merged cloud from above with the way of the frames' origin, and what the refinement changed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5), layout='constrained')
    left, right = figure.subplots(1, 2)
    few = merged[:: max(1, len(merged) // 40_000)] * 1e3
    dots = left.scatter(few[:, 0], few[:, 1], c=few[:, 2], s=1, cmap='viridis', linewidths=0)
    figure.colorbar(dots, ax=left, label='z in mm')
    left.set(aspect='equal', xlabel='x in mm', ylabel='y in mm', title=f'{len(found.poses)} frames')
    centre = merged.mean(axis=0)
    at = found.poses[:, :3, :3] @ centre + found.poses[:, :3, 3] - centre
    rough = found.coarse[:, :3, :3] @ centre + found.coarse[:, :3, 3] - centre
    for i, axis in enumerate('xyz'):
        right.plot((at - rough)[:, i] * 1e3, '.-', label=axis)
    right.set(
        xlabel='frame', ylabel='refined minus KISS-ICP in mm', title='at the middle of the surface'
    )
    right.legend()
    right.grid(alpha=0.4)
    figure.savefig(path, dpi=110)
