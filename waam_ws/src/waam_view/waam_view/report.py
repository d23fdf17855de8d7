"""report.html: what a job did, on one self-contained page.

`write_report(folder)` reads what docs/job_folder.md describes. A folder with one run becomes the
report of that run, a folder with several runs (demo) a comparison that links to theirs.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from waam_node import job_folder
from waam_node.files import write_atomically
from waam_process import names
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.safe_files import is_file

from . import figures
from .comparison import comparison_page, machines
from .forecast_section import forecast_section
from .html import VERDICTS, cards, duration, escape, fmt, page, picture, table
from .job_data import Job, JobError, flatten, load_job, number, read_report, run_folder
from .layer_tables import layers_section
from .loop_summary import loop_summary
from .passes import passes_section
from .positioner_section import positioner_section
from .process_figures import process_plots
from .traceability import traceability_section


def write_report(folder: Path) -> Path:
    """Writes `report.html` into a job or demo folder and returns its path. Raises JobError without
    report.json."""
    folder = Path(folder)
    report = read_report(folder)
    modes = [p for p in LOOP_MODES if isinstance(report.get(p), dict)]
    if not modes:
        raise JobError(f'{folder / job_folder.REPORT}: holds none of {", ".join(LOOP_MODES)}')
    jobs = [load_job(folder, report, p) for p in modes]
    one = len(jobs) == 1
    beside = machines(folder, report, jobs)
    text = job_page(jobs[0], beside) if one else comparison_page(folder, jobs, beside)
    target = folder / job_folder.REPORT_PAGE
    own = folder / f'.report_{os.getpid()}.html'  # client and dashboard may write at the same time
    write_atomically(own, text)
    os.replace(own, target)
    return target


def write_all(folder: Path) -> list[Path]:
    """The report of a folder, after those of the runs inside it (demo). Raises JobError."""
    report = read_report(Path(folder))
    inside = {run_folder(folder, report.get(p)) for p in LOOP_MODES} - {Path(folder)}
    written = [write_report(f) for f in sorted(inside) if is_file(f / job_folder.REPORT)]
    return [*written, write_report(folder)]


def job_page(job: Job, machines: str = '') -> str:
    """The page of one run. machines: HTML of `comparison.machines`."""
    name = job.report.get('name') or job.report.get('job_id') or job.folder.name
    parts = [
        f'<h1>{escape(name)}</h1>',
        _subtitle(job),
        verdict_box(job),
        _figures_of_merit(job),
        forecast_section(job),
        loop_summary(job),
        _stock(job),
        _maps(job),
        machines,
        positioner_section(job),
        layers_section(job),
        passes_section(job),
        _process(job),
        _corrections(job),
        _counts(job),
        _anomalies(job),
        traceability_section(job),
        _provenance(job),
    ]
    return page(f'{name}: WAAM job report', '\n'.join(p for p in parts if p))


def _subtitle(job: Job) -> str:
    r = job.report
    facts = [
        ('part', r.get('part')),
        ('material', r.get('material')),
        ('loop mode', job.loop_mode.replace('_', ' ')),
        ('tolerance', f'±{job.tolerance_mm:g} mm'),
        ('job', r.get('job_id')),
        ('created', r.get('created')),
    ]
    shown = ' · '.join(f'{k}: <b>{escape(v)}</b>' for k, v in facts if v)
    return f'<p class=soft>{shown}</p>'


def verdict_box(job: Job) -> str:
    """Colour and words; a failed job says what happened."""
    run = job.run
    verdict = str(run.get('verdict') or job.report.get('verdict') or 'unknown')
    word, _, why = verdict.partition(': ')
    style = VERDICTS.get(word, 'bad')
    share = number(run.get('share_in_tolerance'))
    said = []
    if np.isfinite(share) and '%' not in str(run.get('message')) and not run.get('stock'):
        said.append(f'{100 * share:.1f} % of the judged surface within ±{job.tolerance_mm:g} mm')
    told = run.get('error_code') or 'with the rim' in str(run.get('message'))
    if run.get('verdict_with_rim') and not run.get('stock') and not why and not told:
        rim = 100 * number(run.get('share_all_in_tolerance'))
        said.append(f'with the rim {rim:.1f} %: {run["verdict_with_rim"]}')
    if run.get('error_code'):
        said.append(f'error {run["error_code"]}')
    if why:
        said.append(why)
    if run.get('message') and run['message'] != verdict:
        said.append(str(run['message']).removeprefix(f'{word}: '))
    words = escape('. '.join(s.rstrip('.') for s in said))
    return f'<div class="verdict {style}">{escape(word.upper())}<small>{words}</small></div>'


def _figures_of_merit(job: Job) -> str:
    r = job.run
    energy = number(r.get('energy_J'))
    return cards(
        [
            (fmt(r.get('rms_mm'), 3, 'mm'), 'RMS height error, final'),
            (fmt(r.get('max_mm'), 3, 'mm'), 'largest error'),
            (fmt(r.get('mean_mm'), 3, 'mm'), 'mean error'),
            (fmt(r.get('rms_all_mm'), 3, 'mm'), 'RMS with the rim'),
            (
                fmt((r.get('overrun_mm') or {}).get('max'), 1, 'mm'),
                'overrun over the sides, largest',
            ),
            (fmt(r.get('as_found_rms_mm'), 3, 'mm'), 'RMS as found'),
            (duration(r.get('duration_s')), 'duration'),
            (duration(r.get('arc_on_s')), 'arc on'),
            (fmt(r.get('wire_m'), 2, 'm'), 'wire'),
            (fmt(r.get('deposition_kg_h'), 2, 'kg/h'), 'deposition rate, arc on'),
            (fmt(energy / 1e6, 3, 'MJ'), 'arc energy'),
            (fmt(r.get('cost'), 4), cost_label(r)),
        ]
    )


def mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def cost_label(run: dict[str, Any]) -> str:
    """Reports of older jobs do not say what their cost counts."""
    if run.get('cost_terms') == ['height']:
        return 'cost J (eq 2.4), heights only: the material has no set current'
    return 'cost J (eq 2.4)'


def _stock(job: Job) -> str:
    """What is to be machined off, and what of the needed area got no metal; '' when neither is known."""
    stock, left = (mapping(job.run.get(k)) for k in ('stock', 'unlaid'))
    out = []
    if stock:
        facts = [
            (
                fmt(100 * number(stock.get('share')), 2, '%'),
                'of the needed area at or above nominal',
            ),
            (fmt(stock.get('mean_mm'), 2, 'mm'), 'to machine, mean'),
            (fmt(stock.get('high_mm'), 2, 'mm'), 'to machine, 99 % of what was laid'),
            (fmt(stock.get('volume_cm3'), 1, 'cm3'), 'to machine, volume'),
            (fmt(stock.get('below_mm'), 2, 'mm'), 'lowest place below nominal'),
        ]
        out += ['<h2>Stock to remove</h2>', cards(facts)]
        if job.scans and 'needed' in job.scans[-1].maps:
            said = (
                'Black: below nominal. Dashed: the needed area. Cell by cell: '
                f'{job_folder.STOCK_MAP}; the surface as laid: {job_folder.AS_LAID}.'
            )
            out.append(picture(figures.stock_map(job.scans[-1]), said))
    if number(left.get('area_mm2')) > 0:
        place = f'x = {fmt(left.get("x_mm"), 1)} mm, y = {fmt(left.get("y_mm"), 1)} mm'
        out.append(
            f'<p><b>No metal was laid</b> on {fmt(left.get("area_mm2"), 0, "mm2")} '
            f'({fmt(100 * number(left.get("share")), 1, "%")}) of the needed area, too narrow or too shallow '
            f'for a bead: up to {fmt(left.get("depth_mm"), 2, "mm")} deep at {place}.</p>'
        )
    return '\n'.join(out)


def _maps(job: Job) -> str:
    if not job.scans:
        return '<h2>Height error</h2><p>No scan was stored: the job ended before the first one.</p>'
    last, tolerance = job.scans[-1], job.tolerance_mm
    out = ['<h2>Height error</h2>']
    if np.isfinite(last.final_error).any():
        limit = figures.nice_range([last.final_error[last.interior] * 1e3], 2 * tolerance)
        caption = (
            f'Last scan ({last.layer} layers) against the nominal surface. Red: too high, blue: too low, '
            f'grey: not seen or outside. Thin lines: beyond ±{tolerance:g} mm. Dashed: judged area.'
        )
        out.append(picture(figures.final_map(last, tolerance, limit), caption))
        pair = [picture(figures.histogram(last, tolerance), 'Final error inside the judged area')]
        if len(job.layers) > 1:
            pair.append(picture(figures.convergence([job]), 'Error over the layers'))
        out.append(f'<div class=pair>{"".join(pair)}</div>')
    out.append(picture(figures.section(job), 'Cut through the middle; grey: after each layer'))
    errors = [s.error * 1e3 for s in job.scans]
    limit = figures.nice_range(errors, 2 * tolerance)
    titles = ['as found' if s.layer == 0 else f'after layer {s.layer}' for s in job.scans]
    caption = 'Surface minus the surface wanted at that moment, all on one scale.'
    out += _pictures(figures.grids(job.scans, errors, limit, 'height error, mm', titles), caption)
    return '\n'.join(out)


def _pictures(pages: list[bytes], caption: str) -> list[str]:
    """One caption for all of them, numbered when there are several."""
    if len(pages) == 1:
        return [picture(pages[0], caption)]
    return [picture(p, f'{caption} ({k} of {len(pages)})') for k, p in enumerate(pages, 1)]


def _process(job: Job) -> str:
    if not job.telemetry:
        return '<h2>Arc and heat</h2><p>No telemetry was stored.</p>'
    caption = 'Controller telemetry at 10 Hz; bands: layers.'
    return '<h2>Arc and heat</h2>' + picture(process_plots(job), caption)


def _corrections(job: Job) -> str:
    scans = [s for s in job.scans if 'psi' in s.maps]
    if not scans:
        return '<h2>Corrections</h2><p>No correction was computed.</p>'
    masked = [np.where(s.region, s.maps['psi'], np.nan) for s in scans]
    titles = [f'for layer {s.layer + 1}' for s in scans]
    grids = figures.grids(scans, masked, 1.0, 'ψ (V = V_prog (1 + k ψ))', titles)
    notes: dict[str, str] = {
        LoopMode.OPEN_LOOP: ' Open loop: no correction is applied.',
        LoopMode.MONITOR: ' Monitor: computed and shown, not applied.',
    }
    note = notes.get(job.loop_mode, '')
    caption = f'Travel-speed correction ψ: blue = slower, more metal; red = faster.{note}'
    return '<h2>Corrections</h2>' + '\n'.join(_pictures(grids, caption))


def _counts(job: Job) -> str:
    run, clamps = job.run, job.run.get('clamps') or {}
    rows = [
        ['segments with limited travel speed', clamps.get('speed')],
        ['segments with limited wire feed', clamps.get('feed')],
        ['segments with limited voltage', clamps.get('voltage')],
        ['segments with limited correction ψ', clamps.get('psi')],
        ['scanner points dropped (no return, spikes)', run.get('points_dropped')],
        ['profiles rejected (no pose, empty, out of order)', run.get('profiles_rejected')],
        ['telemetry frames lost', run.get('telemetry_lost')],
        ['faults', run.get('faults')],
    ]
    shown = [[text, '–' if value is None else value] for text, value in rows]
    flagged = {i for i in (6, 7) if number(rows[i][1]) > 0}
    return '<h2>Limits, drop-outs and faults</h2>' + table(['event', 'count'], shown, {0}, flagged)


def _severity(value: object) -> str:
    """Name of a severity that is given as name or number."""
    return names.severity(value) if isinstance(value, int) else str(value).upper()


def _anomalies(job: Job) -> str:
    found = [a for a in job.run.get('anomalies') or [] if isinstance(a, dict)]
    if not found:
        return '<h2>Anomalies</h2><p>None were reported.</p>'
    start = float(job.telemetry['t'][0]) if job.telemetry else 0.0
    rows, flagged = [], set()
    for i, a in enumerate(found):
        severity = _severity(a.get('severity'))
        said = [a.get(k, '') for k in ('class', 'text', 'reaction', 'layer', 'bead')]
        time = fmt(number(a.get('time')) - start, 1)
        rows.append([time, severity.lower(), *said, _position(a.get('position'))])
        if severity in names.FAULTS:
            flagged.add(i)
    head = ['time, s', 'severity', 'class', 'what', 'reaction', 'layer', 'bead', 'at x, y, z, mm']
    return '<h2>Anomalies</h2>' + table(head, rows, {1, 2, 3, 4, 7}, flagged)


def _position(place: object) -> str:
    if isinstance(place, dict):
        place = [place.get(k) for k in 'xyz']
    if not isinstance(place, list | tuple):
        return '–'
    return ', '.join(fmt(number(v) * 1e3, 1) for v in place)


# of job.yaml; everything else there says what ran
_SETTINGS = ('job_id', 'goal', 'material', 'parameters', 'nodes')


def _provenance(job: Job) -> str:
    """Versions and hashes; the settings of the job can be unfolded."""
    ran = {k: v for k, v in job.asked.items() if k not in _SETTINGS}
    settings = {k: v for k, v in job.asked.items() if k in _SETTINGS}
    out = ['<h2>Provenance</h2>']
    if ran:
        out.append(table(['what', 'value'], [list(r) for r in flatten(ran)], {0, 1}))
    else:
        out.append('<p>job.yaml gives no versions or hashes.</p>')
    if settings:
        listed = table(['key', 'value'], [list(r) for r in flatten(settings)], {0, 1})
        out.append(f'<details><summary>Goal, material and parameters</summary>{listed}</details>')
    for file, text in (
        (job_folder.viewer_recording(), 'rerun recording'),
        (job_folder.record(), 'MCAP recording'),
    ):
        if (job.folder / file).exists():
            out.append(f'<p>{text}: <span class=mono>{escape(file)}</span></p>')
    out += [f'<p class=soft>Note: {escape(n)}</p>' for n in job.notes]
    return '\n'.join(out)


def main(arguments: list[str]) -> int:
    """python3 -m waam_view.report FOLDER: 0, or 1 with one line on stderr."""
    try:
        print(write_report(Path(arguments[0])))
    except (ValueError, OSError) as e:
        print(e, file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
