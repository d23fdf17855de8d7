"""A `Tuning` in figures: rows for a table, and the same for JSON (keys name their units)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

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
    if p := layer.prediction:
        row |= {
            'error_measured_rms_mm': p.rms('measured') * 1e3,
            'error_predicted_recorded_rms_mm': p.rms('recorded') * 1e3,
            'error_predicted_rms_mm': p.rms('again') * 1e3,
            'height_change_rms_mm': p.change[0] * 1e3,
            'height_change_max_mm': p.change[1] * 1e3,
            'metal_arrived': p.arrived,
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
