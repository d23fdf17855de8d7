"""report.json, report.html and maps.npz of a campaign: the same job on many cells."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from waam_job.store.folder import clean
from waam_node.files import write_atomically
from waam_process.unrolled import Unrolled
from waam_process.verdicts import IN_TOLERANCE
from waam_view.html import cards, duration, escape, fmt, page, picture, table
from waam_view.shaft_section import round_picture

from . import bands, pictures
from .job import LabJob, LabResult


@dataclass(frozen=True)
class Row:
    """A figure of the table: name in LabResult, label, unit, factor from SI, decimals."""

    name: str
    label: str
    unit: str = 'mm'
    factor: float = 1e3
    digits: int = 3
    more_is_better: bool = False


ROWS = (
    Row('rms', 'RMS height error'),
    Row('rms_edges', '... rim included'),
    Row('share_in_tolerance', 'cells in tolerance', '%', 100.0, 1, True),
    Row('share_edges', '... rim included', '%', 100.0, 1, True),
    Row('largest', 'largest error (99.5 % of the cells)'),
    Row('mean_size', 'level, mean error'),
    Row('overrun', 'overrun over the sides, largest', 'mm', 1e3, 1),
    Row('clean_share', 'needed area at or above nominal', '%', 100.0, 1, True),
    Row('stock_mean', 'stock to machine, mean', 'mm', 1e3, 2),
    Row('stock_high', '... 99 % of what was laid', 'mm', 1e3, 2),
    Row('unlaid_share', 'needed area without metal', '%', 100.0, 1),
    Row('clean_diameter', 'cleans up at diameter', 'mm', 1e3, 2, True),
    Row('roundness', 'roundness of the new surface'),
    Row('new_run_out', 'run-out of the new surface'),
    Row('time', 'machine time', 's', 1.0, 0),
    Row('wire', 'wire', 'm', 1.0, 2),
)


@dataclass(frozen=True)
class Campaign:
    """Jobs that differ only in their seed, and their results."""

    job: LabJob
    results: Sequence[LabResult]
    wall: float  # s that all of them took
    workers: int
    told: str = ''  # the command line, or ''
    notes: tuple[str, ...] = ()  # what of the worn part's file was left out or assumed

    @property
    def warnings(self) -> list[str]:
        """What the planner warns of, as the first job that was planned tells it, and the notes."""
        told: list[str] = [f'as found: {text}' for text in self.notes]
        for r in self.results:
            first = [a for a in r.anomalies if a.get('class') == 'height' and not a.get('layer')]
            texts = [str(a.get('text')) for a in first if a.get('severity') == 'WARNING']
            if r.anomalies or not r.failed:
                return told + [f'seed {r.seed}: {text}' for text in dict.fromkeys(texts)]
        return told

    @property
    def word(self) -> str:
        """What good jobs do."""
        return 'clean up' if self.job.machined else IN_TOLERANCE

    @property
    def by(self) -> str:
        """Who did the work, in words."""
        return f'with {self.workers} workers'

    @property
    def speed(self) -> float:
        """Simulated seconds per second of processor time."""
        done = [r for r in self.results if math.isfinite(r.time) and r.cpu > 0]
        return sum(r.time for r in done) / sum(r.cpu for r in done) if done else math.nan

    @property
    def failed(self) -> list[LabResult]:
        """Jobs that ended with an error."""
        return [r for r in self.results if r.failed]

    def rows(self) -> list[tuple[Row, bands.Band]]:
        """Figures with their bands, in the order of ROWS; those that no job has are missing."""
        found = [(row, bands.band(self.results, row.name, row.more_is_better)) for row in ROWS]
        return [(row, b) for row, b in found if b is not None]


def write(folder: Path, campaign: Campaign) -> Path:
    """Writes the three files and returns the path of the page."""
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / 'report.json', json.dumps(clean(facts(campaign)), indent=1))
    maps = bands.maps(campaign.results, campaign.job.goal.tolerance)
    if maps is not None:
        _write_maps(folder / 'maps.npz', maps)
    target = folder / 'report.html'
    write_atomically(target, html(campaign, maps))
    return target


def facts(c: Campaign) -> dict[str, Any]:
    """report.json; figures in the units of their names, NaN is null."""
    goal, share = c.job.goal, bands.in_tolerance(c.results)
    return {
        'part': goal.file.name,
        'as_found': c.job.as_found.name if c.job.as_found else None,
        'mode': goal.mode,
        'material': goal.material,
        'loop_mode': goal.loop_mode,
        'tolerance_mm': goal.tolerance * 1e3,
        'preset': c.job.preset if c.job.plant is None else '',
        'overrides': {node: dict(values) for node, values in c.job.overrides.items()},
        'command': c.told,
        'in_tolerance': {**asdict(share), 'value': share.value},
        'failed': len(c.failed),
        'figures': {row.name: _scaled(row, band) for row, band in c.rows()},
        'level_after_layers_mm': [[v * 1e3 for v in row] for row in bands.level_bands(c.results)],
        'jobs': [_job(r) for r in c.results],
        'speed': c.speed,
        'wall_s': c.wall,
        'workers': c.workers,
    }


def _scaled(row: Row, band: bands.Band) -> dict[str, Any]:
    values = {k: v * row.factor for k, v in asdict(band).items() if k != 'worst_seed'}
    return {'unit': row.unit, **values, 'worst_seed': band.worst_seed}


def _job(r: LabResult) -> dict[str, Any]:
    row = {row.name: getattr(r, row.name) * row.factor for row in ROWS}
    words = {'seed': r.seed, 'verdict': r.verdict, 'error_code': r.error_code}
    return {
        **words,
        'message': r.message,
        **row,
        'layers': r.layers,
        'fallbacks': r.fallbacks,
        'layer_means_mm': [m * 1e3 for m in r.layer_means],
        'anomalies': [dict(a) for a in r.anomalies],
        'folder': r.folder.name if r.folder else None,
    }


def _write_maps(path: Path, maps: bands.Maps) -> None:
    spec = maps.first.spec
    np.savez_compressed(
        path,
        origin=np.array([spec.origin_x, spec.origin_y]),
        resolution=np.array(spec.resolution),
        mean=maps.mean.astype(np.float32),
        worst=maps.worst.astype(np.float32),
        within=maps.within.astype(np.float32),
        region=maps.region,
        interior=maps.interior,
    )


# ---- the page ----------------------------------------------------------------------------------


def html(c: Campaign, maps: bands.Maps | None) -> str:
    """The report as one page, pictures included; maps None = no pictures."""
    goal = c.job.goal
    title = f'{goal.title}: what will come out'
    parts = [
        f'<h1>{escape(title)}</h1>',
        _subtitle(c),
        _verdict(c),
        _cards(c),
        _warnings(c),
        '<h2>Over all cells</h2>' + _bands(c),
        _pictures(c, maps),
        '<h2>Job by job</h2>' + _jobs(c),
        _about(c),
    ]
    return page(f'{goal.title}: WAAM laboratory', '\n'.join(parts))


def _subtitle(c: Campaign) -> str:
    goal = c.job.goal
    facts = [
        f'part {goal.file.name}',
        f'as found {c.job.as_found.name}' if c.job.as_found else 'on a flat plate',
        goal.material,
        goal.loop_mode.replace('_', ' '),
        f'tolerance ±{goal.tolerance * 1e3:g} mm',
        f'{len(c.results)} simulated cells' + (f' ({c.job.preset})' if c.job.plant is None else ''),
    ]
    return f'<p class="soft">{escape(" · ".join(facts))}</p>'


def _verdict(c: Campaign) -> str:
    share = bands.in_tolerance(c.results)
    kind = 'ok' if share.value >= 0.95 else 'warn' if share.count else 'bad'
    chance = f'{share.low * 100:.0f} to {share.high * 100:.0f} %'
    said = f'{share.count} of {share.of} jobs {c.word}'
    small = f'of all such jobs: {chance} (95 % confidence)'
    return f'<div class="verdict {kind}">{escape(said)}<small>{escape(small)}</small></div>'


def _warnings(c: Campaign) -> str:
    if not c.warnings:
        return ''
    items = ''.join(f'<li>{escape(text)}</li>' for text in c.warnings)
    return f'<h2>Warnings</h2><ul class="warnings">{items}</ul>'


def _cards(c: Campaign) -> str:
    found = {row.name: (row, band) for row, band in c.rows()}

    def shown(name: str) -> str:
        if name not in found:
            return '–'
        row, band = found[name]
        return fmt(band.mean * row.factor, row.digits, row.unit)

    return cards(
        [
            (shown('rms'), 'RMS height error, mean'),
            (shown('share_in_tolerance'), 'cells in tolerance, mean'),
            (duration(found['time'][1].mean) if 'time' in found else '–', 'machine time, mean'),
            (shown('wire'), 'wire, mean'),
        ]
    )


def _bands(c: Campaign) -> str:
    head = ['', 'mean', 'next part, 95 %', 'best', 'worst', 'worst seed']
    return table(head, [[row.label, *cells(row, b)] for row, b in c.rows()], {0})


def cells(row: Row, b: bands.Band) -> list[str]:
    """mean, interval, best, worst, seed of the worst, as text."""
    mean, low, high, best, worst = (
        fmt(v * row.factor, row.digits) for v in (b.mean, b.low, b.high, b.best, b.worst)
    )
    interval = f'{low} … {high}' if math.isfinite(b.low) else '–'
    return [f'{mean} {row.unit}', interval, best, worst, str(b.worst_seed)]


def _pictures(c: Campaign, maps: bands.Maps | None) -> str:
    if maps is None:
        return '<p>No job came to its end, so there are no maps.</p>'
    tolerance, done = c.job.goal.tolerance, sum(r.maps is not None for r in c.results)
    where = pictures.error_maps(maps, tolerance, done)
    spread = pictures.histogram(bands.judged_errors(c.results), tolerance)
    level = pictures.levels(bands.level_bands(c.results), tolerance)
    inside = 'Dashed: the judged area.'
    first = next(r for r in c.results if r.maps is not None)
    round_part = ''
    if first.maps is not None and (diameter := c.job.shaft_diameter):
        told = f'The shaft of seed {first.seed}. Angle 0 is up; the axis is y of the map.'
        round_part = '<h2>The shaft</h2>' + picture(
            round_picture(
                first.maps.spec, first.maps.error, first.maps.as_found, Unrolled(diameter)
            ),
            told,
        )
    return round_part + (
        '<h2>Where the errors are</h2>'
        + picture(where, f'Error of the finished surface, cell by cell. {inside}')
        + '<div class="pair">'
        + picture(spread, 'All judged cells of all jobs.')
        + picture(level, 'The level of every layer when it was laid.')
        + '</div>'
    )


def _jobs(c: Campaign) -> str:
    shown = [r for r in ROWS if any(math.isfinite(getattr(x, r.name)) for x in c.results)]
    head = ['seed', 'verdict', *(f'{r.label}, {r.unit}' for r in shown), 'layers', 'fallbacks', '']
    rows = []
    for r in c.results:
        figures = [fmt(getattr(r, row.name) * row.factor, row.digits) for row in shown]
        said = r.message if r.failed else ''
        rows.append([r.seed, r.verdict, *figures, r.layers, r.fallbacks, said])
    flagged = {i for i, r in enumerate(c.results) if not r.in_tolerance}
    return table(head, rows, {1, len(head) - 1}, flagged)


def _about(c: Campaign) -> str:
    changed = [f'{n}.{k} = {v}' for n, values in c.job.overrides.items() for k, v in values.items()]
    lines = [
        f'{len(c.results)} jobs in {duration(c.wall)} {c.by}, '
        f'{fmt(c.speed, 0)} s of machine time per second and core.',
        'Each job runs on a simulated cell of its own, which differs in everything that is random: efficiency of beads '
        'over the place, arc, scanner, pyrometer. A real cell differs from the simulated one as well.',
    ]
    lines += [f'Changed parameters: {", ".join(changed)}.'] if changed else []
    body = ''.join(f'<p class="soft">{escape(text)}</p>' for text in lines)
    command = f'<pre>{escape(c.told)}</pre>' if c.told else ''
    return f'<h2>How this was found</h2>{body}{command}'
