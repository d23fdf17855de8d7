"""`waam queue`: the jobs that wait for a cell."""

from __future__ import annotations

import argparse
import hashlib
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from waam_process.cli_options import Options, Verbs, add_options, add_verb, as_table

from .cells import FIRST
from .cli_common import JSON, NAME, shop_and_cell, show, user, when
from .job_queue import WAITING, Item, Queue
from .shop_folder import Places

EPILOG = """\
examples:
  waam queue add jaw_nominal.stl --as-found jaw_worn.stl --material er70s-6
  waam queue add bracket.stl --mode build --layers 3 --name cell2
  waam queue add pad.gcode --dialect slicer --nominal pad.stl --loop-mode closed_loop
  waam queue list
  waam queue move 4 1          number 4 is the next one
  waam queue release 4         its part lies on the table: it starts as soon as the cell is ready
  waam queue hold 4            takes the release back, as long as it has not started

Every verb prints JSON with --json.

Nothing starts by itself. A release is worth one start and belongs to the part that lies on the table now; it is
withdrawn when the panel starts again or another job is started. The panel of the cell starts the jobs.
"""


def shift(text: str) -> list[float]:
    """'1,2.5,0'. ValueError."""
    return [float(v) for v in text.split(',')]


FORM: Options = (  # `dest` is the field of the setup, after form_
    ('--as-found', str, 'simulated cell: mesh of the worn part that will lie on the table', 'FILE'),
    ('--mode', str, 'restore (default) or build'), ('--material', str, 'key of the material table'),
    ('--loop-mode', str, 'open_loop, monitor or closed_loop (default)'),
    ('--layers', int, 'at most so many; 0 = as many as needed'),
    ('--layer-height', float, 'mm', 'MM', {'dest': 'form_layer_height_mm'}),
    ('--bead-width', float, 'mm', 'MM', {'dest': 'form_bead_width_mm'}),
    ('--tolerance', float, 'mm', 'MM', {'dest': 'form_tolerance_mm'}),
    ('--k-gain', float, 'authority of the correction'), ('--passes', int, 'restore only'),
    ('--finish', str, 'as-laid (default) or machined; restore only'),
    ('--allowance', float, 'mm, restore only', 'MM', {'dest': 'form_allowance_mm'}),
    ('--operator', str, 'who answers for the job', 'NAME', {'dest': 'form_operator_name'}),
    ('--wire-lot', str, 'from the spool'), ('--gas', str, 'kind, bottle'),
    ('--job-name', str, 'short name in the folder of the job', 'NAME', {'dest': 'form_name'}),
    ('--dialect', str, 'program: what its codes mean (waam plan --help)'),
    ('--nominal', str, 'program: mesh of the part that it makes; closed_loop needs it', 'FILE'),
    ('--shift', str, 'program: X,Y,Z in mm that it is moved by', 'X,Y,Z', {'dest': 'form_shift_mm', 'type': shift}),
)  # fmt: skip


def register(commands: Verbs, places: Places) -> None:
    """Adds the verb `queue` with its sub-verbs."""
    text = 'jobs that wait for a cell: add, list, move, remove, release, hold'
    p = add_verb(commands, 'queue', text, description=None, epilog=EPILOG)
    verbs = p.add_subparsers(dest='verb', metavar='VERB', required=True)
    text = 'mesh of the part, or a program (G-code); stored beside the uploads of the panel'
    q = add_verb(verbs, 'add', 'a job at the end of the queue', ('part', Path, text), NAME, JSON)
    for names, kind, told, *more in FORM:
        further = more.pop() if more and isinstance(more[-1], dict) else {}
        field = {'dest': f'form_{names[2:].replace("-", "_")}'} | further
        add_options(q, (names, kind, told, *(more or [names[2:].upper()]), field))
    q.set_defaults(run_command=lambda args: _add(args, places))
    q = add_verb(verbs, 'list', 'what waits, runs and has ended', NAME, JSON)
    q.set_defaults(run_command=lambda args: _list(args, places))
    for verb, text in (
        ('remove', 'takes an item out'),
        ('release', 'its part lies on the table: it may start, once'),
        ('hold', 'takes a release back'),
        ('move', 'to another place among those that wait'),
    ):
        q = add_verb(verbs, verb, text, ('id', int, 'number of the item'), NAME, JSON)
        if verb == 'move':
            add_options(q, ('place', int, '1 = the next one'))
        q.set_defaults(run_command=lambda args: _steer(args, places))


def _add(args: argparse.Namespace, places: Places) -> int:
    shop, cell = shop_and_cell(args, places)
    given = {k.removeprefix('form_'): v for k, v in vars(args).items() if k.startswith('form_')}
    setup = {k: v for k, v in given.items() if v is not None}
    kind = 'program' if places.is_program(args.part) else 'part'
    for other in ('as_found', 'nominal'):
        if other in setup:
            file = Path(setup[other])
            places.check(setup | {kind: args.part.name, other: file.name})
            setup[other] = places.store(cell, file)
    content = args.part.read_bytes()
    checked = places.check(setup | {kind: places.store(cell, args.part)})
    digest = hashlib.sha256(content).hexdigest()
    queue = shop.queue(cell).change(lambda q: q.add(checked, f'cli:{user()}', time.time(), digest))
    if args.json:
        show(_told(cell, 'add', queue, queue.last))
        return 0
    which = '' if cell == FIRST else f' --name {cell}'
    print(
        f'item {queue.last}: {checked[kind]} waits for {cell}; waam queue release {queue.last}{which}'
    )
    return 0


def _steer(args: argparse.Namespace, places: Places) -> int:
    shop, cell = shop_and_cell(args, places)

    def change(queue: Queue) -> Queue:
        if args.verb == 'move':
            return queue.move(args.id, args.place)
        if args.verb == 'release':
            return queue.release(args.id, f'cli:{user()}')
        return queue.remove(args.id) if args.verb == 'remove' else queue.hold(args.id)

    queue = shop.queue(cell).change(change)
    status = shop.status(cell)
    up = status is not None and status.state(time.time()) == 'up'
    if args.json:
        show({**_told(cell, args.verb, queue, args.id), 'panel_up': up})
        return 0
    print(f'{args.verb}: item {args.id} of {cell}')
    if args.verb == 'release' and not up:
        print('the panel of the cell does not answer; a release is withdrawn when it starts')
    return 0


def _told(cell: str, verb: str, queue: Queue, number: int) -> dict[str, Any]:
    """For scripts: what was done to which item, and the item as it is now; null once it was taken out."""
    item = next((i for i in queue.items if i.id == number), None)
    return {'cell': cell, 'verb': verb, 'id': number, 'item': asdict(item) if item else None}


def _list(args: argparse.Namespace, places: Places) -> int:
    shop, cell = shop_and_cell(args, places)
    items = shop.queue(cell).read().items
    if args.json:
        show([asdict(i) for i in items])
        return 0
    if not items:
        print(f'the queue of {cell} is empty')
        return 0
    heads = ('id', 'state', 'place', 'part', 'material', 'added', 'by', 'note')
    waiting = [i.id for i in items if i.state == WAITING]
    print(as_table(heads, (_line(i, waiting) for i in items)))
    return 0


def _line(item: Item, waiting: list[int]) -> list[Any]:
    place = waiting.index(item.id) + 1 if item.id in waiting else ''
    by = f'{item.by}, released by {item.released_by}' if item.released_by else item.by
    note = item.note or item.job
    return [
        item.id, item.state, place, item.part, item.setup.get('material', ''), when(item.added), by, note,
    ]  # fmt: skip
