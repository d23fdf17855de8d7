"""`waam cells`: all cells of the shop at a glance."""

from __future__ import annotations

import argparse
import time
from typing import Any

from waam_process.cli_options import Verbs, add_verb, as_table

from .cli_common import JSON, show
from .shop_folder import Places, Shop

TEXT = """\
Reads what the panel of each cell tells once a second. Start a second cell beside the first one with
waam up --name cell2. Exit status: 0; 1 when a cell is silent."""


def register(commands: Verbs, places: Places) -> None:
    """Adds the verb `cells`."""
    p = add_verb(
        commands, 'cells', 'all cells of the shop and what they do', JSON, description=TEXT
    )
    p.set_defaults(run_command=lambda args: _cells(args, places))


def _cells(args: argparse.Namespace, places: Places) -> int:
    now = time.time()
    rows = [s.row(now) for s in Shop(places.shop()).cells()]
    if args.json:
        show(rows)
    elif not rows:
        print('no cell has been started yet (waam up, waam up --name cell2)')
    else:
        heads = ('cell', 'state', 'machine', 'job', 'left', 'queue', 'alarm', 'domain', 'page')
        print(as_table(heads, (_line(row) for row in rows)))
    return 1 if any(row['state'] == 'silent' for row in rows) else 0


def _line(row: dict[str, Any]) -> list[str]:
    state = f'silent for {row["age"]:.0f} s' if row['state'] == 'silent' else row['state']
    if row['state'] != 'up':
        return [row['name'], state, '', '', '', _queue(row), '', str(row['domain']), '']
    machine = row['machine'] if row['connected'] else 'not connected'
    job = row['job_state'] or '?'
    if job == 'UNKNOWN':
        job = f'{row["job"]} {row["job_message"]}'
    if row['layers'] and row['progress'] < 1:
        job += f' {row["layer"]}/{row["layers"]}'
    left = '' if row['time_left'] is None else f'{row["time_left"] / 60:.0f} min'
    return [
        row['name'], state, machine, job, left, _queue(row), row['alarm'][:40], str(row['domain']), row['page'],
    ]  # fmt: skip


def _queue(row: dict[str, Any]) -> str:
    return ', '.join(f'{n} {state}' for state, n in row['queue'].items() if n) or 'empty'
