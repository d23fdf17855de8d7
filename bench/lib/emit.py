"""One JSON object per line: name, value, unit, baseline, baseline_value, ratio; preset of the simulated cells."""

from __future__ import annotations

import json


def emit(
    name: str,
    value: float,
    unit: str,
    baseline: str,
    baseline_value: float | None,
    preset: str = '',
) -> None:
    """ratio = value / baseline_value (None when there is nothing to divide by). preset: '' = no field."""
    ratio = value / baseline_value if baseline_value else None
    print(
        json.dumps(
            {
                'name': name,
                'value': round(value, 6),
                'unit': unit,
                'baseline': baseline,
                'baseline_value': baseline_value,
                'ratio': None if ratio is None else round(ratio, 4),
                **({'preset': preset} if preset else {}),
            }
        ),
        flush=True,
    )
