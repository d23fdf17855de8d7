"""What `waam scan register` does: clouds in; transform, uncertainty and a before/after picture out."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from ..registration.clouds import is_mesh, load_points, load_triangles, save_cloud
from ..registration.result import Registration
from ..registration.search import search_placement
from ..registration.solve import register
from ..registration.target import Cloud, CloudTarget, MeshTarget, Target


def register_files(args: argparse.Namespace) -> None:
    """Two clouds: one registration; more, or --sequence: odometry."""
    if len(args.clouds) < 2:
        raise ValueError('register needs SCAN and REFERENCE, or a sequence of clouds')
    if args.sequence or len(args.clouds) > 2:
        from .odometry_report import track_files

        track_files(args)
        return
    scan, reference = args.clouds
    cloud = Cloud.of(load_points(scan, args.scale), seed=args.seed)
    target, vertices = load_target(reference, args.scale, args.seed)
    result = align(cloud, target, vertices, args)
    print('\n'.join(lines(result)))
    args.out.mkdir(parents=True, exist_ok=True)
    save_json(args.out / 'registration.json', result, scan.name, reference.name)
    draw(args.out / 'registration.png', result, f'{scan.name} onto {reference.name}')
    if args.moved:
        save_cloud(args.out / 'moved.ply', result.apply(load_points(scan, args.scale)))
    print(f'written: {args.out}')


def load_target(path: Path, scale: float, seed: int) -> tuple[Target, np.ndarray]:
    """A mesh or a cloud to register to, and its points (n, 3) m."""
    if is_mesh(path):
        triangles = load_triangles(path, scale)
        return MeshTarget(triangles), triangles.reshape(-1, 3)
    cloud = Cloud.of(load_points(path, scale), seed=seed)
    return CloudTarget(cloud), cloud.points


def align(
    cloud: Cloud, target: Target, vertices: np.ndarray, args: argparse.Namespace
) -> Registration:
    """Registration with the options of the command line; --search first looks for the part."""
    start: np.ndarray | None = None
    notes: list[str] = []
    if args.search:
        start, notes = search_placement(cloud, target, vertices, args.change, args.seed)
    result = register(cloud, target, args.change, args.reach * 1e-3, start, seed=args.seed)
    result.notes.extend(notes)
    if not result.converged:
        result.notes.append('the last steps did not come to rest')
    return result


def rpy_deg(rotation: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw in degrees of a rotation (3, 3)."""
    from ..calibration.file import rpy_of

    return np.degrees(rpy_of(rotation))


def lines(r: Registration) -> list[str]:
    """For a person: the motion of the middle of the scan, the rotation, uncertainties, what is not known."""
    out = [
        f'{r.used} of {r.compared} compared points decide, noise {r.noise * 1e3:.4f} mm, '
        f'{r.changed:.1%} of the surface changed'
    ]
    turn = rpy_deg(r.rotation)
    for i, axis in enumerate('xyz'):
        out.append(f'shift {axis} {r.shift[i] * 1e3:+9.4f} mm  {_sigma(r.sigma[i], 1e3, "mm")}')
    for i, axis in enumerate('xyz'):
        out.append(f'turn  {axis} {turn[i]:+9.4f} deg {_sigma(r.sigma[3 + i], 180 / np.pi, "deg")}')
    out += [f'not observed, left as it was: {text}' for text in r.unobserved]
    return out + [f'note: {text}' for text in r.notes]


def _sigma(value: float, factor: float, unit: str) -> str:
    if not np.isfinite(value):
        return 'not observed on its own'
    return f'standard uncertainty {value * factor:.4f} {unit}'


def save_json(path: Path, r: Registration, scan: str, reference: str) -> None:
    """Lengths in mm, angles in degrees, matrix in m; null = not observed."""
    sigma = [float(v) if np.isfinite(v) else None for v in r.sigma]
    data = {
        'scan': scan,
        'reference': reference,
        'matrix_m': r.matrix.tolist(),
        'centre_mm': (r.centre * 1e3).tolist(),
        'shift_of_centre_mm': (r.shift * 1e3).tolist(),
        'roll_pitch_yaw_deg': rpy_deg(r.rotation).tolist(),
        'shift_sigma_mm': [None if v is None else v * 1e3 for v in sigma[:3]],
        'turn_sigma_deg': [None if v is None else float(np.degrees(v)) for v in sigma[3:]],
        'unobserved': r.unobserved,
        'noise_mm': r.noise * 1e3,
        'points_used': r.used,
        'changed_share': r.changed,
        'converged': r.converged,
        'notes': r.notes,
    }
    path.write_text(json.dumps(data, indent=2))


def draw(path: Path, r: Registration, title: str) -> None:
    """Distance to the reference before and after, from above, and as distributions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.6), layout='constrained')
    axes = figure.subplots(1, 3, width_ratios=[1, 1, 0.9])
    spread = np.nanpercentile(np.abs(r.before), 90) if np.isfinite(r.before).any() else 1e-3
    limit = 1e3 * max(float(spread), 5 * r.noise)
    for axis, values, name in ((axes[0], r.before, 'before'), (axes[1], r.after, 'after')):
        known = np.flatnonzero(np.isfinite(values))
        known = known[:: max(1, len(known) // 30_000)]
        dots = axis.scatter(
            *(r.points[known, :2].T * 1e3), c=values[known] * 1e3, s=2, cmap='coolwarm', vmin=-limit,
            vmax=limit, linewidths=0,
        )  # fmt: skip
        axis.set(aspect='equal', xlabel='x in mm', ylabel='y in mm', title=name)
    figure.colorbar(dots, ax=list(axes[:2]), label='distance in mm', extend='both')
    bins = np.linspace(-limit * 1.5, limit * 1.5, 121)
    for values, name, colour in ((r.before, 'before', '0.7'), (r.after, 'after', 'tab:blue')):
        axes[2].hist(
            values[np.isfinite(values)] * 1e3,
            bins,
            histtype='stepfilled',
            alpha=0.7,
            label=name,
            color=colour,
        )
    axes[2].set(xlabel='distance in mm', ylabel='points', yscale='log')
    axes[2].legend()
    state = 'all observed' if not r.unobserved else 'not observed: ' + '; '.join(r.unobserved)
    figure.suptitle(f'{title} ({state})', fontsize=10)
    figure.savefig(path, dpi=110, bbox_inches='tight')
