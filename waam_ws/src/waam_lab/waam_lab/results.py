"""From the folder that a job leaves (docs/job_folder.md) to its result."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from waam_job.model.stock import counted_area
from waam_job.store.folder import JobFolder
from waam_node import job_folder
from waam_plan import finish
from waam_plan.plan import Plan
from waam_process.grid import GridSpec
from waam_process.verdicts import FAILED

from . import causes
from .job import LabJob, LabMaps, LabResult

LARGEST_SHARE = 0.995  # share of the judged cells: a part does not fail by single cells beyond it


def read(folder: JobFolder, job: LabJob, first: Plan | None, time: float, cpu: float) -> LabResult:
    """first: plan of the first pass, if it came so far; time: s of machine time; cpu: s of processor time."""
    report = folder.read_json(job_folder.REPORT) or {}
    run: dict[str, Any] = report.get(job.goal.loop_mode, {})
    maps = [m for m in (folder.read_map(n) for n in range(folder.last_map() + 1)) if m is not None]
    final = (
        _maps(maps, first) if maps and first and report.get('verdict', FAILED) != FAILED else None
    )
    rows = [r for r in run.get('layers', []) if not r.get('final')]
    judged = run.get('rms_mm') is not None
    round_part = run.get('shaft') or {}
    return LabResult(
        seed=job.seed,
        verdict=report.get('verdict', FAILED),
        error_code=int(run.get('error_code', 0)),
        message=str(run.get('message', '')),
        rms=_metres(run, 'rms_mm'),
        mean=_metres(run, 'mean_mm'),
        max_error=_metres(run, 'max_mm'),
        largest=largest(final) if final else math.nan,
        rms_edges=_metres(run, 'rms_all_mm'),
        share_in_tolerance=_number(run, 'share_in_tolerance') if judged else math.nan,
        share_edges=_number(run, 'share_all_in_tolerance') if judged else math.nan,
        verdict_edges=str(run.get('verdict_with_rim', '')),
        overrun=_metres(run.get('overrun_mm') or {}, 'max'),
        overrun_mean=_metres(run.get('overrun_mm') or {}, 'mean'),
        clean_share=_number(run.get('stock') or {}, 'share'),
        stock_mean=_metres(run.get('stock') or {}, 'mean_mm'),
        stock_high=_metres(run.get('stock') or {}, 'high_mm'),
        unlaid_share=_number(run.get('unlaid') or {}, 'share'),
        clean_diameter=_metres(round_part, 'clean_diameter_mm'),
        roundness=_metres(round_part, 'roundness_mm'),
        new_run_out=_metres(round_part, 'new_run_out_mm'),
        seam_step=_metres(round_part, 'seam_step_mm'),
        axis=_axis(round_part),
        layer_means=layer_means(maps),
        layer_rms=layer_rms(maps),
        layers=len(rows),
        fallbacks=sum(bool(r.get('fallback')) for r in rows),
        time=time,
        wire=_number(run, 'wire_m'),
        volume=first.volume if first else math.nan,
        reports=tuple(run.get('layers', [])),
        anomalies=tuple(run.get('anomalies', [])),
        maps=final,
        folder=folder.path if job.keep else None,
        cpu=cpu,
    )


def _axis(round_part: dict[str, Any]) -> tuple[float, float]:
    """m; NaN without a shaft."""
    x, y = (math.nan if v is None else v * 1e-3 for v in round_part.get('axis_mm', (None, None)))
    return x, y


def largest(maps: LabMaps) -> float:
    """m: 99.5 % of the judged cells that were seen are within."""
    seen = np.abs(maps.error[maps.interior])
    seen = seen[np.isfinite(seen)]
    return float(np.quantile(seen, LARGEST_SHARE)) if seen.size else math.nan


def layer_means(maps: list[dict[str, np.ndarray]]) -> tuple[float, ...]:
    """m: mean error of what each layer laid inside the judged area, in the scan after it; NaN where none was seen."""
    return tuple(float(e.mean()) if e.size else math.nan for e in _layer_errors(maps))


def layer_rms(maps: list[dict[str, np.ndarray]]) -> tuple[float, ...]:
    """m: RMS of the same error."""
    return tuple(float(np.sqrt(np.mean(e**2))) if e.size else math.nan for e in _layer_errors(maps))


def _layer_errors(maps: list[dict[str, np.ndarray]]) -> Iterator[np.ndarray]:
    for before, after in zip(maps, maps[1:], strict=False):
        error = (after['z'] - after['target'])[(before['planned'] > 0) & after['interior']]
        yield error[np.isfinite(error)].astype(float)


def _maps(maps: list[dict[str, np.ndarray]], plan: Plan) -> LabMaps:
    first, last = maps[0], maps[-1]
    x, y = (float(v) for v in last['origin'])
    rows, cols = last['z'].shape
    return LabMaps(
        spec=GridSpec(x, y, float(last['resolution']), rows, cols),
        error=last['z'] - last['target'],
        region=last['region'].astype(bool) & np.isfinite(last['target']),
        interior=last['interior'].astype(bool) & np.isfinite(last['target']),
        as_found=first['z'] - last['target'],
        places=causes.places(plan),
        below=_below(plan, last['z']),
    )


def _below(plan: Plan, z: np.ndarray) -> np.ndarray | None:
    if plan.settings.finish != finish.MACHINED:
        return None
    below: np.ndarray = counted_area(plan) & ~(z - plan.nominal.z >= 0)
    return below


def _number(run: dict[str, Any], key: str) -> float:
    value = run.get(key)
    return math.nan if value is None else float(value)


def _metres(run: dict[str, Any], key: str) -> float:
    return _number(run, key) * 1e-3
