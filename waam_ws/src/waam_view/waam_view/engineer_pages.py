"""Second part of the report, for who runs the process: worst places and why, error by layer, beads, limits, heat."""

from __future__ import annotations

import math

import numpy as np

from waam_process import names, verdicts
from waam_process.loop_mode import LoopMode

from . import figures
from .beads import beads
from .html import cards, fmt, picture, table
from .job_data import Job, mapping, number
from .process_figures import process_plots
from .worst_places import Place, is_machined

FOLDED = 60  # beads, above which their list is folded: a page and a half of A4


def surface_section(job: Job, places: list[Place]) -> str:
    """Map with the worst places, why they are as they are, figures of the surface, error by layer, cut, all maps."""
    if not job.scans:
        return (
            '<h2>Surface</h2><p>No scan was stored: the job ended before the first one.</p>'
            + _merit(job)
        )
    last, tolerance, machined = job.scans[-1], job.tolerance_mm, is_machined(job)
    error = (last.error if machined else last.final_error) * 1e3
    out = ['<h2>Surface</h2>', _merit(job)]
    if np.isfinite(error).any():
        limit = figures.nice_range([error[last.interior]], 2 * tolerance)
        against = (
            'the surface aimed at (nominal and allowance)' if machined else 'the nominal surface'
        )
        caption = (
            f'Last scan ({last.layer} layers) against {against}. Red: too high, blue: too low, grey: not seen or '
            f'outside. Thin lines: beyond ±{tolerance:g} mm. Dashed: judged area. Numbers: worst places.'
        )
        marks = [(p.x_mm, p.y_mm) for p in places]
        out.append(picture(figures.error_map(last, error, tolerance, limit, marks), caption))
        out.append(_places(job, places))
        pair = [
            picture(figures.histogram(last, error, tolerance), 'Deviation inside the judged area')
        ]
        if len(job.layers) > 1:
            pair.append(picture(figures.convergence([job]), 'Error by layer'))
        out.append(f'<div class=pair>{"".join(pair)}</div>')
    cut = 'Cut through the middle; grey: after each layer.'
    out.append(picture(figures.section(job, error), cut))
    errors = [s.error * 1e3 for s in job.scans]
    limit = figures.nice_range(errors, 2 * tolerance)
    titles = ['as found' if s.layer == 0 else f'after layer {s.layer}' for s in job.scans]
    caption = 'Surface minus the surface wanted at that moment, all on one scale.'
    out += _pictures(figures.grids(job.scans, errors, limit, 'height error, mm', titles), caption)
    return '\n'.join(out)


def _merit(job: Job) -> str:
    r, stock = job.run, mapping(job.run.get('stock'))
    aimed = ' from the surface aimed at' if stock else ' from nominal'
    shown = [
        (fmt(r.get('rms_mm'), 3, 'mm'), f'RMS height error{aimed}, final'),
        (fmt(r.get('mean_mm'), 3, 'mm'), 'mean error'),
        (fmt(r.get('max_mm'), 3, 'mm'), 'largest error'),
        (fmt(r.get('rms_all_mm'), 3, 'mm'), 'RMS with the rim'),
        (fmt(mapping(r.get('overrun_mm')).get('max'), 1, 'mm'), 'overrun over the sides, largest'),
        (fmt(r.get('as_found_rms_mm'), 3, 'mm'), 'RMS as found'),
        (fmt(stock.get('allowance_mm'), 2, 'mm'), 'machining allowance aimed at'),
        (fmt(r.get('deposition_kg_h'), 2, 'kg/h'), 'deposition rate, arc on'),
    ]
    return cards([c for c in shown if c[0] != '–' or 'final' in c[1]])


def _places(job: Job, places: list[Place]) -> str:
    if not places:
        return ''
    rows = []
    for k, p in enumerate(places, 1):
        errors = ', '.join(fmt(e, 2) for e in p.errors_mm)
        causes = '; '.join(p.causes) or 'cause not known'
        rows.append([k, f'{p.x_mm:.1f}', f'{p.y_mm:.1f}', f'{p.value_mm:+.2f}', errors, causes])
    value = 'left to machine, mm' if is_machined(job) else 'from nominal, mm'
    head = [
        'place',
        'x, y, mm',
        value,
        'from its target after each scan, mm',
        'what the record shows',
    ]
    return (
        '<h3>Worst places</h3>'
        + table(head, rows, {4, 5})
        + '<p class=soft>The first scan is the part as found. Of the last layer it is told what it was set to and what '
        'it gave, and what lay within a bead width of the place.</p>'
    )


def _pictures(pages: list[bytes], caption: str) -> list[str]:
    """One caption for all of them, numbered when there are several."""
    if len(pages) == 1:
        return [picture(pages[0], caption)]
    return [picture(p, f'{caption} ({k} of {len(pages)})') for k, p in enumerate(pages, 1)]


def beads_section(job: Job) -> str:
    """One row from arc on to arc off."""
    found = beads(job.telemetry)
    if not found:
        return '<h2>Beads</h2><p>No telemetry of beads was stored.</p>'
    rows, flagged = [], set()
    for k, b in enumerate(found, 1):
        said = _said_of(job, b.start, b.start + b.duration)
        if said:
            flagged.add(k - 1)
        numbers = [
            (b.current, 0), (b.voltage, 1), (b.wire_feed * 60, 2), (b.speed * 1e3, 1), (b.heat_input * 1e-3, 0),
            (b.temperature, 0),
        ]  # fmt: skip
        shown = [fmt(v, d) for v, d in numbers]
        rows.append([k, b.layer, _clock(b.start), fmt(b.duration, 1), *shown, said])
    head = [
        'bead', 'layer', 'start, min:s', 'arc on, s', 'current, A', 'voltage, V', 'wire, m/min', 'travel, mm/s',
        'heat input, J/mm', 'temperature at its start, °C', 'remarks',
    ]  # fmt: skip
    listed = table(head, rows, {len(head) - 1}, flagged)
    note = '<p class=soft>A bead is what was laid from arc on to arc off; means over that time.</p>'
    if len(rows) > FOLDED:
        listed = f'<details><summary>{len(rows)} beads</summary>{listed}</details>'
    return f'<h2>Beads</h2>{listed}{note}'


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f'{minutes}:{rest:02d}'


def _said_of(job: Job, start: float, end: float) -> str:
    """What was reported while the bead was laid, or within a second after its end: an arc that is lost ends it."""
    zero = float(job.telemetry['t'][0])
    texts = [
        str(a.get('text'))
        for a in job.run.get('anomalies') or []
        if isinstance(a, dict) and start <= number(a.get('time')) - zero <= end + 1.0
    ]
    return '; '.join(texts)


def limits_section(job: Job) -> str:
    """What was limited, lost or failed, as counts."""
    run, clamps = job.run, mapping(job.run.get('clamps'))
    rows = [
        ['segments with limited travel speed', clamps.get('speed')],
        ['segments with limited wire feed', clamps.get('feed')],
        ['segments with limited voltage', clamps.get('voltage')],
        ['segments with limited correction of the speed, ψ', clamps.get('psi')],
        ['scanner points dropped (no return, spikes)', run.get('points_dropped')],
        ['profiles rejected (no pose, empty, out of order)', run.get('profiles_rejected')],
        ['telemetry frames lost', run.get('telemetry_lost')],
        ['faults', run.get('faults')],
    ]
    shown = [[text, '–' if value is None else value] for text, value in rows]
    flagged = {i for i in (6, 7) if number(rows[i][1]) > 0}
    return '<h2>Limits, drop-outs and faults</h2>' + table(['event', 'count'], shown, {0}, flagged)


def heat_section(job: Job) -> str:
    """Arc and heat over time."""
    if not job.telemetry:
        return '<h2>Arc and heat</h2><p>No telemetry was stored.</p>'
    return '<h2>Arc and heat</h2>' + picture(
        process_plots(job), 'Controller telemetry at 10 Hz; bands: layers.'
    )


def corrections_section(job: Job) -> str:
    """Maps of the correction of the speed."""
    scans = [s for s in job.scans if 'psi' in s.maps]
    if not scans:
        return '<h2>Corrections</h2><p>No correction was computed.</p>'
    masked = [np.where(s.region, s.maps['psi'], np.nan) for s in scans]
    titles = [f'for layer {s.layer + 1}' for s in scans]
    grids = figures.grids(scans, masked, 1.0, 'ψ, share of the largest correction', titles)
    notes: dict[str, str] = {
        LoopMode.OPEN_LOOP: ' Open loop: no correction is applied.',
        LoopMode.MONITOR: ' Monitor: computed and shown, not applied.',
    }
    note = notes.get(job.loop_mode, '')
    caption = f'Correction of the travel speed: blue = slower, more metal; red = faster.{note}'
    return '<h2>Corrections</h2>' + '\n'.join(_pictures(grids, caption))


def anomalies_section(job: Job) -> str:
    """What was reported, when and where; of a height also what it was in the end."""
    schedule = ' '.join(str(mapping(p).get('schedule')) for p in job.run.get('passes') or [])
    found = [a for a in job.run.get('anomalies') or [] if isinstance(a, dict)]
    found = [
        a for a in found if not a.get('text') or str(a['text']) not in schedule
    ]  # told where the layers are
    if not found:
        return '<h2>Anomalies</h2><p>None were reported.</p>'
    start = float(job.telemetry['t'][0]) if job.telemetry else 0.0
    rows, flagged = [], set()
    for i, a in enumerate(found):
        severity = (
            names.severity(a['severity'])
            if isinstance(a.get('severity'), int)
            else str(a.get('severity'))
        )
        reaction, (good, end) = str(a.get('reaction', '')), _in_the_end(job, a)
        severity = 'INFO' if good else severity.upper()
        said = [a.get('class', ''), a.get('text', ''), '' if reaction == 'none' else reaction, end]
        seconds = number(a.get('time')) - start
        time = _clock(seconds) if math.isfinite(seconds) and seconds >= 0 else '–'
        rows.append(
            [time, severity.lower(), *said, a.get('layer', ''), a.get('bead', ''), _position(a)]
        )
        if severity in names.FAULTS:
            flagged.add(i)
    head = [
        'time, min:s',
        'severity',
        'class',
        'what',
        'reaction',
        'in the end',
        'layer',
        'bead',
        'at x, y, z, mm',
    ]
    return '<h2>Anomalies</h2>' + table(head, rows, {1, 2, 3, 4, 5, 8}, flagged)


def _in_the_end(job: Job, anomaly: dict) -> tuple[bool, str]:
    """(whether it was made good, what the last scan showed there) of a reported height; (False, '') of others."""
    place = anomaly.get('position')
    if (
        anomaly.get('class') != 'height'
        or not job.scans
        or not isinstance(place, list | tuple)
        or len(place) < 2
    ):
        return False, ''
    last, machined = job.scans[-1], is_machined(job)
    newest = last.layer if machined else last.layer - 1
    at = (
        np.array([number(place[1]) - last.origin[1], number(place[0]) - last.origin[0]])
        / last.resolution
    )
    if (
        not 0 < number(anomaly.get('layer')) <= newest
        or not np.isfinite(at).all()
        or (at < 0).any()
    ):
        return False, ''
    row, col = at.astype(int).tolist()
    if row >= last.z.shape[0] or col >= last.z.shape[1]:
        return False, ''
    end = float((last.final_error if machined else last.error)[row, col]) * 1e3
    if not math.isfinite(end):
        return False, ''
    if machined:
        good = end >= 0 and job.run.get('verdict') == verdicts.CLEANS_UP
        return good, f'{end:+.2f} mm left to machine there'
    return abs(end) <= job.tolerance_mm, f'{end:+.2f} mm from what was aimed at'


def _position(anomaly: dict) -> str:
    """A dash for what was said before the first layer: then the torch was where it parks."""
    place = anomaly.get('position')
    if isinstance(place, dict):
        place = [place.get(k) for k in 'xyz']
    if not isinstance(place, list | tuple) or anomaly.get('layer') == 0:
        return '–'
    return ', '.join(fmt(number(v) * 1e3, 1) for v in place)
