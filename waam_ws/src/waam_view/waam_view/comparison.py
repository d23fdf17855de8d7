"""The page of a demo: the same part in several loop modes, side by side."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from waam_node import job_folder
from waam_process.loop_mode import LoopMode
from waam_process.operating import GANTRY, ROBOT
from waam_process.unrolled import UNROLLED

from . import figures
from .html import VERDICTS, cards, duration, escape, fmt, page, picture, table
from .job_data import Job, load_job, mapping, number
from .loop_summary import loop_summary
from .outcome import outcome
from .owner_page import local_time


def comparison_page(folder: Path, jobs: list[Job], machines: str = '') -> str:
    """`jobs`: the runs of one report.json, same part and tolerance."""
    report = jobs[0].report
    name = report.get('name') or report.get('job_id') or Path(folder).name
    modes = ' against '.join(j.loop_mode.replace('_', ' ') for j in jobs)
    machine = f'machine: <b>{escape(report["machine"])}</b> · ' if report.get('machine') else ''
    preset = report.get('preset')
    cell = f'simulated cell: <b>{escape(preset)}</b> · ' if preset else ''
    parts = [
        f'<h1>{escape(name)}</h1>',
        f'<p class=soft>{escape(modes)} · {machine}{cell}part: <b>{escape(report.get("part", ""))}</b> · '
        f'material: <b>{escape(report.get("material", ""))}</b> · tolerance: '
        f'<b>±{jobs[0].tolerance_mm:g} mm</b> · {escape(local_time(report.get("created", "")))}</p>',
        _verdict(report, jobs),
        _outcome(report),
        _cards(report, jobs),
        *(loop_summary(j) for j in jobs if j.loop_mode == LoopMode.CLOSED_LOOP),
        _maps(jobs),
        machines,
        _second(report),
        _table_of_runs(jobs),
        _rms_by_layer(jobs),
        _links(folder, jobs),
    ]
    return page(f'{name}: comparison', '\n'.join(parts))


def _second(report: dict) -> str:
    """The part of a demo that is machined afterwards; '' without one."""
    run = report.get('second')
    if not isinstance(run, dict):
        return ''
    link = escape(f'{run.get("folder")}/{job_folder.REPORT_PAGE}')
    said = escape(str(run.get('message') or run.get('verdict') or ''))
    return (
        f'<h2>A part that is machined afterwards</h2><p>{escape(str(run.get("part") or ""))}, closed loop, finish '
        f'machined: {said}. '
        f'<a href="{link}">Its report</a> has the forecast beside the outcome and what is left to machine.</p>'
    )


def ratio(report: dict, jobs: list[Job]) -> float:
    """RMS closed over open loop, NaN when one is missing."""
    stated = number(report.get('ratio'))
    runs = {j.loop_mode: number(j.run.get('rms_mm')) for j in jobs}
    if np.isfinite(stated) or not {LoopMode.OPEN_LOOP, LoopMode.CLOSED_LOOP} <= runs.keys():
        return stated
    return (
        runs[LoopMode.CLOSED_LOOP] / runs[LoopMode.OPEN_LOOP]
        if runs[LoopMode.OPEN_LOOP] > 0
        else float('nan')
    )


def _verdict(report: dict, jobs: list[Job]) -> str:
    verdict = str(report.get('verdict') or 'unknown')
    word = verdict.partition(': ')[0]
    style = VERDICTS.get(word, 'bad')
    each = '; '.join(
        f'{j.loop_mode.replace("_", " ")}: {j.run.get("verdict", "unknown")}'
        + (f' ({j.run["message"]})' if j.run.get('message') and j.run.get('error_code') else '')
        for j in jobs
    )
    return f'<div class="verdict {style}">{escape(word.upper())}<small>{escape(each)}</small></div>'


def _outcome(report: dict) -> str:
    said = re.sub(r'`(.+?)`', r'<code>\1</code>', escape(outcome(report)))
    return f'<p>{said}</p>' if said else ''


def _cards(report: dict, jobs: list[Job]) -> str:
    items = [
        (fmt(j.run.get('rms_mm'), 3, 'mm'), f'RMS {j.loop_mode.replace("_", " ")}') for j in jobs
    ]
    value = ratio(report, jobs)
    items.append((fmt(value, 3), 'RMS closed over open loop'))
    if np.isfinite(value) and value > 0:
        items.append((fmt(1 / value, 1), 'times smaller error'))
    return cards(items)


def _maps(jobs: list[Job]) -> str:
    shown = [j for j in jobs if j.scans and np.isfinite(j.scans[-1].final_error).any()]
    if not shown:
        return '<h2>Final height error</h2><p>No run has a final scan.</p>'
    errors = [j.scans[-1].final_error[j.scans[-1].interior] * 1e3 for j in shown]
    limit = figures.nice_range(errors, 2 * shown[0].tolerance_mm)
    caption = (
        'Last scan against the nominal surface, the same colour scale for all. Red: too high, blue: too '
        f'low. Thin lines: beyond ±{shown[0].tolerance_mm:g} mm. Dashed: judged area.'
    )
    if shown[0].shaft:
        caption += f' The shaft is shown {UNROLLED}; some of it is shown again beyond both ends.'
    out = ['<h2>Final height error</h2>', picture(figures.side_by_side(shown, limit), caption)]
    pair = [
        picture(
            figures.histogram(j.scans[-1], j.scans[-1].final_error * 1e3, j.tolerance_mm, limit),
            j.loop_mode.replace('_', ' '),
        )
        for j in shown
    ]
    out.append(f'<div class=pair>{"".join(pair)}</div>')
    return '\n'.join(out)


def machines(folder: Path, report: dict, jobs: list[Job]) -> str:
    """Of a demo on a robot the closed loop of the robot and of the gantry; '' where only one machine has run."""
    robot = next((j for j in jobs if j.loop_mode == LoopMode.CLOSED_LOOP), None)
    if robot is None or not isinstance(report.get(GANTRY), dict):
        return ''
    pair = [replace(robot, loop_mode=ROBOT), load_job(folder, report, GANTRY)]
    out = ['<h2>Robot and gantry</h2><p>The same part in closed loop on both machines.</p>']
    shown = [j for j in pair if j.scans and np.isfinite(j.scans[-1].final_error).any()]
    if shown:
        errors = [j.scans[-1].final_error[j.scans[-1].interior] * 1e3 for j in shown]
        limit = figures.nice_range(errors, 2 * robot.tolerance_mm)
        caption = 'Last scan against the nominal surface on both machines.'
        out.append(picture(figures.side_by_side(shown, limit), caption))
    page_of = f'{report[GANTRY].get("folder")}/{job_folder.REPORT_PAGE}'
    link = f'<p><a href="{escape(page_of)}">Report of the gantry</a></p>'
    return '\n'.join([*out, _runs(pair), link])


_ROWS = [
    ('verdict', 'verdict', None, 0),
    ('RMS height error, mm', 'rms_mm', 1, 3),
    ('largest error, mm', 'max_mm', 1, 3),
    ('mean error, mm', 'mean_mm', 1, 3),
    ('verdict with the rim', 'verdict_with_rim', None, 0),
    ('RMS with the rim, mm', 'rms_all_mm', 1, 3),
    ('RMS as found, mm', 'as_found_rms_mm', 1, 3),
    ('within tolerance, %', 'share_in_tolerance', 100, 1),
    ('within tolerance with the rim, %', 'share_all_in_tolerance', 100, 1),
    ('wire, m', 'wire_m', 1, 2),
    ('deposition rate (arc on), kg/h', 'deposition_kg_h', 1, 2),
    ('arc energy, MJ', 'energy_J', 1e-6, 3),
    ('scanner points dropped', 'points_dropped', 1, 0),
    ('profiles rejected', 'profiles_rejected', 1, 0),
    ('telemetry frames lost', 'telemetry_lost', 1, 0),
    ('faults', 'faults', 1, 0),
]
_OF_SHAFT = [
    ('diameter that the lathe reaches all over, mm', 'clean_diameter_mm'),
    ('roundness, mean, mm', 'roundness_mm'),
    ('run-out of the new surface, mm', 'new_run_out_mm'),
    ('step at the seam of the map, mm', 'seam_step_mm'),
]


def _table_of_runs(jobs: list[Job]) -> str:
    return '<h2>Runs</h2>' + _runs(jobs)


def _runs(jobs: list[Job]) -> str:
    rows = []
    for text, key, factor, digits in _ROWS:
        values = [j.run.get(key) for j in jobs]
        shown = [v if factor is None else fmt(number(v) * factor, digits) for v in values]
        rows.append([text, *shown])
    for text, key in _OF_SHAFT if jobs[0].shaft else ():
        rows.append([text, *(fmt(mapping(j.run.get('shaft')).get(key), 2) for j in jobs)])
    rows.append(['duration', *(duration(j.run.get('duration_s')) for j in jobs)])
    rows.append(['arc on', *(duration(j.run.get('arc_on_s')) for j in jobs)])
    for kind in ('speed', 'feed', 'voltage', 'psi'):
        counts = [(j.run.get('clamps') or {}).get(kind, '–') for j in jobs]
        rows.append([f'segments with limited {kind}', *counts])
    head = ['', *(j.loop_mode.replace('_', ' ') for j in jobs)]
    return table(head, rows, {0})


def _rms_by_layer(jobs: list[Job]) -> str:
    if not any(j.layers for j in jobs):
        return ''
    count = max(len(j.layers) for j in jobs)
    rows = []
    for i in range(count):
        layers = [j.layers[i] if i < len(j.layers) else {} for j in jobs]
        final = any(x.get('final') for x in layers)
        values = [fmt(number(x.get('height_error_rms')) * 1e3, 3) for x in layers]
        rows.append(['after the last layer' if final else f'before layer {i + 1}', *values])
    head = ['RMS height error, mm', *(j.loop_mode.replace('_', ' ') for j in jobs)]
    chart = picture(figures.convergence(jobs), 'RMS height error over the layers')
    listed = table(head, rows, {0})
    return f'<h2>Error by layer</h2><div class=pair>{chart}<figure>{listed}</figure></div>'


def _links(folder: Path, jobs: list[Job]) -> str:
    out = ['<h2>Reports of the runs</h2>']
    for job in jobs:
        place = str(job.run.get('folder') or '.')
        name = escape(job.loop_mode.replace('_', ' '))
        if place != '.' and (job.folder / job_folder.REPORT).is_file():
            out.append(f'<p><a href="{escape(place)}/{job_folder.REPORT_PAGE}">{name}</a></p>')
        else:
            out.append(f'<p>{name}: no report of its own</p>')
    return '\n'.join(out)
