"""A `Tuning` in figures: tables for the terminal, and the same for JSON (keys name their units)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.table import Table

from .tune import Layer, Tuning


def map_rows(result: Tuning) -> list[dict[str, Any]]:
    """One row per scan."""
    rows = []
    for m in result.maps:
        rms, largest = m.difference
        rows.append(
            {
                'after_layer': int(m.layer),
                'identical': m.identical,
                'difference_rms_mm': rms * 1e3,
                'difference_max_mm': largest * 1e3,
                'coverage': float(np.isfinite(m.z).mean()),
                'plausible': m.plausible,
                'reasons': list(m.reasons),
                'profiles_complete': m.whole,
            }
        )
    return rows


def layer_rows(result: Tuning) -> list[dict[str, Any]]:
    """One row per layer."""
    return [_layer_row(layer) for layer in result.layers]


def _layer_row(layer: Layer) -> dict[str, Any]:
    row: dict[str, Any] = {'layer': int(layer.number)}
    if psi := layer.psi:
        inside = psi.core.footprint
        old = np.asarray(psi.recorded.psi, float).reshape(psi.spec.shape)[inside]
        rms, largest = psi.difference
        row |= {
            'psi_identical': psi.identical,
            'psi_difference_rms': rms,
            'psi_difference_max': largest,
            'psi_mean': _mean(psi.result.psi[inside]),
            'psi_mean_recorded': _mean(old),
            'k_gain': float(psi.result.k_gain),
            'k_gain_recorded': float(psi.recorded.k_gain),
            'flow_factor': float(psi.flow_factor),
            'flow_factor_recorded': float(psi.recorded.flow_factor),
            'fallback': psi.result.fallback,
            'reasons': list(psi.result.reasons),
        }
    if feed := layer.feed:
        row |= {
            'setpoints_identical': feed.identical,
            'speed_difference_max_mm_s': feed.difference('speed')[1] * 1e3,
            'feed_difference_max_mm_s': feed.difference('wire_feed_speed')[1] * 1e3,
            'clamped_segments': int(np.count_nonzero(feed.result.clamps)),
        }
    return row


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else math.nan


def as_json(result: Tuning) -> dict[str, Any]:
    """Everything, ready for json.dumps; NaN becomes None. Holds no wall time: equal runs give equal files."""
    data = {
        'record': result.record.path.parent.name + '/' + result.record.path.name,
        'settings': {k: v for k, v in result.parameters.changed.items()},
        'notes': [*result.parameters.notes, *result.record.damage],
        'machine_seconds': result.machine_seconds,
        'identical': {k: list(v) for k, v in result.identical.items()},
        'digest': result.digest,
        'maps': map_rows(result),
        'layers': layer_rows(result),
    }
    return _clean(data)


def _clean(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_clean(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def tables(result: Tuning) -> list[Table]:
    """Of the maps that differ, of the corrections, of setpoints."""
    made = []
    if any(not r['identical'] for r in map_rows(result)):
        made.append(_maps(result))
    rows = layer_rows(result)
    if any('psi_mean' in r for r in rows):
        made.append(_corrections(rows))
    if rows:
        made.append(_setpoints(rows))
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


def _setpoints(rows: list[dict]) -> Table:
    title = 'largest change of speed and feed, mm/s'
    table = _table(title, 'layer', 'speed', 'feed', 'clamped')
    for r in rows:
        table.add_row(str(r['layer']), *_feed_cells(r))
    return table


def _feed_cells(r: dict) -> list[str]:
    if 'setpoints_identical' not in r:
        return ['-'] * 3
    names = ('speed_difference_max_mm_s', 'feed_difference_max_mm_s')
    return [*(f'{r[n]:.3f}' for n in names), str(r['clamped_segments'])]
