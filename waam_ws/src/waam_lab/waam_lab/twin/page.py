"""What `waam lab fit` leaves: the cell file, fit.json and the page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from waam_job.store.folder import clean
from waam_node.files import write_atomically
from waam_node.job_folder import REPORT_PAGE
from waam_view.html import cards, escape, fmt, page, picture, table

from . import figures
from .fit import Estimate, Fitted
from .unknowns import NEVER

CELL_FILE, FACTS, PAGE = 'cell.yaml', 'fit.json', REPORT_PAGE
MAX_JOBS = 4  # with pictures
UNSAFE = 'Forecasts on this cell may end without an arc.'


def write(folder: Path, found: Fitted, told: str, scatter: Mapping[str, Any]) -> Path:
    """Writes the three files; returns the path of the page. told: the command line, or ''. scatter: see
    `cell_text`."""
    return write_files(folder, cell_file(found, scatter), facts(found, told), html(found, told))


def write_files(folder: Path, cell: str, found: Mapping[str, Any], html_page: str) -> Path:
    """Of any fit; returns the path of the page."""
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / CELL_FILE, cell)
    write_atomically(folder / FACTS, json.dumps(clean(found), indent=1))
    write_atomically(folder / PAGE, html_page)
    return folder / PAGE


def number(value: float) -> str:
    """Four digits."""
    return f'{value:.4g}'


def cell_text(notes: list[str], scatter: Mapping[str, Any], told: Mapping[str, float]) -> str:
    """The cell file with notes as comments: what was fitted, and the rest of what a preset sets (`scatter`) as it was
    on the cell of the fit, so that no preset adds scatter to what was fitted."""
    notes = [
        *notes,
        f'Of the cell that it was fitted on, so that no preset counts: {", ".join(scatter)}',
    ]
    values = dict(scatter) | {k: float(number(v)) for k, v in told.items()}
    text = yaml.safe_dump({'cell': {'ros__parameters': values}}, sort_keys=False)
    return ''.join(f'# {note}\n' for note in notes) + text


def cell_file(found: Fitted, scatter: Mapping[str, Any]) -> str:
    """A ROS parameter file for `waam up --cell-file` and `waam lab --cell-file`, the same cell with every preset."""
    jobs = ', '.join(m.job for m in found.misfits)
    silent = ', '.join(e.unknown.name for e in found.estimates if not e.told)
    notes = [f'Fitted by waam lab fit to {jobs}']
    notes += [f'Not told by these records, so left as usual: {silent}'] if silent else []
    if found.strikes is not None and not found.strikes.safe:
        notes.append(f'{UNSAFE} {found.strikes.words}')
    return cell_text(notes, scatter, found.values())


def facts(found: Fitted, told: str) -> dict[str, Any]:
    """fit.json; SI, NaN is null."""
    return {
        'command': told,
        'jobs': [asdict(m) for m in found.misfits],
        'current_misfit_A': found.current,
        'parameters': {e.unknown.name: _one(e) for e in found.estimates},
        'strikes': found.strikes and {**asdict(found.strikes), 'safe': found.strikes.safe},
        'never_told': dict(NEVER),
    }


def _one(e: Estimate) -> dict[str, Any]:
    k = e.unknown
    shown = {
        'value': e.value,
        'low': e.low,
        'high': e.high,
        'unit': k.unit,
        'told': e.told,
        'left': e.left,
    }
    return {**shown, 'usual': k.usual, 'spread': k.spread}


def html(found: Fitted, told: str) -> str:
    """The report as one page, pictures included."""
    head = f'{len(found.misfits)} jobs, {sum(m.layers for m in found.misfits)} layers'
    parts = [
        '<h1>The simulated cell, fitted to records</h1>',
        f'<p class="soft">{escape(head)}</p>',
        cards(_cards(found)),
        _strikes(found),
        '<h2>Parameters</h2>',
        picture(
            figures.intervals(found),
            'Grey bars: the records say little; the cell file leaves these out.',
        ),
        _parameters(found),
        _silent(found),
        '<h2>Misfit, before and after</h2>',
        _misfits(found),
    ]
    for i, m in enumerate(found.misfits[:MAX_JOBS]):
        parts.append(f'<h2>{escape(m.job)}</h2>')
        parts.append(picture(figures.maps(found, i), 'Growth of layers: measured less simulated.'))
        if found.replays[i].readings.t.size:
            parts.append(
                picture(figures.temperatures(found, i), 'What the pyrometer read without arc.')
            )
    parts.append(f'<pre>{escape(told)}</pre>' if told else '')
    return page('WAAM laboratory: fitted cell', '\n'.join(parts))


def _strikes(found: Fitted) -> str:
    if found.strikes is None:
        return ''
    advice = '' if found.strikes.safe else f'<b>{UNSAFE}</b> '
    return f'<p>{advice}{escape(found.strikes.words)}.</p>'


def _cards(found: Fitted) -> list[tuple[str, str]]:
    told = sum(e.told for e in found.estimates)
    height = [m.height for m in found.misfits]
    mean = [math.sqrt(sum(h[i] ** 2 for h in height) / len(height)) * 1e3 for i in (0, 1)]
    shown = [
        (f'{told} of {len(found.estimates)}', 'parameters told'),
        (f'{mean[0]:.3f} → {mean[1]:.3f} mm', 'RMS of layer growth'),
    ]
    if found.current is not None:
        shown.append((f'{found.current[0]:.1f} → {found.current[1]:.1f} A', 'RMS of the current'))
    return shown


def _parameters(found: Fitted) -> str:
    rows = []
    for e in found.estimates:
        k = e.unknown
        value = f'{number(e.value)} {k.unit}' if e.told else 'not told'
        interval = f'{number(e.low)} … {number(e.high)}'
        rows.append([k.name, value, interval, number(k.usual), fmt(100 * e.left, 0, '%'), k.words])
    head = ['', 'found', '90 % interval', 'usual', 'belief left', 'what it is']
    return table(head, rows, {0, 5})


def _silent(found: Fitted) -> str:
    text = (
        'A parameter counts as told when the records leave less than 70 % of the standard deviation that was believed '
        'before. Of the others the interval is little more than that belief: no figure is quoted, and the cell file '
        'leaves them as they were.'
    )
    rows = [[name, why] for name, why in NEVER.items()]
    return f'<p class="soft">{text}</p><h2>What no record of a job tells</h2>' + table(
        ['parameters', 'why, and what would tell'], rows, {0, 1}
    )


def _misfits(found: Fitted) -> str:
    rows = []
    for m in found.misfits:
        heights = [fmt(v * 1e3, 3) for v in m.height]
        metal, warm = [fmt((v - 1) * 100, 1) for v in m.metal], [fmt(v, 1) for v in m.celsius]
        rows.append([m.job, m.layers, *heights, *metal, *warm])
    head = [
        'job',
        'layers',
        'growth, mm',
        'after',
        'metal, % too much',
        'after',
        'pyrometer, K',
        'after',
    ]
    return table(head, rows, {0})
