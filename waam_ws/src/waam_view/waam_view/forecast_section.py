"""What `waam forecast` had said of a job, beside what came out."""

from __future__ import annotations

import math
from typing import Any

from .html import escape, fmt, table
from .job_data import Job, number

# key in the forecast, label, unit, factor to it, decimals, where the outcome is in the run
_ROWS = (
    ('rms_mm', 'RMS height error', 'mm', 1, 3, ('rms_mm',)),
    ('share_in_tolerance', 'within the tolerance', '%', 100, 1, ('share_in_tolerance',)),
    ('clean_share', 'needed area at or above nominal', '%', 100, 2, ('stock', 'share')),
    ('stock_mean_mm', 'stock to machine, mean', 'mm', 1, 2, ('stock', 'mean_mm')),
    ('stock_99_mm', 'stock to machine, 99 %', 'mm', 1, 2, ('stock', 'high_mm')),
    ('time_s', 'machine time', 's', 1, 0, ('duration_s',)),
    ('wire_m', 'wire', 'm', 1, 2, ('wire_m',)),
)


def forecast_section(job: Job) -> str:
    """HTML; '' for a job of which nothing was foretold."""
    told = job.run.get('forecast')
    if not isinstance(told, dict) or not isinstance(told.get('figures'), dict):
        return ''
    rows: list[list[str]] = []
    outside: set[int] = set()
    for key, label, unit, factor, digits, path in _ROWS:
        figure = told['figures'].get(key)
        if not isinstance(figure, dict):
            continue
        value, low, high = (number(figure.get(k)) for k in ('value', 'low', 'high'))
        came = _at(job.run, path)
        inside = '' if not math.isfinite(came) else 'yes' if low <= came <= high else 'no'
        if inside == 'no':
            outside.add(len(rows))
        shown = (fmt(v * factor, digits) for v in (value, low, high, came))
        mean, least, most, outcome = shown
        rows.append([f'{label}, {unit}', mean, f'{least} … {most}', outcome, inside])
    band = f'{100 * number(told.get("band")):.0f} % of jobs'
    head = ['', 'forecast', band, 'outcome', 'within']
    said = f'{told.get("verdict", "")}; {told.get("cells", "?")} cells, preset {told.get("preset", "?")}.'
    return f'<h2>Forecast and outcome</h2>{table(head, rows, {0}, outside)}<p class=soft>{escape(said)}</p>'


def _at(run: dict[str, Any], path: tuple[str, ...]) -> float:
    value: Any = run
    for key in path:
        value = value.get(key) if isinstance(value, dict) else None
    return number(value)
