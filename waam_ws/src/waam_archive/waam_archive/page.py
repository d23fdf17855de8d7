"""The traceability record of a part as one HTML page. Pure."""

from __future__ import annotations

from html import escape
from typing import Any

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; margin: .5rem 0 1rem } th, td { text-align: left; padding: .2rem .8rem .2rem 0;
vertical-align: top; border-bottom: 1px solid #ddd } th { font-weight: 600; white-space: nowrap }
h2 { margin-top: 2.5rem } .missing { color: #a40000 } code { font-size: .85em; overflow-wrap: anywhere }
@media print { h2 { break-before: page } }
"""
SECTIONS = (
    ('feedstock', 'Feedstock'), ('equipment', 'Equipment'), ('software', 'Software'), ('calibration', 'Calibration'),
    ('programs', 'Programs (hash)'), ('models', 'Correction networks (hash: layers)'), ('results', 'Results'),
    ('notes', 'Notes'),
)  # fmt: skip


def part_page(record: dict[str, Any]) -> str:
    """record: of `traceability.part_record`."""
    title = f'Traceability record: {record["part"]}'
    parts = [f'<h1>{escape(title)}</h1>', _overview(record)]
    parts += [_job(entry) for entry in record['jobs']]
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(parts)}</body></html>'


def _overview(record: dict[str, Any]) -> str:
    rows = ''.join(
        f'<tr><td>{_value(e["created"])}</td><td>{escape(e["job"])}</td><td>{_value(e["operator"])}</td>'
        f'<td>{_value(e["feedstock"]["wire_lot"])}</td><td>{_value(e["results"]["verdict"])}</td></tr>'
        for e in record['jobs']
    )
    head = (
        '<tr><th>when (UTC)</th><th>job</th><th>operator</th><th>wire lot</th><th>verdict</th></tr>'
    )
    remarks = ''.join(f'<p class="missing">{escape(r)}</p>' for r in record['remarks'])
    hashes = ''.join(f'<p>Part file: <code>{escape(h)}</code></p>' for h in record['part_sha256'])
    return f'{remarks}{hashes}<table>{head}{rows}</table>'


def _job(e: dict[str, Any]) -> str:
    missing = ', '.join(e['not_told'])
    parts = [
        f'<h2>{escape(e["job"])}</h2>',
        f'<p class="missing">Not told: {escape(missing)}</p>' if missing else '',
        f'<p>Operator: {_value(e["operator"])}. Hash of the job: <code>{escape(str(e["sha256"]))}</code></p>',
    ]
    parts += [_table(title, e[key]) for key, title in SECTIONS if e[key]]
    if e['anomalies']:
        shown = [
            (f'{a["severity"]} {a["class_name"]}', f'{a["text"]} ({a["reaction"]})')
            for a in e['anomalies']
        ]
        parts.append(_rows('Anomalies', shown))
    return ''.join(parts)


def _table(title: str, values: dict[str, Any]) -> str:
    return _rows(title, list(values.items()))


def _rows(title: str, values: list[tuple[str, Any]]) -> str:
    rows = ''.join(f'<tr><th>{escape(str(k))}</th><td>{_value(v)}</td></tr>' for k, v in values)
    return f'<h3>{escape(title)}</h3><table>{rows}</table>'


def _value(value: Any) -> str:
    if value is None or value == '':
        return '<span class="missing">not told</span>'
    if isinstance(value, float):
        return f'{value:.4g}'
    if isinstance(value, dict):
        return escape(', '.join(f'{k} {v}' for k, v in value.items()))
    return escape(str(value))
