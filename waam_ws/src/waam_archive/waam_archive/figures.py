"""Key figures over jobs: productivity, wire and energy per area restored, defects, use of material (mass, hours and
coefficient of table 5.3 of source 003), cost by a price file. Pure."""

from __future__ import annotations

import math
from typing import Any

from waam_process.prices import JOULE_PER_KWH, Prices
from waam_process.verdicts import FAILED, GOOD, REJECTED

from .values import mapping, number, ratio

Row = dict[str, Any]
GROUPS = ('part', 'material', 'wire_lot', 'operator', 'cell', 'loop_mode', 'month')


def cost(job: Row, prices: Prices) -> dict[str, float] | None:
    """Cost of a job by kind and in total; None when the job lacks an amount, or the file the price of its wire."""
    per_kg = prices.wire(job.get('material'))
    amounts = [number(job.get(k)) for k in ('wire_kg', 'arc_on_s', 'energy_J', 'duration_s')]
    if per_kg is None or None in amounts:
        return None
    wire, arc, energy, machine = (a or 0.0 for a in amounts)
    parts = {
        'wire': wire * per_kg,
        'gas': arc / 3600 * (prices.gas_per_hour or 0.0),
        'energy': energy / JOULE_PER_KWH * (prices.energy_per_kWh or 0.0),
        'machine': machine / 3600 * (prices.machine_per_hour or 0.0),
        'labour': machine / 3600 * (prices.labour or 0.0),
    }
    return {**parts, 'total': math.fsum(parts.values())}


def key_figures(jobs: list[Row], prices: Prices | None = None) -> Row:
    """Figures of all these jobs together. Ratios count the jobs that have both of their terms; None: none has."""
    found: Row = {
        'jobs': len(jobs),
        'in_tolerance': sum(j.get('verdict') in GOOD for j in jobs),
        'failed': sum(j.get('verdict') == FAILED for j in jobs),
        'metal_kg': _sum(jobs, 'metal_kg'),
        'wire_kg': _sum(jobs, 'wire_kg'),
        'hours': _scaled(_sum(jobs, 'duration_s'), 1 / 3600),
        'arc_hours': _scaled(_sum(jobs, 'arc_on_s'), 1 / 3600),
        'area_m2': _scaled(_sum(jobs, 'area_mm2'), 1e-6),
        'kg_per_arc_hour': _over(jobs, 'metal_kg', 'arc_on_s', 3600),
        'kg_per_hour': _over(jobs, 'metal_kg', 'duration_s', 3600),
        'wire_kg_per_m2': _over(jobs, 'wire_kg', 'area_mm2', 1e6),
        'energy_kWh_per_m2': _over(jobs, 'energy_J', 'area_mm2', 1e6 / JOULE_PER_KWH),
        'energy_kWh_per_kg': _over(jobs, 'energy_J', 'metal_kg', 1 / JOULE_PER_KWH),
        'defect_share_of_area': _over(jobs, 'defect_cells', 'judged_cells', 1),
        'defect_share_of_jobs': _rejected(jobs),
        'efficiency': _weighted(jobs, 'efficiency', 'wire_kg'),
        'material_use': _weighted(jobs, 'material_use', 'wire_kg'),
    }
    return found | (_costs(jobs, prices) if prices else {})


def grouped(jobs: list[Row], by: str, prices: Prices | None = None) -> dict[str, Row]:
    """Key figures by one of GROUPS, in the order of its values."""
    groups: dict[str, list[Row]] = {}
    for job in jobs:
        groups.setdefault(_group(job, by), []).append(job)
    return {name: key_figures(groups[name], prices) for name in sorted(groups)}


def _group(job: Row, by: str) -> str:
    if by == 'month':
        return f'{job["created"]:%Y-%m}' if job.get('created') else '-'
    return str(job.get(by) or '-')


def _known(jobs: list[Row], *names: str) -> list[list[float]]:
    rows = [[number(j.get(n)) for n in names] for j in jobs]
    return [[v for v in r if v is not None] for r in rows if None not in r]


def _sum(jobs: list[Row], name: str) -> float | None:
    found = _known(jobs, name)
    return math.fsum(v for (v,) in found) if found else None


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _over(jobs: list[Row], above: str, below: str, factor: float) -> float | None:
    found = _known(jobs, above, below)
    return _scaled(ratio(math.fsum(a for a, _ in found), math.fsum(b for _, b in found)), factor)


def _weighted(jobs: list[Row], name: str, weight: str) -> float | None:
    found = _known(jobs, name, weight)
    return ratio(math.fsum(v * w for v, w in found), math.fsum(w for _, w in found))


def _rejected(jobs: list[Row]) -> float | None:
    """Of the jobs that were judged or failed, those that are not good."""
    judged = [j for j in jobs if j.get('verdict') in (*GOOD, *REJECTED, FAILED)]
    return ratio(sum(j['verdict'] not in GOOD for j in judged), len(judged))


def _costs(jobs: list[Row], prices: Prices) -> Row:
    known = [c for j in jobs if (c := cost(j, prices))]
    areas = [mapping(j) for j in jobs if cost(j, prices) and number(j.get('area_mm2'))]
    on_area = math.fsum((cost(j, prices) or {})['total'] for j in areas)
    total = math.fsum(c['total'] for c in known) if known else None
    return {
        'currency': prices.currency,
        'cost': total,
        **{f'cost_{k}': math.fsum(c[k] for c in known) for k in (known[0] if known else {}) if k != 'total'},
        'cost_per_job': ratio(total, len(known)),
        'cost_per_m2': ratio(on_area, math.fsum(j['area_mm2'] for j in areas) * 1e-6),
        'jobs_without_cost': len(jobs) - len(known),
    }  # fmt: skip
