"""The figures of one run for report.json (docs/job_folder.md): millimetres where the key says so, SI elsewhere."""

from __future__ import annotations

import math
from dataclasses import asdict

from .geometry import Deviation
from .program import PassRecord
from .records import AnomalyRecord, LayerRecord, Status

NOTHING = Deviation(math.nan, math.nan, math.nan, 0.0, math.nan, 0.0)


def run_summary(
    verdict: str,
    status: Status,
    final: Deviation | None,
    as_found_rms: float,
    layers: list[LayerRecord],
    anomalies: list[AnomalyRecord],
    passes: list[PassRecord] | tuple = (),
) -> dict:
    """RUN of docs/job_folder.md, without duration_s; final is None when the job did not reach the last scan."""
    found = final or NOTHING
    rows = [asdict(r) for r in layers]

    def total(key: str) -> float:
        return sum(r[key] for r in rows)

    return {
        'rms_mm': found.rms * 1e3,
        'max_mm': found.max * 1e3,
        'mean_mm': found.mean * 1e3,
        'share_in_tolerance': found.share_in_tolerance,
        'rms_all_mm': found.rms_all * 1e3,
        'as_found_rms_mm': as_found_rms * 1e3,
        'verdict': verdict,
        'error_code': status.error_code,
        'message': status.message,
        'layers': rows,
        'anomalies': [a.to_json() for a in anomalies],
        'clamps': {k: total(f'clamps_{k}') for k in ('speed', 'feed', 'voltage', 'psi')},
        'points_dropped': total('points_dropped'),
        'profiles_rejected': total('profiles_rejected'),
        'telemetry_lost': total('telemetry_lost'),
        'faults': sum(a.severity in ('FAULT', 'ALARM') for a in anomalies),
        'wire_m': total('wire_used'),
        'energy_J': total('energy'),
        'arc_on_s': total('arc_on_time'),
        'cost': total('cost'),
        'passes': [asdict(p) for p in passes],
        'folder': '.',
    }
