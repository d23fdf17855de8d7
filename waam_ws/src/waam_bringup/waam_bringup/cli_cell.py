"""`waam cell`: the one file of a cell: make it, look for mistakes, show what counts, compare two."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_process.cell_keys import PORT
from waam_process.cli_options import Verbs, add_verb

from .paths import CELL, cell_name

if TYPE_CHECKING:  # parameters of the nodes are loaded only when a verb runs
    from waam_process.cell_file import CellFile

TEXT = """\
cells/NAME.yaml (another folder: $WAAM_CELLS) holds every number of a cell: axes, link, limits, wire, work zero,
sensors. waam up, plan, lab and job read it with --cell NAME; without, it is cells/cell.yaml, where there is one."""
EXAMPLES = """\
examples:
  waam cell new gantry1             a commented file, then edit it
  waam cell check gantry1           file, line, key, limit and reason of every mistake; exit status 2
  waam cell show gantry1            every value that counts, and where it comes from
  waam cell diff gantry1 gantry2    what differs; exit status 1 then
  waam up --cell gantry1            the machine, or waam up --cell gantry1 --simulated"""
NAME: tuple[Any, ...] = (
    'name',
    str,
    'of the cell (default: the one that is meant, cell)',
    None,
    {'nargs': '?'},
)


def register(commands: Verbs) -> None:
    """Adds the verb."""
    p = add_verb(
        commands,
        'cell',
        'the one file of a cell: new, check, show, diff',
        description=TEXT,
        epilog=EXAMPLES,
    )
    verbs = p.add_subparsers(dest='cell_verb', metavar='VERB', required=True)
    ros = ('--ros', False, 'as the ROS parameter file that waam up makes of it')
    for name, run, text, rows in (
        ('new', _new, 'write a commented file; one that is there stays', (NAME,)),
        ('check', _check, 'look for mistakes', (NAME,)),
        ('show', _show, 'every value that counts, where it comes from, and the calibrations', (NAME, ros)),
        ('diff', _diff, 'what differs between two cells (names or files)',
         (('a', str, 'name of a cell, or a file'), ('b', str, 'the other one'))),
    ):  # fmt: skip
        add_verb(verbs, name, text, *rows).set_defaults(run_command=run)


def _path(name: str | None) -> Path:
    """Of the file. ValueError for a name that is none. The folders are those of this cell from here on."""
    from waam_shop.cells import check_name

    from .cell_check import path_of

    os.environ[CELL] = check_name(name or cell_name())
    return path_of(cell_name())


def _load(path: Path) -> CellFile:
    from waam_process.safe_files import Missing

    from .cell_check import load, shown

    try:
        return load(path)
    except Missing:
        raise ValueError(f'{shown(path)}: no such file (waam cell new {path.stem})') from None


def _new(args: argparse.Namespace) -> int:
    from waam_process.cell_file import new

    from .cell_check import shown

    path = _path(args.name)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with open(path, 'x', encoding='utf-8') as file:
            file.write(new(path.stem))
    except FileExistsError:
        raise ValueError(f'{shown(path)} is there already') from None
    print(f'{shown(path)}: measure the machine, edit it, then waam cell check {path.stem}')
    return 0


def _check(args: argparse.Namespace) -> int:
    from .cell_check import certificates, stale

    cell = _load(_path(args.name))
    kept, damaged = certificates()
    wrong = [*stale(cell, kept), *damaged]
    if wrong:
        raise ValueError('\n'.join(wrong))
    print(
        f'{cell.name}: nothing is wrong; {len(cell.values)} values, machine {cell.machine_sha256[:12]}'
    )
    return 0


def _show(args: argparse.Namespace) -> int:
    from .cell_check import certificates, effective, stale
    from .cell_graph import parameter_text

    cell = _load(_path(args.name))
    if args.ros:
        print(parameter_text(cell, PORT not in cell.values), end='')
        return 0
    kept, damaged = certificates()
    rows = effective(cell, kept)
    wide = [max(len(row[k]) for row in rows) for k in (0, 1)]
    for path, value, origin in rows:
        print(f'{path:{wide[0]}}  {value:{wide[1]}}  {origin}')
    print(f'\ncalibrations of this cell ({"none" if not kept else len(kept)}):')
    for name, result in sorted(kept.items()):
        print(f'  {name:12} {result.when:%Y-%m-%d %H:%M}  {result.text}')
    for text in (*damaged, *stale(cell, kept)):
        print(f'  {text}')
    print(
        f'file {cell.sha256[:12]}, machine {cell.machine_sha256[:12]} (what the controller is told)'
    )
    return 0


def _diff(args: argparse.Namespace) -> int:
    from waam_process.cell_file import differing

    from .cell_check import path_of

    a, b = (_load(Path(n) if Path(n).suffix or '/' in n else path_of(n)) for n in (args.a, args.b))
    rows = differing(a, b)
    for path, left, right in rows:
        print(f'{path}: {_value(left)} -> {_value(right)}')
    if not rows:
        print('nothing differs')
    return 1 if rows else 0


def _value(value: Any) -> str:
    return 'not given' if value is None else str(value)
