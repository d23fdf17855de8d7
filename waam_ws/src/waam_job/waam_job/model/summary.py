"""The figures of one run for report.json (docs/job_folder.md): millimetres where the key says so, SI elsewhere."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from waam_process.bead import deposition_rate
from waam_process.materials import Material
from waam_process.names import FAULTS

from .geometry import NOTHING_SEEN
from .program import PassRecord
from .records import AnomalyRecord, LayerRecord, Status
from .verdict import Verdict


def run_summary(
    verdict: Verdict,
    status: Status,
    *,
    layers: list[LayerRecord],
    anomalies: list[AnomalyRecord],
    passes: list[PassRecord],
    material: Material,
) -> dict[str, Any]:
    """RUN of docs/job_folder.md, without duration_s and runs."""
    found = verdict.final or NOTHING_SEEN
    rows = [asdict(r) for r in layers]

    def total(key: str) -> float:
        return sum(r[key] for r in rows)

    return {
        'rms_mm': found.rms * 1e3,
        'max_mm': found.max * 1e3,
        'mean_mm': found.mean * 1e3,
        'share_in_tolerance': found.share_in_tolerance,
        'rms_all_mm': found.rms_all * 1e3,
        'share_all_in_tolerance': found.share_all,
        'overrun_mm': {'mean': verdict.overrun.mean * 1e3, 'max': verdict.overrun.max * 1e3},
        'as_found_rms_mm': verdict.as_found_rms * 1e3,
        'stock': verdict.stock.facts() if verdict.stock else None,
        'unlaid': _unlaid(verdict),
        'shaft': verdict.shaft.facts() if verdict.shaft else None,
        'verdict': verdict.word,
        'verdict_with_rim': verdict.word_all,
        'tolerance_map': verdict.tolerance_map,
        'error_code': status.error_code,
        'message': status.message,
        'layers': rows,
        'anomalies': [a.to_json() for a in anomalies],
        'clamps': {k: total(f'clamps_{k}') for k in ('speed', 'feed', 'voltage', 'psi')},
        'points_dropped': total('points_dropped'),
        'profiles_rejected': total('profiles_rejected'),
        'telemetry_lost': total('telemetry_lost'),
        'faults': sum(a.severity in FAULTS for a in anomalies),
        'wire_m': total('wire_used'),
        'energy_J': total('energy'),
        'arc_on_s': total('arc_on_time'),
        'deposition_kg_h': _deposition(total('wire_used'), total('arc_on_time'), material),
        'cost': total('cost'),
        'cost_terms': ['height', 'current'] if material.set_current(1.0) else ['height'],
        'passes': [asdict(p) for p in passes],
        'folder': '.',
    }


def _unlaid(verdict: Verdict) -> dict[str, float] | None:
    left = verdict.unlaid
    if left is None:
        return None
    lengths = {f'{n}_mm': getattr(left, n) * 1e3 for n in ('depth', 'x', 'y')}
    return {'area_mm2': left.area * 1e6, 'share': left.share, **lengths}


def _deposition(wire: float, arc_time: float, material: Material) -> float | None:
    """Metal on the part in kg per hour of arc time, of `wire` m in `arc_time` s; None when the arc never burned."""
    if not arc_time > 0:
        return None
    return 3600 * float(deposition_rate(wire / arc_time, material, material.density))
