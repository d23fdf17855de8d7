"""A plan as one HTML file: the path in 3-D to turn and step through, estimates per layer, warnings. No network."""

from __future__ import annotations

import html
import json
import math
from pathlib import Path

import numpy as np

from waam_plan.plan import Plan, PlannedLayer
from waam_plan.preview.picture import APART, LayerEstimate, estimates
from waam_plan.settings import PlanSettings
from waam_plan.shaft.lines import drawn

MAX_POINTS = 300_000  # drawn; longer programs are thinned out
HERE = Path(__file__).parent
COLUMNS = (
    ('layer', lambda e: f'{e.number}'),
    ('height mm', lambda e: f'{e.height_mean * 1e3:.2f}'),
    ('beads', lambda e: f'{e.beads}'),
    ('arc starts', lambda e: f'{e.arc_starts}'),
    ('bead m', lambda e: f'{e.length:.2f}'),
    ('arc s', lambda e: f'{e.arc_time:.0f}'),
    ('time s', lambda e: f'{e.duration:.0f}'),
    ('wire m', lambda e: f'{e.wire:.2f}'),
    ('gas l', lambda e: f'{e.gas * 1e3:.1f}'),
    ('energy kJ', lambda e: f'{e.heat / 1e3:.0f}'),
    ('heat input J/mm', lambda e: f'{e.heat_input / 1e3:.0f}'),
)


def write_page(plan: Plan, path: Path | str) -> None:
    """Writes the file; everything it needs is in it."""
    style = (HERE / 'page.css').read_text()
    script = (HERE / 'page.js').read_text()
    data = json.dumps(_data(plan), separators=(',', ':')).replace('</', '<\\/')
    title = html.escape(f'{plan.name}: {plan.mode}, {len(plan.layers)} layers')
    body = (
        f'<h1>{title}</h1>{_totals(plan)}{_warnings(plan)}'
        '<div id="view"><canvas id="path"></canvas>'
        '<div id="tools"><label>layers <input id="first" type="number" min="1" value="1"> to '
        '<input id="last" type="number" min="1"></label>'
        '<input id="slider" type="range" min="1"><label><input id="idle" type="checkbox" checked> idle moves</label>'
        '<label><input id="metal" type="checkbox"> colour by metal</label>'
        '<button id="top">top</button><button id="side">side</button><button id="iso">3-D</button></div>'
        '<p>Drag to turn, shift-drag to move, wheel to zoom. Green: arc on, red: arc off, dashed: idle.</p></div>'
        f'{_table(plan)}'
    )
    Path(path).write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{style}</style>'
        f'<body>{body}<script>const PLAN={data};\n{script}</script></body></html>\n'
    )


def _totals(plan: Plan) -> str:
    found = estimates(plan)
    s = plan.settings
    burning = sum(e.arc_time for e in found)
    rows = (
        (
            'time',
            f'{plan.duration / 60:.1f} min, {burning / 60:.1f} min of it with the arc on',
        ),
        ('wire', f'{plan.wire:.1f} m of {s.wire_diameter * 1e3:g} mm'),
        ('metal', f'{plan.volume * 1e6:.1f} cm3'),
        ('gas', f'{sum(e.gas for e in found) * 1e3:.0f} l'),
        ('energy of the arc', f'{sum(e.heat for e in found) / 1e6:.2f} MJ'),
        ('beads, arc starts', f'{plan.beads}, {plan.arc_starts}'),
        ('strategy', f'{s.strategy}, {s.alternation}'),
    )
    cells = ''.join(f'<tr><th>{html.escape(a)}<td>{html.escape(b)}' for a, b in rows)
    return f'<table class="totals">{cells}</table>' + ''.join(f'<p>{t}</p>' for t in _notes(plan))


def _notes(plan: Plan) -> list[str]:
    """Notes on where the figures come from."""
    s = plan.settings
    return [
        'Time without acceleration, cooling between layers and scans.',
        f'Gas: {s.gas_flow * 60e3:g} l/min (gas_flow) while the arc burns.',
        f'Energy and heat input are from a set power of {s.arc_power:g} W (arc_power), not from a model of the arc: '
        f'the current is known only when the job runs. Heat input: {s.arc_efficiency:g} (arc_efficiency) times power '
        'times arc time, over the length of the beads. A job reports its measured I U / V, without that factor.',
    ]


def _warnings(plan: Plan) -> str:
    if not plan.warnings:
        return '<p class="good">No warnings.</p>'
    items = ''.join(f'<li>{html.escape(text)}' for text in plan.warnings)
    return f'<ul class="warnings">{items}</ul>'


def _table(plan: Plan) -> str:
    head = ''.join(f'<th>{html.escape(name)}' for name, _ in COLUMNS)
    rows = ''.join(_row(e) for e in estimates(plan))
    return f'<table class="layers"><thead><tr>{head}</thead><tbody>{rows}</tbody></table>'


def _row(e: LayerEstimate) -> str:
    return '<tr>' + ''.join(f'<td>{html.escape(text(e))}' for _, text in COLUMNS)


def _data(plan: Plan) -> dict:
    """Lengths in hundredths of a millimetre."""
    total = sum(len(layer.segments) for layer in plan.layers)
    every = max(1, -(-total // MAX_POINTS))
    return {'layers': [_runs(layer, every, plan.settings) for layer in plan.layers]}


def _runs(layer: PlannedLayer, every: int, settings: PlanSettings) -> list:
    """[arc 0 or 1, [x, y, z, ...], [metal in % of the nominal layer, ...]] for every stretch of one kind."""
    runs: list[tuple[int, list, list]] = []
    for s in drawn(layer.segments, settings):
        if s.length <= 0:
            continue
        arc = int(s.arc)
        if not runs or runs[-1][0] != arc or math.dist(runs[-1][1][-1], s.start) > APART:
            runs.append((arc, [s.start], []))
        runs[-1][1].append(s.end)
        runs[-1][2].append(round(100 * s.height / settings.layer_height))
    return [_thinned(arc, points, metal, every) for arc, points, metal in runs]


def _thinned(arc: int, points: list, metal: list, every: int) -> list:
    keep = sorted({*range(0, len(points), every), len(points) - 1})
    at = (np.array(points)[keep] * 1e5).round().astype(int)
    return [arc, at.ravel().tolist(), [metal[min(k, len(metal) - 1)] for k in keep[:-1]]]
