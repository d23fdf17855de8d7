"""How rough the simulated cells of a benchmark are, from the outside; figures that were measured on them say it."""

from __future__ import annotations

import os

from waam_process.operating import check_preset

from .emit import emit

USUAL = 'gentle'  # of the figures in docs/ and their baselines, unless they say so


def preset(usual: str = USUAL) -> str:
    """`usual`, or that of `WAAM_BENCH_PRESET`."""
    try:
        return check_preset(os.environ.get('WAAM_BENCH_PRESET') or usual)
    except ValueError as e:
        raise SystemExit(f'WAAM_BENCH_PRESET: {e}') from None


def emit_on_cell(
    name: str,
    value: float,
    unit: str,
    baseline: str,
    baseline_value: float | None,
    on: str = '',
) -> None:
    """As `emit`, with the preset of the cells: `on`, or that of this run."""
    emit(name, value, unit, baseline, baseline_value, on or preset())
