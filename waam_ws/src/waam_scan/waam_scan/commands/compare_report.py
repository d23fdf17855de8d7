"""What `waam scan compare` does: nominal and scan in; map, picture and figures of the missing metal out."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from ..map_file import save_map
from ..registration.clouds import load_points, load_triangles
from ..registration.compare import Missing, found_grid, missing_metal, nominal_grid
from ..registration.result import Registration
from ..registration.target import Cloud, MeshTarget
from .registration_report import align, lines

LISTED = 8  # regions that are printed


def compare_files(args: argparse.Namespace) -> None:
    """Reads, aligns if asked, compares, writes."""
    if not 0.02 <= args.cell <= 20.0:
        raise ValueError(f'--cell {args.cell} mm is outside 0.02 .. 20 mm')
    if not 0.0 <= args.allowance <= 50.0:
        raise ValueError(f'--allowance {args.allowance} mm is outside 0 .. 50 mm')
    if args.search and not args.register:
        raise ValueError('--search belongs to --register')
    triangles = load_triangles(args.nominal, args.scale)
    points = load_points(args.scan, args.scale)
    aligned = None
    if args.register:
        cloud = Cloud.of(points, seed=args.seed)
        aligned = align(cloud, MeshTarget(triangles), triangles.reshape(-1, 3), args)
        points = aligned.apply(points)
        print('\n'.join(lines(aligned)))
    nominal = nominal_grid(triangles, args.cell * 1e-3)
    level = aligned.sigma[2] if aligned is not None and np.isfinite(aligned.sigma[2]) else 0.0
    result = missing_metal(
        nominal, found_grid(points, nominal.spec), args.allowance * 1e-3, float(level)
    )
    print('\n'.join(table(result)))
    write(args.out, result, triangles, args.nominal.name, args.scan.name, aligned)
    print(f'written: {args.out}')


def table(m: Missing) -> list[str]:
    """For a person."""
    out = [
        f'missing {m.volume * 1e6:.3f} cm3 (standard uncertainty {m.volume_sigma * 1e6:.3f}), too much '
        f'{m.excess * 1e6:.3f} cm3, allowance {m.allowance * 1e3:.2f} mm',
        f'deepest {m.deepest * 1e3:.2f} mm; {m.unseen:.1%} of the part was not seen (not counted, not filled in)',
    ]
    for number, r in enumerate(m.regions[:LISTED], 1):
        x0, x1, y0, y1 = (v * 1e3 for v in r.box)
        out.append(
            f'  {number}: {r.volume * 1e6:.3f} cm3 on {r.area * 1e6:.0f} mm2, x {x0:.1f} .. {x1:.1f}, '
            f'y {y0:.1f} .. {y1:.1f} mm, deepest {r.deepest * 1e3:.2f} mm'
        )
    if len(m.regions) > LISTED:
        out.append(f'  and {len(m.regions) - LISTED} smaller ones')
    return out


def write(
    out: Path,
    m: Missing,
    triangles: np.ndarray,
    nominal: str,
    scan: str,
    aligned: Registration | None = None,
) -> None:
    """missing.npz, as_found.npz, missing.png, missing.json."""
    out.mkdir(parents=True, exist_ok=True)
    count = np.isfinite(m.depth).astype(np.uint16)
    save_map(
        out / 'missing.npz', m.spec, m.depth, m.sigma, count,
        nominal=m.nominal.z.astype(np.float32), found=m.found.z.astype(np.float32),
        allowance=np.array(m.allowance),
    )  # fmt: skip
    work = planner_frame(m.found, triangles)
    save_map(
        out / 'as_found.npz', work.spec, work.z, work.sigma, np.isfinite(work.z).astype(np.uint16)
    )
    (out / 'missing.json').write_text(json.dumps(summary(m, nominal, scan, aligned), indent=2))
    draw(out / 'missing.png', m, f'{scan} against {nominal}')


def planner_frame(found: HeightGrid, triangles: np.ndarray) -> HeightGrid:
    """The worn surface with the smallest corner of the nominal part in (0, 0, 0), as `waam plan --as-found` expects."""
    low = triangles.reshape(-1, 3).min(axis=0)
    s = found.spec
    spec = GridSpec(s.origin_x - low[0], s.origin_y - low[1], s.resolution, s.rows, s.cols)
    return HeightGrid(spec, found.z - low[2], found.sigma)


def summary(m: Missing, nominal: str, scan: str, aligned: Registration | None) -> dict:
    """Figures in mm and mm3, coordinates of the nominal file."""
    data = {
        'nominal': nominal,
        'scan': scan,
        'allowance_mm': m.allowance * 1e3,
        'missing_mm3': m.volume * 1e9,
        'missing_sigma_mm3': m.volume_sigma * 1e9,
        'excess_mm3': m.excess * 1e9,
        'deepest_mm': m.deepest * 1e3,
        'unseen_share': m.unseen,
        'cell_mm': m.spec.resolution * 1e3,
        'box_mm': None if m.box is None else [v * 1e3 for v in m.box],
        'regions': [
            {
                'missing_mm3': r.volume * 1e9,
                'area_mm2': r.area * 1e6,
                'deepest_mm': r.deepest * 1e3,
                'deepest_at_mm': [v * 1e3 for v in r.at],
                'box_mm': [v * 1e3 for v in r.box],
            }
            for r in m.regions
        ],
    }
    if aligned is not None:
        data['registration'] = {
            'matrix_m': aligned.matrix.tolist(),
            'unobserved': aligned.unobserved,
            'notes': aligned.notes,
        }
    return data


def draw(path: Path, m: Missing, title: str) -> None:
    """Missing metal from above (blue = to add, red = too much) and a section through the deepest place."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7.5), layout='constrained')
    top, below = figure.subplots(2, 1, height_ratios=[3, 1.4])
    limit = max(1e3 * m.deepest, 0.1)
    top.set_facecolor('0.75')
    image = top.imshow(
        np.ma.masked_invalid(m.depth * 1e3), origin='lower', extent=[v * 1e3 for v in m.spec.extent],
        cmap='RdBu', vmin=-limit, vmax=limit, interpolation='nearest', aspect='equal',
    )  # fmt: skip
    figure.colorbar(image, ax=top, label='missing metal in mm', extend='both')
    top.set(
        xlabel='x in mm', ylabel='y in mm',
        title=f'{title}: {m.volume * 1e6:.2f} cm³ missing, deepest {m.deepest * 1e3:.2f} mm',
    )  # fmt: skip
    row = _deepest_row(m)
    top.axhline(m.spec.y[row] * 1e3, color='k', lw=0.7, ls=':')
    x = m.spec.x * 1e3
    target = (m.nominal.z[row] + m.allowance) * 1e3
    below.plot(x, target, 'k-', lw=1.2, label='nominal' + (' + allowance' if m.allowance else ''))
    below.plot(x, m.found.z[row] * 1e3, color='tab:orange', lw=1, label='found')
    below.fill_between(
        x, m.found.z[row] * 1e3, target, where=m.depth[row] > 0, color='tab:blue', alpha=0.3
    )
    below.set(
        xlabel='x in mm', ylabel='z in mm', title=f'section at y = {m.spec.y[row] * 1e3:.1f} mm'
    )
    below.legend()
    below.grid(alpha=0.4)
    figure.savefig(path, dpi=110)


def _deepest_row(m: Missing) -> int:
    if m.regions:
        y = m.regions[0].at[1]
        return int(np.argmin(np.abs(m.spec.y - y)))
    return m.spec.rows // 2
