"""Seeds of a benchmark, from the outside."""

from __future__ import annotations

import os


def seeds(usual: tuple[int, ...]) -> tuple[int, ...]:
    """`usual`, or those of `WAAM_BENCH_SEEDS`: numbers with commas between them, such as 1,2."""
    text = os.environ.get('WAAM_BENCH_SEEDS', '')
    try:
        return tuple(int(v) for v in text.split(',')) if text else usual
    except ValueError:
        raise SystemExit(f'WAAM_BENCH_SEEDS={text}: wanted numbers such as 1,2,3') from None
