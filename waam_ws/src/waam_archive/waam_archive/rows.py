"""job.yaml and report.json (docs/job_folder.md) become rows. Whatever is missing or of the wrong kind is NULL."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

from waam_process.loop_mode import LOOP_MODES, with_loop_mode
from waam_process.names import SEVERITIES

from .content import Row
from .schema import TABLES
from .values import dicts, integer, mapping, moment, number, numbers, ratio, text, truth

LAYER_NAMES = {  # column -> field of a LayerReport; all others have the same name
    'duration_s': 'duration', 'wait_s': 'wait', 'temperature_C': 'temperature', 'current_A': 'current_mean',
    'voltage_V': 'voltage_mean', 'wire_feed_m_s': 'wire_feed_mean', 'travel_speed_m_s': 'travel_speed_mean',
    'heat_input_J_m': 'heat_input', 'energy_J': 'energy', 'wire_m': 'wire_used', 'arc_on_s': 'arc_on_time',
    'height_error_rms_m': 'height_error_rms', 'height_error_max_m': 'height_error_max',
    'height_error_mean_m': 'height_error_mean',
}  # fmt: skip
READ = {
    'text': text, 'int': integer, 'float': number, 'bool': truth, 'floats': numbers, 'time': moment,
}  # fmt: skip


def _read(table: str, data: dict[str, Any], fields: dict[str, str] | None = None) -> Row:
    """The columns of a table out of a mapping of anybody's, each by its kind. fields: those with another name there."""
    named = fields or {}
    return {c.name: READ[c.kind](data.get(named.get(c.name, c.name))) for c in TABLES[table]}


@dataclass
class Told:
    """What a job says about itself: job.yaml, report.json (None: there is none), records.json and status.json."""

    asked: dict[str, Any] = field(default_factory=dict)
    report: dict[str, Any] | None = None
    records: dict[str, Any] = field(default_factory=dict)
    status: dict[str, Any] = field(default_factory=dict)
    report_text: str = ''
    asked_text: str = ''

    @property
    def goal(self) -> dict[str, Any]:
        """What was asked for."""
        return mapping(self.asked.get('goal'))

    @property
    def loop_mode(self) -> str:
        """Of LOOP_MODES, '' when nothing says it."""
        told = (with_loop_mode(fields).get('loop_mode') for fields in (self.goal, self.status))
        found = next((t for t in map(text, told) if t), '')
        of_report = [p for p in LOOP_MODES if isinstance(mapping(self.report).get(p), dict)]
        return found if found in of_report or not of_report else of_report[0]

    @property
    def run(self) -> dict[str, Any]:
        """Figures of the run: from the report, or what records.json of an unfinished job has."""
        return mapping(mapping(self.report).get(self.loop_mode)) or self.records

    @property
    def trace(self) -> dict[str, Any]:
        """Of the report."""
        return mapping(mapping(self.report).get('trace'))


def layer_rows(job: str, told: Told) -> list[Row]:
    """Table layers."""
    return [layer_row(job, r) for r in dicts(told.run.get('layers'))]


def layer_row(job: str, r: dict[str, Any]) -> Row:
    """r: a LayerReport by its field names."""
    return _read('layers', r, LAYER_NAMES) | {'job': job}


def anomaly_rows(job: str, told: Told) -> list[Row]:
    """Table anomalies."""
    found = dicts(told.run.get('anomalies'))
    return [anomaly_row(job, n, a) for n, a in enumerate(found, 1)]


def anomaly_row(job: str, n: int, a: dict[str, Any]) -> Row:
    """a: as in report.json."""
    severity = a.get('severity')
    if isinstance(severity, int) and 0 <= severity < len(SEVERITIES):
        severity = SEVERITIES[severity]
    x, y, z = (*(numbers(a.get('position')) or []), None, None, None)[:3]
    own = {'job': job, 'number': n, 'severity': text(severity), 'x_m': x, 'y_m': y, 'z_m': z}
    names = {'time_s': 'time', 'class_name': 'class' if text(a.get('class')) else 'class_name'}
    return _read('anomalies', a, names) | own


def calibration_row(job: str, told: Told) -> list[Row]:
    """Table calibration: no row when the report has none."""
    c = mapping(told.trace.get('calibration'))
    if not c:
        return []
    mounting = mapping(c.get('mounting'))
    mount = {k: numbers(mounting.get(k[: k.rindex('_')])) for k in ('mount_xyz_m', 'mount_rpy_rad')}
    return [_read('calibration', c) | mount | {'job': job}]


def consumable_rows(job: Row, told: Told) -> list[Row]:
    """Table consumables, from the row of the job."""
    name = job['job']
    wire = {'kind': 'wire', 'material': job['material'], 'lot': job['wire_lot']}
    amount = {'used_m': job['wire_m'], 'used_kg': job['wire_kg'], 'used_s': job['arc_on_s']}
    gas = {'kind': 'gas', 'lot': job['gas'], 'used_s': job['arc_on_s']}
    return [{'job': name, **wire, **amount}, {'job': name, **gas}]


def job_row(job: str, told: Told, kg_per_m: float | None, kept: float | None) -> Row:
    """Table jobs, without what maps and beads add (`add_surfaces`, `add_counts`).

    kg_per_m: of the wire; kept: share of it that stays on the part by the material table.
    """
    wire_m = _wire(told)
    wire_kg = wire_m * kg_per_m if wire_m is not None and kg_per_m is not None else None
    metal = wire_kg * kept if wire_kg is not None and kept is not None else None
    row = {'job': job, **_who(told), **_verdict(told), **_figures(told)}
    row['created'] = row['created'] or moment(job.partition('_')[0])  # <UTC>_<name>
    return row | {
        'wire_m': wire_m, 'wire_kg': wire_kg, 'metal_kg': metal, 'has_report': told.report is not None,
    }  # fmt: skip


def _wire(told: Told) -> float | None:
    total = number(told.run.get('wire_m'))
    return total if total is not None else _sum(told, 'wire_used')


def _sum(told: Told, name: str) -> float | None:
    found = [number(r.get(name)) for r in dicts(told.run.get('layers'))]
    known = [v for v in found if v is not None]
    return math.fsum(known) if known else None


def _who(told: Told) -> Row:
    report, trace, goal = mapping(told.report), told.trace, told.goal
    notes = dict(
        n.split('=', 1) for n in goal.get('notes') or () if isinstance(n, str) and '=' in n
    )
    part = text(report.get('part')) or text(goal.get('part'))
    controller, software = mapping(trace.get('controller')), mapping(trace.get('software'))
    material = text(report.get('material')) or text(goal.get('material'))
    return {
        'created': moment(report.get('created')), 'name': text(report.get('name')) or text(goal.get('name')),
        'part': PurePath(part).name if part else None,
        'part_sha256': text(trace.get('part_sha256')) or text(told.asked.get('part_sha256')),
        'material': material, 'mode': text(goal.get('mode')), 'loop_mode': text(told.loop_mode), 'cell': _cell(told),
        'operator': text(trace.get('operator')) or text(goal.get('operator_name')),
        'wire_lot': text(trace.get('wire_lot')) or text(notes.get('wire_lot')),
        'gas': text(trace.get('gas')) or text(notes.get('gas')),
        'software': text(software.get('software')) or text(told.asked.get('software')),
        'controller': text(controller.get('identity')), 'firmware': text(controller.get('firmware')),
    }  # fmt: skip


def _cell(told: Told) -> str | None:
    """Its name among several, else as the job itself names it for what it learns: also a job that learned nothing."""
    parameters = mapping(told.asked.get('parameters'))
    named = text(parameters.get('shop_cell')) or text(parameters.get('cell'))
    learned = text(mapping(told.trace.get('learned')).get('file'))
    folder = PurePath(learned).parent.name if learned else ''
    nodes = mapping(told.asked.get('nodes')).values()
    simulated = any(mapping(n).get('use_sim_time') is True for n in nodes)
    identity = text(mapping(told.trace.get('controller')).get('identity'))
    return named or text(folder) or ('simulated' if simulated else identity)


def _verdict(told: Told) -> Row:
    report, run, status = mapping(told.report), told.run, told.status
    error = integer(run.get('error_code')) if told.report else integer(status.get('error_code'))
    state = text(status.get('state'))
    if state is None and told.report is not None:
        state = 'FAILED' if error else 'DONE'
    return {
        'state': state, 'verdict': text(run.get('verdict')) or text(report.get('verdict')),
        'verdict_with_rim': text(run.get('verdict_with_rim')), 'error_code': error,
        'message': text(run.get('message')) or text(status.get('message')),
        'tolerance_mm': number(report.get('tolerance_mm')) or _times(told.goal.get('tolerance'), 1e3),
    }  # fmt: skip


def _times(value: Any, factor: float) -> float | None:
    found = number(value)
    return None if found is None else found * factor


SAME = (
    'rms_mm', 'max_mm', 'mean_mm', 'rms_all_mm', 'as_found_rms_mm', 'share_in_tolerance',
    'share_all_in_tolerance', 'duration_s', 'deposition_kg_h', 'cost',
)  # fmt: skip


def _figures(told: Told) -> Row:
    run = told.run
    row: Row = {name: number(run.get(name)) for name in SAME}
    row['energy_J'] = _or_sum(told, 'energy_J', 'energy')
    row['arc_on_s'] = _or_sum(told, 'arc_on_s', 'arc_on_time')
    row['overrun_mm'] = number(mapping(run.get('overrun_mm')).get('max'))
    if row['duration_s'] is None:
        row['duration_s'] = number(told.records.get('elapsed'))
    for name in ('faults', 'points_dropped', 'telemetry_lost'):
        row[name] = integer(run.get(name))
    return row | _judged(mapping(run.get('tolerance_map'))) | _means(told)


def _or_sum(told: Told, name: str, of_layer: str) -> float | None:
    total = number(told.run.get(name))
    return total if total is not None else _sum(told, of_layer)


def _judged(cells: dict[str, Any]) -> Row:
    judged = integer(cells.get('cells'))
    bad = [integer(cells.get(k)) or 0 for k in ('above', 'below', 'unseen')]
    defects = sum(bad) if judged else None
    return {
        'judged_cells': judged, 'defect_cells': defects, 'defect_share': ratio(defects, judged),
    }  # fmt: skip


def _means(told: Told) -> Row:
    rows = [r for r in dicts(told.run.get('layers')) if not r.get('final')]
    heat = [t for r in rows if (t := number(r.get('temperature'))) is not None]
    return {
        'current_A': _weighted(rows, 'current_mean'), 'voltage_V': _weighted(rows, 'voltage_mean'),
        'temperature_C': math.fsum(heat) / len(heat) if heat else None,
        'temperature_max_C': max(heat, default=None), 'layers': len(rows) if rows else None,
        'strikes': sum(integer(r.get('arc_starts')) or 0 for r in rows) if rows else None,
        'anomalies': len(dicts(told.run.get('anomalies'))),
    }  # fmt: skip


def _weighted(rows: list[dict], name: str) -> float | None:
    pairs = [(number(r.get(name)), number(r.get('arc_on_time'))) for r in rows]
    known = [(v, t) for v, t in pairs if v is not None and t]
    return ratio(math.fsum(v * t for v, t in known), math.fsum(t for _, t in known))


def report_row(job: str, told: Told) -> Row:
    """Table reports: the texts as they were."""
    report = told.report_text or (json.dumps(told.report) if told.report is not None else '')
    return {'job': job, 'report': text(report), 'asked': text(told.asked_text)}


def all_rows(
    job: str, told: Told, kg_per_m: float | None, kept: float | None
) -> dict[str, list[Row]]:
    """Rows of all small tables but beads."""
    row = job_row(job, told, kg_per_m, kept)
    return {
        'jobs': [row], 'layers': layer_rows(job, told), 'beads': [], 'anomalies': anomaly_rows(job, told),
        'calibration': calibration_row(job, told), 'consumables': consumable_rows(row, told),
        'reports': [report_row(job, told)],
    }  # fmt: skip
