"""`waam token`: who may come in. `waam audit`: what was commanded."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict
from typing import Any

from .audit import Entry
from .cli_common import add_json, add_name, shop_and_cell, show, table, when
from .roles import ROLES, role_of
from .shop_folder import Places, Shop

EPILOG = """\
  waam token create "tablet at cell 2" --role operate --days 90
  waam token list
  waam token revoke "tablet at cell 2"

Roles: view looks; operate also moves, starts, stops and steers the queue; maintain also reads the audit log and sends
test messages. A token is shown once; only its hash is kept. It is good for all cells of the shop and is out within a
second when it is revoked.
"""


def register(commands: argparse._SubParsersAction, places: Places) -> None:
    """Adds the verbs `token` and `audit`."""
    p = commands.add_parser(
        'token',
        help='tokens with roles for the panels: create, list, revoke',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = p.add_subparsers(dest='verb', metavar='VERB', required=True)
    q = verbs.add_parser('create', help='a new token, shown this once')
    q.add_argument('who', help='whose it is, or what device')
    q.add_argument('--role', choices=ROLES, required=True)
    q.add_argument('--days', type=float, default=0.0, help='until it runs out (default 0: never)')
    add_json(q)
    q.set_defaults(run_command=lambda args: _create(args, places))
    q = verbs.add_parser('list', help='all tokens, without their secrets')
    add_json(q)
    q.set_defaults(run_command=lambda args: _list(args, places))
    q = verbs.add_parser('revoke', help='out within a second, open pages too')
    q.add_argument('who', help='name or id')
    add_json(q)
    q.set_defaults(run_command=lambda args: _revoke(args, places))
    _register_audit(commands, places)


def _register_audit(commands: argparse._SubParsersAction, places: Places) -> None:
    p = commands.add_parser(
        'audit',
        help='every command that was given to a cell, and by whom',
        description='Shows the newest entries, or verifies the whole chain of hashes. Keep the hash that --verify '
        'prints somewhere else: with --expect it shows that nothing before it was rewritten.',
    )
    p.add_argument(
        '--verify',
        action='store_true',
        help='exit status 1 when an entry was changed or is missing',
    )
    p.add_argument(
        '--expect', default='', metavar='HASH', help='a hash that an earlier --verify has printed'
    )
    p.add_argument('--last', type=int, default=40, metavar='N', help='entries shown (default 40)')
    add_json(p)
    add_name(p)
    p.set_defaults(run_command=lambda args: _audit(args, places))


def _create(args: argparse.Namespace, places: Places) -> int:
    if not 0 <= args.days <= 36500:
        raise ValueError(f'--days {args.days:g}, must be 0 to 36500')
    token = Shop(places.shop()).tokens().create(args.who, role_of(args.role), args.days)
    if args.json:
        show({'token': token, 'name': args.who, 'role': args.role, 'days': args.days})
    else:
        print(f'{token}\nThis is shown once. It may {args.role}.')
    return 0


def _list(args: argparse.Namespace, places: Places) -> int:
    now, tokens = time.time(), Shop(places.shop()).tokens().book().tokens
    if args.json:
        show([{k: v for k, v in asdict(t).items() if k != 'sha256'} for t in tokens])
    elif not tokens:
        print('there are no tokens (waam token create)')
    else:
        rows = [[t.id, t.name, t.role, when(t.created), _until(t.expires, now)] for t in tokens]
        table(('id', 'whose', 'role', 'created', 'until'), rows)
    return 0


def _until(expires: float, now: float) -> str:
    return 'ever' if not expires else when(expires) if now < expires else 'has run out'


def _revoke(args: argparse.Namespace, places: Places) -> int:
    token = Shop(places.shop()).tokens().revoke(args.who)
    if args.json:
        show({'revoked': token.name, 'id': token.id, 'role': token.role})
    else:
        print(f'revoked: {token.name} ({token.role})')
    return 0


def _audit(args: argparse.Namespace, places: Places) -> int:
    shop, cell = shop_and_cell(args, places)
    log = shop.audit(cell)
    if args.verify or args.expect:
        return _verify(log.verify(args.expect), args.json)
    entries = log.last(max(1, args.last))
    if args.json:
        show([asdict(e) for e in entries])
    else:
        heads = ('n', 'when', 'who', 'role', 'via', 'command', 'outcome', 'values')
        table(heads, (_line(e) for e in entries))
    return 0


def _line(e: Entry) -> list[Any]:
    values = ', '.join(f'{k}={v}' for k, v in e.data.items() if v not in (None, ''))
    told = '; '.join(x for x in (values, e.note) if x)
    return [e.n, when(e.utc), e.who, e.role, e.via, e.what, e.outcome, told[:100]]


def _verify(found: Any, as_json: bool) -> int:
    if as_json:
        show(asdict(found) | {'good': found.good})
        return 0 if found.good else 1
    for problem in found.problems[:20]:
        print(f'! {problem}')
    torn = f', {found.torn} lines torn by a power cut or a kill' if found.torn else ''
    print(f'{found.entries} entries{torn}: {"unbroken" if found.good else "BROKEN"}')
    print(f'last hash: {found.last}')
    return 0 if found.good else 1
