"""`waam notify`: messages to people."""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

from waam_process.cli_options import Verbs, add_verb, as_table

from .cli_common import JSON, NAME, shop_and_cell, show
from .notifier import FILE, load, send
from .notify_settings import EXAMPLE
from .shop_folder import Places, Shop

DESCRIPTION = """\
The panel of a cell tells people of: done (a job has ended), paused, alarm, out_of_tolerance, low_wire. Addresses are
those of apprise (mail, chat, webhook) in notify.yaml of the shop, which only its owner may read. They are in no log,
report or message of this program.
"""


def register(commands: Verbs, places: Places) -> None:
    """Adds the verb `notify`."""
    text = 'messages to people: test, list, init'
    p = add_verb(commands, 'notify', text, description=DESCRIPTION)
    verbs = p.add_subparsers(dest='verb', metavar='VERB', required=True)
    text = 'sends a test message to every target, or to one'
    q = add_verb(verbs, 'test', text, ('--target', '', 'only this one', 'NAME'), NAME, JSON)
    q.set_defaults(run_command=lambda args: _test(args, places))
    q = add_verb(verbs, 'list', 'targets and events, without addresses', JSON)
    q.set_defaults(run_command=lambda args: _list(args, places))
    q = add_verb(verbs, 'init', 'writes an example of notify.yaml', JSON)
    q.set_defaults(run_command=lambda args: _init(args, places))


def _test(args: argparse.Namespace, places: Places) -> int:
    shop, cell = shop_and_cell(args, places)
    targets = [t for t in load(shop.path).targets if args.target in ('', t.name)]
    if not targets:
        whom = f'target {args.target!r}' if args.target else 'target'
        raise ValueError(f'there is no {whom} in {shop.path / FILE} (waam notify init)')
    text = 'A test message: this is where messages of the cell arrive.'
    taken: dict[str, bool] = {}
    for target in targets:
        taken[target.name] = good = send(target, f'{cell}: test', text)
        if not args.json:
            print(
                f'{target.name}: {"taken" if good else "NOT taken (address, network or password)"}'
            )
    if args.json:
        show(taken)
    return 0 if all(taken.values()) else 1


def _list(args: argparse.Namespace, places: Places) -> int:
    settings = load(Shop(places.shop()).path)
    limits = settings.limits
    if args.json:
        targets = [{'name': t.name, 'events': t.events} for t in settings.targets]
        show({'targets': targets, **asdict(limits), 'wire_m': settings.wire_m})
        return 0
    if not settings.targets:
        print(f'there are no targets in {places.shop() / FILE} (waam notify init)')
        return 0
    print(as_table(('target', 'events'), ([t.name, ', '.join(t.events)] for t in settings.targets)))
    print(f'at most {limits.per_hour} an hour, the same once in {limits.repeat_s:g} s')
    return 0


def _init(args: argparse.Namespace, places: Places) -> int:
    file: Path = places.shop() / FILE
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise ValueError(f'{file} is there already') from None
    with open(descriptor, 'w', encoding='utf-8') as f:
        f.write(EXAMPLE)
    if args.json:
        show({'file': str(file)})
    else:
        print(f'{file}: put your addresses in, then waam notify test')
    return 0
