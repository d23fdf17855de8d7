"""The tables of the report, layer by layer: what the arc did, what the surface was, what was corrected."""

from __future__ import annotations

from .html import escape, fmt, table
from .job_data import Job, number

_PROCESS = [  # heading, field, factor to the shown unit, digits
    ('temperature before, °C', 'temperature', 1, 0),
    ('wait, s', 'wait', 1, 0),
    ('duration, s', 'duration', 1, 0),
    ('arc on, s', 'arc_on_time', 1, 0),
    ('arc starts', 'arc_starts', 1, 0),
    ('current, A', 'current_mean', 1, 1),
    ('voltage, V', 'voltage_mean', 1, 2),
    ('wire, m/min', 'wire_feed_mean', 60, 2),
    ('travel, mm/s', 'travel_speed_mean', 1e3, 2),
    ('heat input, J/mm', 'heat_input', 1e-3, 0),
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
    ('ψ min', 'psi_min', 1, 2), ('ψ mean', 'psi_mean', 1, 2), ('ψ max', 'psi_max', 1, 2), ('authority', 'k_gain', 1, 2),
    ('by heat', 'heat_factor', 1, 3), ('by flow', 'flow_factor', 1, 3), ('by width', 'width_ratio', 1, 3),
]  # fmt: skip


# fields of columns that are left out where no layer has a value: most jobs show no free bead and hold no width
_RARE = ('bead_width', 'bead_width_u', 'width_ratio')


def _shown(columns: list[tuple], layers: list[dict]) -> list[tuple]:
    return [c for c in columns if c[1] not in _RARE or any(number(x.get(c[1])) > 0 for x in layers)]


def _cells(layer: dict, columns: list[tuple]) -> list[str]:
    return [fmt(number(layer.get(f)) * k, d) for _, f, k, d in columns]


def layers_section(job: Job) -> str:
    """Three tables: what the arc did in each layer, the surface after it, and the correction that it was laid with."""
    if not job.layers:
        return '<h2>Layers</h2><p>No layer was completed.</p>'
    laid = [x for x in job.layers if not x.get('final')]
    process = [[x.get('layer'), *_cells(x, _PROCESS)] for x in laid]
    faulty = {i for i, x in enumerate(laid) if x.get('faults')}
    out = ['<h2>Layers</h2>', table(['layer', *(c[0] for c in _PROCESS)], process, {0}, faulty)]
    geometry, correction = (_shown(c, job.layers) for c in (_GEOMETRY, _CORRECTION))
    rows = [
        [_scan_name(job, i), *_cells(x, geometry), _expected(job, i)]
        for i, x in enumerate(job.layers)
    ]
    head = ['surface', *(c[0] for c in geometry), 'RMS expected, mm']
    out += ['<h3>Surface by layer</h3>', table(head, rows, {0}, last=laid != job.layers)]
    out.append(
        '<p class=soft>Against the target of that moment. Bead width: where beads of the layer stand free, with its '
        'standard uncertainty u. Expected: before the layer was laid, with its 90 % interval.</p>'
    )
    rows = [_correction_row(x, correction) for x in laid]
    fell_back = {i for i, x in enumerate(laid) if x.get('fallback')}
    limited = [f'limited: {what}' for what in ('travel', 'wire', 'voltage', 'ψ')]
    head = ['layer', *(c[0] for c in correction), *limited, 'law']
    listed = table(head, rows, {0, len(head) - 1}, fell_back)
    out += ['<h3>Correction by layer</h3>', listed]
    out.append(
        '<p class=soft>ψ: correction of the travel speed as a share of what is allowed; authority: that largest share. '
        'Wire by heat, flow, width: factors of the wire feed (width: of the voltage, 0 = not held). Limited: segments. '
        'Shaded: a simpler law took over.</p>'
    )
    out += _remarks(job)
    return '\n'.join(out)


def _scan_name(job: Job, i: int) -> str:
    """A record of a layer holds the surface before it, the one marked final that after the last layer."""
    layer = job.layers[i]
    if layer.get('final'):
        return 'final'
    before = number(layer.get('layer')) - 1
    return 'as found' if before < 1 else f'after layer {before:.0f}'


def _correction_row(layer: dict, correction: list[tuple]) -> list:
    limited = [layer.get(f'clamps_{k}', 0) for k in ('speed', 'feed', 'voltage', 'psi')]
    applied = '' if layer.get('correction_applied') else ' (not applied)'
    law = f'{str(layer.get("law") or "–").replace("_", " ")}{applied}'
    return [layer.get('layer'), *_cells(layer, correction), *limited, law]


def _remarks(job: Job) -> list[str]:
    """What was said of a layer, over the whole width: it can be long."""
    items = []
    for layer in job.layers:
        said = '; '.join(map(str, layer.get('reasons') or []))
        if said and said != job.run.get('message'):  # that is the verdict
            name = 'final' if layer.get('final') else f'layer {layer.get("layer")}'
            items.append(f'<li>{escape(name)}: {escape(said)}</li>')
    return [f'<h3>Remarks</h3><ul>{"".join(items)}</ul>'] if items else []


def _expected(job: Job, i: int) -> str:
    """What was expected of this surface before its layer was laid."""
    layer = job.layers[i - 1] if i else {}
    rms, low, high = (1e3 * number(layer.get(f'expected_rms{k}')) for k in ('', '_low', '_high'))
    return f'{rms:.2f} ({low:.2f} to {high:.2f})' if rms > 0 else '–'
