"""Verbs that show jobs: list, show, compare, find."""

from __future__ import annotations

import argparse
from typing import Any

from .common import (
    Verbs,
    add_filters,
    add_verb,
    jobs_meant,
    opened,
    print_json,
    print_table,
    selection,
    shown,
)

LISTED = (
    'created', 'job', 'part', 'material', 'operator', 'wire_lot', 'verdict', 'rms_mm', 'metal_kg',
)  # fmt: skip
COMPARED = (
    'created', 'part', 'material', 'loop_mode', 'cell', 'operator', 'wire_lot', 'gas', 'verdict', 'rms_mm', 'max_mm',
    'share_in_tolerance', 'layers', 'beads', 'strikes_per_bead', 'anomalies', 'faults', 'wire_m', 'metal_kg',
    'efficiency',
    'material_use', 'energy_J', 'duration_s', 'arc_on_s', 'deposition_kg_h', 'current_A', 'voltage_V', 'temperature_C',
    'software', 'firmware',
)  # fmt: skip
OF_LAYER = (
    'layer', 'pass_number', 'final', 'temperature_C', 'current_A', 'voltage_V', 'wire_m', 'arc_starts',
    'height_error_rms_mm', 'psi_mean', 'flow_factor', 'law',
)  # fmt: skip


def register(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    """Adds the verbs."""
    p = add_verb(verbs, common, 'list', 'jobs, newest first', _list)
    add_filters(p)
    p.add_argument(
        '-n', '--limit', type=int, default=50, help='at most so many; 0 = all (default 50)'
    )
    p = add_verb(verbs, common, 'show', 'one job: figures, layers, anomalies, consumables', _show)
    p.add_argument('name', metavar='JOB', help='its id, or a part of it that no other job has')
    p = add_verb(verbs, common, 'compare', 'jobs side by side', _compare)
    p.add_argument('names', metavar='JOB', nargs='*', help='ids, or parts of them; or filters')
    add_filters(p)
    p = add_verb(
        verbs, common, 'find', 'jobs with a text in names, messages, anomalies or reports', _find
    )
    p.add_argument('text', metavar='TEXT', help='capitals do not count')
    add_filters(p)


def _list(args: argparse.Namespace) -> int:
    if args.limit < 0:
        raise ValueError(f'--limit {args.limit}: must not be negative')
    rows = opened(args).jobs(selection(args), args.limit)
    if args.json:
        print_json(rows)
    elif rows:
        print_table(list(LISTED), [[r[c] for c in LISTED] for r in rows])
    else:
        print('no job fits these filters')
    return 0


def _show(args: argparse.Namespace) -> int:
    archive = opened(args)
    job = archive.job_named(args.name)
    tables = ('jobs', 'layers', 'anomalies', 'calibration', 'consumables')
    found = {t: archive.of_job(t, job) for t in tables}
    if args.json:
        print_json({**found, 'jobs': found['jobs'][0]})
        return 0
    for name, value in found['jobs'][0].items():
        if value is not None:
            print(f'{name:22s} {shown(value)}')
    print()
    print_table(list(OF_LAYER), [_of_layer(r) for r in found['layers']])
    for c in found['calibration']:
        told = c['trouble'] or f'{c["artefact"] or "?"}, {c["date"] or "no date"}'
        print(f'calibration of the scanner: {shown(c["file"] or "parameters")}, {shown(told)}')
    for c in found['consumables']:
        used = {'m': c['used_m'], 'kg': c['used_kg'], 's': c['used_s']}
        amounts = ', '.join(f'{shown(v)} {unit}' for unit, v in used.items() if v is not None)
        named = ' '.join(shown(c[k]) for k in ('kind', 'material', 'lot') if c[k])
        print(f'{named}: {amounts}')
    for a in found['anomalies']:
        print(f'{a["severity"]} {a["class_name"]}: {shown(a["text"])} ({shown(a["reaction"])})')
    return 0


def _of_layer(row: dict[str, Any]) -> list[Any]:
    error = row['height_error_rms_m']
    row = {**row, 'height_error_rms_mm': None if error is None else error * 1e3}
    return [row[c] for c in OF_LAYER]


def _compare(args: argparse.Namespace) -> int:
    archive = opened(args)
    rows = [archive.of_job('jobs', job)[0] for job in jobs_meant(args, archive)]
    if args.json:
        print_json(rows)
        return 0
    table: list[list[Any]] = [[c, *(r[c] for r in rows)] for c in COMPARED]
    marked = [
        [('* ' if len(set(map(str, row[1:]))) > 1 else '  ') + row[0], *row[1:]] for row in table
    ]
    print_table(['  ', *(r['job'] for r in rows)], marked)
    print('* = not the same in all of them')
    return 0


def _find(args: argparse.Namespace) -> int:
    rows = opened(args).find(args.text, selection(args))
    if args.json:
        print_json(rows)
    elif rows:
        columns = ('created', 'job', 'verdict', 'place', 'said')
        print_table(list(columns), [[r[c] for c in columns] for r in rows])
    else:
        print(f"no job has '{shown(args.text)}'")
    return 0
