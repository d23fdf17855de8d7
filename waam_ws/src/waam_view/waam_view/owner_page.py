"""First page of the report, for who pays for the part: what came out, what it took, what is left to do, a signature."""

from __future__ import annotations

import math
from datetime import datetime

from waam_node import job_folder
from waam_process.prices import JOULE_PER_KWH, PriceError, Prices
from waam_process.verdicts import CLEANS_UP, DOES_NOT_CLEAN_UP, IN_TOLERANCE, OUT_OF_TOLERANCE

from . import figures, part_picture
from .html import VERDICTS, cards, duration, escape, fmt, picture
from .job_data import Job, mapping, number
from .plan_file import PlanFileError, read_settings
from .prices import HOW, Use, costs, find_prices
from .worst_places import Place, is_machined


def owner_page(job: Job, places: list[Place]) -> str:
    """HTML. places: of `worst_places`; they are marked on the map of the second page."""
    name = job.report.get('name') or job.report.get('job_id') or job.folder.name
    return '\n'.join(
        p
        for p in (
            f'<h1>{escape(name)}</h1>',
            _subtitle(job),
            verdict_box(job),
            _pictures(job),
            _use(job),
            _left(job, places),
            _signature(),
        )
        if p
    )


def local_time(text: object) -> str:
    """An ISO time as date and time of this computer with the name and the offset of its zone; other text as it is."""
    try:
        there = datetime.fromisoformat(str(text))
    except ValueError:
        return str(text)
    if there.tzinfo is None:
        return f'{there:%Y-%m-%d %H:%M} (zone not told)'
    here = there.astimezone()
    return f'{here:%Y-%m-%d %H:%M} {here:%Z} (UTC{here:%z})'


def _subtitle(job: Job) -> str:
    r, trace = job.report, mapping(job.run.get('trace') or job.report.get('trace'))
    facts = [
        ('part', r.get('part')),
        ('material', r.get('material')),
        ('tolerance', f'±{job.tolerance_mm:g} mm'),
        ('correction', job.loop_mode.replace('_', ' ')),
        ('operator', trace.get('operator')),
        ('job', r.get('job_id')),
        ('finished', r.get('created') and local_time(r['created'])),
    ]
    shown = ' · '.join(f'{k}: <b>{escape(v)}</b>' for k, v in facts if v)
    return f'<p class=soft>{shown}</p>'


def verdict_box(job: Job) -> str:
    """Colour, the word, and one sentence; a failed job says what happened."""
    run = job.run
    verdict = str(run.get('verdict') or job.report.get('verdict') or 'unknown')
    word, _, why = verdict.partition(': ')
    style = VERDICTS.get(word, 'bad')
    said = [s for s in (_sentence(job, word), why) if s]
    if run.get('error_code'):
        said.append(f'error {run["error_code"]}')
    if not said or run.get('error_code'):
        message = str(run.get('message') or '').removeprefix(f'{word}: ')
        said += [message] if message and message not in (verdict, why) else []
    words = escape('. '.join(s.rstrip('.') for s in said))
    return f'<div class="verdict {style}">{escape(word.upper())}<small>{words}</small></div>'


def _sentence(job: Job, word: str) -> str:
    run, stock = job.run, mapping(job.run.get('stock'))
    if word in (CLEANS_UP, DOES_NOT_CLEAN_UP) and stock:
        share = f'{_percent(stock.get("share"))} of the area that lacked metal stand at or above nominal'
        if not number(stock.get('below_mm')) > 0:
            return share
        return f'{share}; the lowest place is {fmt(stock.get("below_mm"), 2, "mm")} below it, {_at(stock)}'
    inside = number(run.get('share_in_tolerance'))
    if word not in (IN_TOLERANCE, OUT_OF_TOLERANCE) or not math.isfinite(inside):
        return ''
    wanted = number(mapping(job.asked.get('parameters')).get('share_in_tolerance'))
    least = f' (at least {100 * wanted:g} % are wanted)' if math.isfinite(wanted) else ''
    said = f'{_percent(inside)} of the judged surface lie within ±{job.tolerance_mm:g} mm{least}'
    rim = run.get('verdict_with_rim')
    if rim and rim != word and not run.get('error_code'):
        said += f'; with the rim {_percent(run.get("share_all_in_tolerance"))}: {rim}'
    return said


def _percent(share: object) -> str:
    """Never rounded up to all of it."""
    value = number(share)
    return '–' if not math.isfinite(value) else f'{math.floor(1000 * value + 1e-9) / 10:.1f} %'


def _at(place: dict) -> str:
    return f'at x = {fmt(place.get("x_mm"), 1)} mm, y = {fmt(place.get("y_mm"), 1)} mm'


def _pictures(job: Job) -> str:
    same = [s for s in job.scans if s.z.shape == job.scans[-1].z.shape]
    if len(same) < 2 or same[0].layer:
        return '<p>No picture of the part before and after: not both scans were stored.</p>'
    caption = 'As scanned, to scale. Orange: metal that was laid. Gaps: not seen by the scanner.'
    try:
        return picture(part_picture.before_and_after(same[0], same[-1], job.shaft), caption)
    except ValueError as e:
        return f'<p>No picture of the part: {escape(str(e))}.</p>'


def use_of(job: Job) -> Use:
    """What the job has used. Gas is by the plan's flow while the arc burnt: nothing measures it."""
    run, material = job.run, mapping(job.asked.get('material'))
    diameter, density = number(material.get('wire_diameter')), number(material.get('density'))
    return Use(
        wire_kg=number(run.get('wire_m')) * math.pi / 4 * diameter**2 * density,
        gas_l=number(run.get('arc_on_s')) * _gas_flow(job) * 1e3,
        arc_h=number(run.get('arc_on_s')) / 3600,
        energy_kwh=number(run.get('energy_J')) / JOULE_PER_KWH,
        machine_h=number(run.get('duration_s')) / 3600,
    )


def _gas_flow(job: Job) -> float:
    """m3/s as planned; NaN = not known."""
    try:
        return number(read_settings(job.folder / job_folder.plan()).get('gas_flow'))
    except PlanFileError:
        return math.nan


def _use(job: Job) -> str:
    run, use = job.run, use_of(job)
    flow = _gas_flow(job) * 60e3
    gas = (
        f'shielding gas, at the planned {flow:g} l/min' if math.isfinite(flow) else 'shielding gas'
    )
    wire = fmt(run.get('wire_m'), 2, 'm') + (
        f', {use.wire_kg:.3f} kg' if math.isfinite(use.wire_kg) else ''
    )
    shown = [
        (duration(run.get('duration_s')), f'time, of it arc on {duration(run.get("arc_on_s"))}'),
        (wire, 'wire'),
        (fmt(use.gas_l, 1, 'l'), gas),
        (fmt(use.energy_kwh, 3, 'kWh'), 'energy of the arc'),
    ]
    return '<h2>What it took</h2>' + cards(shown) + _money(job, use)


def _money(job: Job, use: Use) -> str:
    try:
        prices = find_prices(job.folder)
    except PriceError as e:
        return f'<p><b>No money is shown:</b> {escape(e)}</p>'
    goal = mapping(job.asked.get('goal'))
    material = str(job.report.get('material') or goal.get('material') or '')
    return f'<p class=soft>{escape(HOW)}</p>' if prices is None else _bill(prices, use, material)


def _bill(prices: Prices, use: Use, material: str) -> str:
    known, left_out = costs(prices, use, material)
    total = sum(money for _, money in known)
    unit = prices.currency
    shown = [
        (f'{money:.2f} {unit}', what)
        for what, money in [*known, *([('in all', total)] if known else [])]
    ]
    out = cards(shown)
    said = []
    if left_out:
        said.append(f'Not counted, for there is no price or no figure: {", ".join(left_out)}.')
    if prices.new_part is not None and known:
        saved = prices.new_part - total
        bound = ('at most ' if saved >= 0 else 'at least ') if left_out else ''
        word = f'{bound}{abs(saved):.2f} {unit} {"less" if saved >= 0 else "more"} than'
        said.append(f'That is {word} a new part at {prices.new_part:.2f} {prices.currency}.')
    return out + (f'<p>{escape(" ".join(said))}</p>' if said else '')


def _left(job: Job, places: list[Place]) -> str:
    """What is to be machined off, or what deviates most; and what of the needed area got no metal."""
    out = []
    stock, unlaid = mapping(job.run.get('stock')), mapping(job.run.get('unlaid'))
    if stock:
        facts = [
            (fmt(stock.get('mean_mm'), 2, 'mm'), 'to machine off, mean'),
            (fmt(stock.get('high_mm'), 2, 'mm'), 'at most, on 99 % of what was laid'),
            (fmt(stock.get('volume_cm3'), 1, 'cm³'), 'in all'),
        ]
        map_of_it = ''
        if is_machined(job):
            said = (
                'Metal above nominal. Black outline: below nominal. Dashed: area that lacked metal. Cell by cell in '
                f'{job_folder.STOCK_MAP}, the surface in {job_folder.AS_LAID}.'
            )
            map_of_it = picture(figures.stock_map(job.scans[-1]), said)
        out.append(f'<h2>Left to machine</h2><div class=beside>{map_of_it}{cards(facts)}</div>')
    elif places:
        worst = places[0]
        out.append(
            f'<h2>Worst place</h2><p>The surface deviates most at x = {worst.x_mm:.1f} mm, y = {worst.y_mm:.1f} mm: '
            f'{abs(worst.value_mm):.2f} mm too {"high" if worst.value_mm > 0 else "low"}. It is place 1 on the map of '
            'the second page.</p>'
        )
    if number(unlaid.get('area_mm2')) > 0:
        out.append(
            f'<p><b>No metal was laid</b> on {fmt(unlaid.get("area_mm2"), 2, "mm²")} '
            f'({fmt(100 * number(unlaid.get("share")), 2, "%")}) of the area that lacked it, too narrow or too shallow '
            f'for a bead: up to {fmt(unlaid.get("depth_mm"), 2, "mm")} deep {_at(unlaid)}.</p>'
        )
    return '\n'.join(out)


def _signature() -> str:
    lines = ''.join(
        f'<div class=sign>{what}</div>' for what in ('accepted by', 'signature', 'date')
    )
    return f'<div class=signs>{lines}</div>'
