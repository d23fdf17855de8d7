"""What a fit to recordings leaves: the cell file, fit.json, the page and the words on the screen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from waam_view.html import escape, page, table

from ..twin.page import cell_text, number, write_files
from .finding import Finding
from .fit import Recorded


def write(folder: Path, found: Recorded, told: str, scatter: Mapping[str, Any]) -> Path:
    """Writes the three files; returns the path of the page. told: the command line, or ''. scatter: of a preset, as in
    `waam_lab.twin.page.cell_text`."""
    facts = {'command': told, **asdict(found)}
    return write_files(folder, cell_file(found, scatter), facts, _html(found, told))


def cell_file(found: Recorded, scatter: Mapping[str, Any]) -> str:
    """A ROS parameter file with what the recordings tell, the same cell with every preset."""
    told = {p.name: p.value for p in found.joined}
    names = ', '.join(dict.fromkeys(f.recording for f in found.findings))
    return cell_text([f'Fitted by waam lab fit to {names}', *found.notes], scatter, told)


def lines(found: Recorded) -> list[str]:
    """For the screen: what was fitted, misfit before and after, what cannot be told."""
    out = []
    for f in found.findings:
        out += ['', f'{f.recording}: {f.kind}; {"; ".join(f.notes)}']
        out.append(f'  misfit {f.misfit[0]:.3g} before, {f.misfit[1]:.3g} after ({f.unit})')
        out += [f'  {row}' for row in _figures(f)]
        out += [f'  {row}' for row in _parameters(f)]
        out += [f'  cannot tell: {text}' for text in f.silent]
    out += ['', *(f'not fitted: {text}' for text in found.refused)] if found.refused else []
    return [*out, *(f'note: {text}' for text in found.notes)]


def _figures(f: Finding) -> list[str]:
    width = max(len(g.words) for g in f.figures)
    rows = [f'{"":{width}}  recorded    before     after']
    for g in f.figures:
        rows.append(
            f'{g.words:{width}}  {g.recorded:8.3f}  {g.before:8.3f}  {g.after:8.3f} {g.unit}'
        )
    return rows


def _parameters(f: Finding) -> list[str]:
    rows = []
    for p in f.parameters:
        if p.told:
            rows.append(
                f'{p.name} {number(p.value)} ({number(p.low)} .. {number(p.high)}; was {number(p.usual)})'
            )
    silent = [p.name for p in f.parameters if not p.told]
    return [*rows, f'not told, left as it was: {", ".join(silent)}'] if silent else rows


def _html(found: Recorded, told: str) -> str:
    parts = ['<h1>The simulated cell, fitted to recordings</h1>']
    rows = [
        [f.recording, f.kind, number(f.misfit[0]), number(f.misfit[1]), f.unit]
        for f in found.findings
    ]
    parts.append(table(['recording', 'kind', 'misfit before', 'after', 'of what'], rows, {0, 1, 4}))
    for f in found.findings:
        parts.append(f'<h2>{escape(f.recording)}: {escape(f.kind)}</h2>')
        parts.append(f'<p class="soft">{escape("; ".join(f.notes))}</p>')
        figures = [
            [g.words, g.unit, *(_short(v) for v in (g.recorded, g.before, g.after))]
            for g in f.figures
        ]
        parts.append(table(['', 'unit', 'recorded', 'before', 'after'], figures, {0, 1}))
        own = [
            [
                p.name,
                number(p.value) if p.told else 'not told',
                f'{number(p.low)} … {number(p.high)}',
                number(p.usual),
            ]
            for p in f.parameters
        ]
        parts.append(table(['', 'found', '90 % interval', 'was'], own, {0}))
        parts += [f'<p class="soft">Cannot tell: {escape(text)}.</p>' for text in f.silent]
    parts += [f'<p>Not fitted: {escape(text)}</p>' for text in found.refused]
    parts += [f'<p><b>{escape(text)}</b></p>' for text in found.notes]
    parts.append(f'<pre>{escape(told)}</pre>' if told else '')
    return page('WAAM laboratory: cell fitted to recordings', '\n'.join(parts))


def _short(value: float) -> str:
    return '–' if math.isnan(value) else f'{value:.3f}'
