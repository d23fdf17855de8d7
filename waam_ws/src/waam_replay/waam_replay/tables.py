"""A `Tuning` as tables for the terminal."""

from __future__ import annotations

from rich.table import Table

from .summary import layer_rows, map_rows
from .tune import Tuning


def tables(result: Tuning) -> list[Table]:
    """Of the maps that differ, of the corrections, of setpoints and heights."""
    made = []
    if any(not r['identical'] for r in map_rows(result)):
        made.append(_maps(result))
    rows = layer_rows(result)
    if any('psi_mean' in r for r in rows):
        made.append(_corrections(rows))
    if rows:
        made.append(_heights(rows))
    return made


def _table(title: str, *heads: str) -> Table:
    table = Table(title=title)
    for name in heads:
        table.add_column(name, justify='right')
    return table


def _maps(result: Tuning) -> Table:
    table = _table(
        'height maps, again - recorded, mm', 'after layer', 'RMS', 'max', 'coverage', 'trusted'
    )
    for r in map_rows(result):
        rms, largest = (f'{r[k]:.4f}' for k in ('difference_rms_mm', 'difference_max_mm'))
        same = ('0', '0') if r['identical'] else (rms, largest)
        trusted = 'yes' if r['plausible'] else '; '.join(r['reasons'])
        table.add_row(str(r['after_layer']), *same, f'{r["coverage"]:.1%}', trusted)
    return table


def _corrections(rows: list[dict]) -> Table:
    heads = ('layer', 'psi mean', 'again', 'RMS change', 'k_gain', 'again', 'flow', 'again')
    table = _table('corrections, as recorded and again', *heads)
    for r in (r for r in rows if 'psi_mean' in r):
        change = '0' if r['psi_identical'] else f'{r["psi_difference_rms"]:.4f}'
        psi = (f'{r["psi_mean_recorded"]:+.3f}', f'{r["psi_mean"]:+.3f}')
        others = (
            f'{r[key]:.3f}'
            for name in ('k_gain', 'flow_factor')
            for key in (f'{name}_recorded', name)
        )
        table.add_row(str(r['layer']), *psi, change, *others)
    return table


def _heights(rows: list[dict]) -> Table:
    heads = ('layer', 'speed', 'feed', 'clamped', 'measured', 'predicted', 'again')
    title = 'largest change of speed and feed, mm/s; RMS height error after the layer, mm'
    table = _table(title, *heads)
    errors = ('error_measured_rms_mm', 'error_predicted_recorded_rms_mm', 'error_predicted_rms_mm')
    for r in rows:
        cells = [f'{r[n]:.3f}' if n in r and r[n] == r[n] else '-' for n in errors]
        table.add_row(str(r['layer']), *_feed_cells(r), *cells)
    return table


def _feed_cells(r: dict) -> list[str]:
    if 'setpoints_identical' not in r:
        return ['-'] * 3
    names = ('speed_difference_max_mm_s', 'feed_difference_max_mm_s')
    return [*(f'{r[n]:.3f}' for n in names), str(r['clamped_segments'])]
