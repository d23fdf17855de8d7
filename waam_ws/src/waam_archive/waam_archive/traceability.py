"""What one part went through, over all its jobs: feedstock, people, equipment, software, calibration, programs, results
(ISO/ASTM 52943-2), and what nobody told. Pure."""

from __future__ import annotations

import json
from typing import Any

from .values import mapping, text

Row = dict[str, Any]
WANTED = {  # what a record of a job must name -> column of `jobs`
    'operator': 'operator', 'wire lot': 'wire_lot', 'shielding gas': 'gas', 'material': 'material',
    'hash of the part': 'part_sha256', 'software': 'software', 'controller': 'controller', 'cell': 'cell',
}  # fmt: skip
RESULTS = (
    'verdict', 'rms_mm', 'max_mm', 'share_in_tolerance', 'tolerance_mm', 'layers', 'beads', 'wire_m', 'metal_kg',
    'energy_J',
    'duration_s', 'temperature_max_C',
)  # fmt: skip


def part_record(
    part: str, jobs: list[Row], reports: list[Row], anomalies: list[Row], calibration: list[Row]
) -> dict[str, Any]:
    """The record of a part. Rows of the tables of that name, of all its jobs."""
    jobs = sorted(jobs, key=lambda j: (j['created'] is None, str(j['created']), j['job']))
    told = {r['job']: _trace(r) for r in reports}
    calibrated = {c['job']: c for c in calibration}
    entries = [_entry(j, told.get(j['job'], {}), calibrated.get(j['job']), anomalies) for j in jobs]
    hashes = sorted({j['part_sha256'] for j in jobs if j['part_sha256']})
    return {
        'part': part,
        'part_sha256': hashes,
        'remarks': _remarks(hashes, entries),
        'jobs': entries,
    }


def _trace(row: Row) -> dict[str, Any]:
    try:
        return mapping(mapping(json.loads(row['report'] or 'null')).get('trace'))
    except ValueError:
        return {}


def _entry(job: Row, told: dict[str, Any], calibration: Row | None, anomalies: list[Row]) -> Row:
    missing = [name for name, column in WANTED.items() if not job[column]]
    if calibration is None or not calibration['date']:
        missing.append('calibration of the scanner')
    return {
        'job': job['job'], 'created': job['created'], 'source': job['source'], 'sha256': job['sha256'],
        'feedstock': {'material': job['material'], 'wire_lot': job['wire_lot'], 'gas': job['gas']},
        'operator': job['operator'],
        'equipment': {'cell': job['cell'], 'controller': job['controller'], 'firmware': job['firmware']},
        'software': {'revision': job['software'], 'packages': mapping(mapping(told.get('software')).get('packages'))},
        'calibration': {k: (calibration or {}).get(k) for k in ('file', 'date', 'sha256', 'artefact', 'age_days')},
        'programs': {k: mapping(v).get('sha256') for k, v in mapping(told.get('programs')).items()},
        'models': mapping(told.get('models')),
        'learned': mapping(told.get('learned')).get('sha256'),
        'results': {k: job[k] for k in RESULTS},
        'anomalies': [a for a in anomalies if a['job'] == job['job'] and a['severity'] != 'INFO'],
        'notes': {str(k): text(v) for k, v in mapping(told.get('notes')).items()},
        'not_told': missing,
    }  # fmt: skip


def _remarks(hashes: list[str], entries: list[Row]) -> list[str]:
    said = []
    if len(hashes) > 1:
        said.append(
            f'the file of the part was changed between jobs: {len(hashes)} different hashes'
        )
    incomplete = [e['job'] for e in entries if e['not_told']]
    if incomplete:
        said.append(f'{len(incomplete)} of {len(entries)} jobs lack something a record must name')
    return said
