"""The tables of the report, layer by layer: what the arc did, what the surface was, what was corrected."""

from __future__ import annotations

from .html import fmt, table
from .job_data import Job, number

_PROCESS = [  # heading, field, factor to the shown unit, digits
    ('T before, °C', 'temperature', 1, 0),
    ('wait, s', 'wait', 1, 0),
    ('duration, s', 'duration', 1, 0),
    ('arc on, s', 'arc_on_time', 1, 0),
    ('arc starts', 'arc_starts', 1, 0),
    ('I, A', 'current_mean', 1, 1),
    ('U, V', 'voltage_mean', 1, 2),
    ('feed, m/min', 'wire_feed_mean', 60, 2),
    ('travel, mm/s', 'travel_speed_mean', 1e3, 2),
    ('heat, J/mm', 'heat_input', 1e-3, 0),
    ('energy, kJ', 'energy', 1e-3, 0),
    ('wire, m', 'wire_used', 1, 2),
    ('faults', 'faults', 1, 0),
]
_GEOMETRY = [
    ('RMS, mm', 'height_error_rms', 1e3, 3), ('max, mm', 'height_error_max', 1e3, 2), ('mean, mm', 'height_error_mean',
    1e3, 3), ('seen, %', 'coverage', 100, 1), ('bead width, mm', 'bead_width', 1e3, 2), ('u, mm', 'bead_width_u', 1e3,
    2),
]  # fmt: skip
_CORRECTION = [
    ('ψ min', 'psi_min', 1, 2), ('ψ mean', 'psi_mean', 1, 2), ('ψ max', 'psi_max', 1, 2), ('k_gain', 'k_gain', 1, 2),
    ('K heat', 'heat_factor', 1, 3), ('K flow', 'flow_factor', 1, 3), ('K width', 'width_ratio', 1, 3),
]  # fmt: skip


# fields of columns that are left out where no layer has a value: most jobs show no free bead and hold no width
_RARE = ('bead_width', 'bead_width_u', 'width_ratio')


def _shown(columns: list[tuple], layers: list[dict]) -> list[tuple]:
    return [c for c in columns if c[1] not in _RARE or any(number(x.get(c[1])) > 0 for x in layers)]


def _cells(layer: dict, columns: list[tuple]) -> list[str]:
    return [fmt(number(layer.get(f)) * k, d) for _, f, k, d in columns]


def layers_section(job: Job) -> str:
    """Two tables: what the arc did in each layer, and what the surface and the correction were
    before it."""
    if not job.layers:
        return '<h2>Layers</h2><p>No layer was completed.</p>'
    laid = [x for x in job.layers if not x.get('final')]
    process = [[x.get('layer'), *_cells(x, _PROCESS)] for x in laid]
    faulty = {i for i, x in enumerate(laid) if x.get('faults')}
    head = ['layer', *(c[0] for c in _PROCESS)]
    out = ['<h2>Layers</h2>', table(head, process, {0}, faulty)]
    geometry, correction = (_shown(c, job.layers) for c in (_GEOMETRY, _CORRECTION))
    rows, flagged = [], set()
    for i, layer in enumerate(job.layers):
        rows.append(_surface_row(layer, geometry, correction))
        if layer.get('fallback'):
            flagged.add(i)
    head = [
        'before',
        *(c[0] for c in (*geometry, *correction)),
        'expected RMS after it, mm',
        'clamps s/f/v/ψ',
        'law',
        'remarks',
    ]
    out.append(
        table(head, rows, {0, len(head) - 2, len(head) - 1}, flagged, bool(laid != job.layers))
    )
    out.append(
        '<p class=soft>Second table: the surface before each layer against its target, and the correction '
        'made from it; clamps: segments with limited speed, feed, voltage, ψ. Bead width: of the layer before, '
        'where its beads stand free, with its standard uncertainty u; K width: by which the voltage holds it, '
        '0 = not held; expected: with its 90 % interval. Shaded: a fault was met, or the correction fell back.</p>'
    )
    return '\n'.join(out)


def _surface_row(layer: dict, geometry: list[tuple], correction: list[tuple]) -> list[str]:
    remarks = '; '.join(map(str, layer.get('reasons') or []))
    if layer.get('final'):
        blank = ['–'] * (len(correction) + 3)
        return ['final', *_cells(layer, geometry), *blank, remarks]
    kinds = ('speed', 'feed', 'voltage', 'psi')
    clamps = '/'.join(str(layer.get(f'clamps_{k}', 0)) for k in kinds)
    applied = '' if layer.get('correction_applied') else ' (not applied)'
    law = f'{str(layer.get("law") or "–").replace("_", " ")}{applied}'
    numbers = _cells(layer, [*geometry, *correction])
    return [f'layer {layer.get("layer")}', *numbers, _expected(layer), clamps, law, remarks]


def _expected(layer: dict) -> str:
    rms, low, high = (1e3 * number(layer.get(f'expected_rms{k}')) for k in ('', '_low', '_high'))
    return f'{rms:.2f} ({low:.2f} to {high:.2f})' if rms > 0 else '–'
