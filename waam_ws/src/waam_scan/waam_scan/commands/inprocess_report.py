"""Bead height from in-process profiles on disk: table, picture and comparison. What `waam scan filter` does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..recordings.files import InprocessScan, read_inprocess_csv
from ..recordings.inprocess import CrownSeries, SeriesQuality, filter_scan, median_filter, quality
from ..recordings.left_out import LeftOut

COLUMNS = 't_s,raw_median_mm,crown_mm,crown_u_mm,height_mm,height_u_mm,used'


def filter_file(
    path: Path, out: Path, distance: bool = True, left_out: LeftOut | None = None
) -> CrownSeries:
    """Reads, filters, writes NAME_filtered.csv and .png into `out` and prints the comparison. Damaged lines go into
    left_out; without it they are an error."""
    scan = read_inprocess_csv(path, left_out)
    series = filter_scan(scan, distance=distance)
    out.mkdir(parents=True, exist_ok=True)
    name = out / f'{path.stem}_filtered'
    write_csv(name.with_suffix('.csv'), series)
    draw(name.with_suffix('.png'), scan, series)
    crowns = int(np.isfinite(series.crown).sum())
    print(
        f'{path}: {len(scan.t)} profiles, {crowns} show a crown, {int(series.used.sum())} of them passed the gate'
    )
    print('\n'.join(comparison(series)))
    print(f'table and picture: {name}.csv, {name}.png')
    return series


def write_csv(path: Path, s: CrownSeries) -> None:
    """Times in s from the first profile, lengths in mm; empty where there is no value."""
    lines = [COLUMNS]
    columns = (s.raw, s.crown, s.crown_u, s.height, s.u)
    for k, t in enumerate(s.t - s.t[0]):
        values = ['' if np.isnan(c[k]) else f'{c[k] * 1e3:.4f}' for c in columns]
        lines.append(','.join([f'{t:.4f}', *values, str(int(s.used[k]))]))
    path.write_text('\n'.join(lines) + '\n')


def compared(s: CrownSeries) -> dict[str, SeriesQuality]:
    """Raw series, plain median filter, crowns, and the filtered series."""
    all_of = {
        'median of each profile': s.raw,
        'running median of 5': median_filter(s.raw),
        'crown of each profile': s.crown,
        'filtered': s.height,
    }
    return {name: quality(s.t, values, s.raw) for name, values in all_of.items()}


def comparison(s: CrownSeries) -> list[str]:
    """The table that is printed."""
    lines = ['  series                   spikes  noise mm  lag-1 correlation  delay ms  missing']
    for name, q in compared(s).items():
        lines.append(
            f'  {name:24} {q.spikes:6d} {q.noise * 1e3:9.4f} {q.lag1:18.3f} {q.delay * 1e3:9.0f} {q.missing:8d}'
        )
    return lines


def draw(path: Path, scan: InprocessScan, s: CrownSeries) -> None:
    """Points and series over time: everything, and the bead alone."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7.5), layout='constrained')
    FigureCanvasAgg(figure)
    t, mm = s.t - s.t[0], 1e3
    axes = figure.subplots(2, 1, sharex=True)
    for axis in axes:
        axis.plot(
            np.repeat(t[:, None], scan.z.shape[1], 1).ravel(),
            scan.z.ravel() * mm,
            ',',
            color='0.55',
        )
        axis.plot(t, s.raw * mm, lw=0.6, color='tab:blue', label='median of each profile')
        axis.plot(
            t, median_filter(s.raw) * mm, lw=1, color='tab:orange', label='running median of 5'
        )
        axis.plot(t, s.height * mm, lw=1.4, color='k', label='filtered crown')
        axis.fill_between(
            t, (s.height - 2 * s.u) * mm, (s.height + 2 * s.u) * mm, color='k', alpha=0.2
        )
        refused = np.isfinite(s.crown) & ~s.used
        axis.plot(t[refused], s.crown[refused] * mm, 'rx', ms=5, label='crown refused by the gate')
        axis.set_ylabel('Z in mm')
        axis.grid(alpha=0.3)
    low, high = np.nanpercentile(s.height, [1, 94]) * mm
    axes[1].set(ylim=(low - 0.3, high + 0.8), xlabel='time in s')
    axes[0].legend(loc='upper right', fontsize=8)
    figure.savefig(path, dpi=110)
