"""The work of `waam lab --account`: one job, and where the metal of one of its layers came from."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from waam_job.store.folder import make_job_id
from waam_node.files import write_atomically

from . import pictures
from .advance import outcome
from .cli_campaign import job_of, parse_seeds
from .laboratory import over_seeds, run
from .metal_account import PARTS, Row, account, table
from .metal_trace import LayerTrace, MetalTrace
from .path_places import places

RADIUS = 0.5  # bead widths: of the windows round the places


def run_account(args: argparse.Namespace) -> int:
    """0 told, 1 the job failed. ValueError: there is no such layer."""
    out = args.out or Path(os.environ.get('WAAM_JOBS', 'jobs')) / make_job_id(
        f'account-{args.part.stem}'
    )
    job = over_seeds(job_of(args, out)[0], parse_seeds(args.seeds)[:1])[0]
    trace = MetalTrace()
    result = run(job, trace)
    console = Console(highlight=False)
    if result.failed:
        console.print(f'[red]seed {result.seed} failed:[/] {result.message}')
        return 1
    number, layer = _chosen(trace, args.account)
    found = account(layer)
    radius = RADIUS * layer.bead_width
    rows = table(found, places(layer.segments, layer.bead_width), radius)
    whole = found.within(found.wanted == found.wanted)
    told = {
        'part': job.goal.file.name,
        'seed': job.seed,
        'layer': number,
        'window_radius_mm': radius * 1e3,
        'parts': PARTS,
        'places': {r.kind: {'count': r.count, 'mm3': _mm3(r.metal)} for r in rows},
        'whole_mm3': _mm3(whole),
    }
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / 'account.json', json.dumps(told, indent=1))
    (out / 'account.png').write_bytes(pictures.account_maps(found, layer))
    title = f'{job.goal.file.name}, seed {job.seed}, layer {number}: mm3 in a circle of {radius * 1e3:.1f} mm'
    show(rows, title, console)
    console.print(f'{outcome(result)}; picture: {os.path.relpath(out / "account.png")}')
    return 0


def _chosen(trace: MetalTrace, asked: int) -> tuple[int, LayerTrace]:
    """The layer asked for, 0 = the last one. ValueError when it was not laid."""
    laid = sorted(n for n, layer in trace.layers.items() if layer.rows)
    if not laid:
        raise ValueError('--account: no layer was laid')
    number = asked or laid[-1]
    if number not in laid:
        raise ValueError(f'--account {asked}: the job laid layers {laid[0]} to {laid[-1]}')
    return number, trace.layers[number]


def _mm3(metal: dict[str, float]) -> dict[str, Any]:
    return {name: round(volume * 1e9, 4) for name, volume in metal.items()}


def show(rows: list[Row], title: str, console: Console) -> None:
    """One column per kind of place."""
    shown = Table(title=title)
    shown.add_column('')
    for r in rows:
        shown.add_column(f'{r.kind} ({r.count})' if r.count else r.kind, justify='right')
    for name, what in {'wanted': 'wanted', **PARTS, 'grown': 'grown'}.items():
        cells = (
            f'{r.metal[name] * 1e9:{"" if name in ("wanted", "grown") else "+"}.2f}' for r in rows
        )
        shown.add_row(what, *cells, end_section=name in ('wanted', 'flow'))
    console.print(shown)
