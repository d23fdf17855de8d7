"""`waam notify`: messages to people."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from .cli_common import add_name, shop_and_cell, table
from .notifier import FILE, load, send
from .notify_settings import EXAMPLE
from .shop_folder import Places, Shop

DESCRIPTION = """\
The panel of a cell tells people of: done (a job has ended), paused, alarm, out_of_tolerance, low_wire. Addresses are
those of apprise (mail, chat, webhook) in notify.yaml of the shop, which only its owner may read. They are in no log,
report or message of this program.
"""


def register(commands: argparse._SubParsersAction, places: Places) -> None:
    """Adds the verb `notify`."""
    p = commands.add_parser(
        'notify', help='messages to people: test, list, init', description=DESCRIPTION
    )
    verbs = p.add_subparsers(dest='verb', metavar='VERB', required=True)
    q = verbs.add_parser('test', help='sends a test message to every target, or to one')
    q.add_argument('--target', default='', metavar='NAME')
    add_name(q)
    q.set_defaults(run_command=lambda args: _test(args, places))
    q = verbs.add_parser('list', help='targets and events, without addresses')
    q.set_defaults(run_command=lambda args: _list(places))
    q = verbs.add_parser('init', help='writes an example of notify.yaml')
    q.set_defaults(run_command=lambda args: _init(places))


def _test(args: argparse.Namespace, places: Places) -> int:
    shop, cell = shop_and_cell(args, places)
    targets = [t for t in load(shop.path).targets if args.target in ('', t.name)]
    if not targets:
        whom = f'target {args.target!r}' if args.target else 'target'
        raise ValueError(f'there is no {whom} in {shop.path / FILE} (waam notify init)')
    failed = 0
    for target in targets:
        good = send(
            target, f'{cell}: test', 'A test message: this is where messages of the cell arrive.'
        )
        failed += not good
        print(f'{target.name}: {"taken" if good else "NOT taken (address, network or password)"}')
    return 1 if failed else 0


def _list(places: Places) -> int:
    settings = load(Shop(places.shop()).path)
    table(('target', 'events'), ([t.name, ', '.join(t.events)] for t in settings.targets))
    limits = settings.limits
    print(f'at most {limits.per_hour} an hour, the same once in {limits.repeat_s:g} s')
    return 0


def _init(places: Places) -> int:
    file: Path = places.shop() / FILE
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise ValueError(f'{file} is there already') from None
    with open(descriptor, 'w', encoding='utf-8') as f:
        f.write(EXAMPLE)
    print(f'{file}: put your addresses in, then waam notify test')
    return 0
