"""A map as a picture (PNG) and as a surface for other tools (PLY). No display needed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waam_process.grid import GridSpec


def save_png(
    path: Path,
    spec: GridSpec,
    z: np.ndarray,
    title: str = '',
    limits_mm: tuple | None = None,
) -> None:
    """Heights z (rows, cols; m, NaN = unknown, drawn grey) in mm over x and y in mm, +y up.

    limits_mm: colour range; None = 1st to 99th percentile.
    """
    from matplotlib.figure import Figure

    x0, x1, y0, y1 = (v * 1e3 for v in spec.extent)
    tall = max(2.5, min(9.0, 8.0 * (y1 - y0) / (x1 - x0)))
    figure = Figure(figsize=(10, tall + 1), layout='constrained')
    axes = figure.subplots()
    if limits_mm is None:
        known = z[np.isfinite(z)] * 1e3
        limits_mm = np.percentile(known, [1, 99]) if known.size else (0.0, 1.0)
    axes.set_facecolor('0.75')
    image = axes.imshow(
        np.ma.masked_invalid(z * 1e3), origin='lower', extent=(x0, x1, y0, y1), cmap='viridis',
        vmin=limits_mm[0], vmax=limits_mm[1], interpolation='nearest', aspect='equal',
    )  # fmt: skip
    figure.colorbar(image, ax=axes, label='height in mm', extend='both')
    axes.set(xlabel='x in mm', ylabel='y in mm', title=title)
    figure.savefig(path, dpi=110)


def save_ply(path: Path, spec: GridSpec, z: np.ndarray) -> None:
    """Binary PLY mesh in mm: one vertex per known cell centre, two triangles wherever four neighbours are known.

    Unknown cells stay holes.
    """
    import trimesh

    known = np.isfinite(z)
    x, y = np.meshgrid(spec.x, spec.y)
    vertices = np.column_stack([x[known], y[known], z[known]]).astype('<f4') * np.float32(1e3)
    number = np.full(z.shape, -1, np.int64)
    number[known] = np.arange(len(vertices))
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    full = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    triangles = [np.column_stack([p[full] for p in corners]) for corners in ((a, b, c), (a, c, d))]
    mesh = trimesh.Trimesh(vertices, np.concatenate(triangles), process=False)
    mesh.export(path, file_type='ply')
