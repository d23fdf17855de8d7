"""`waam token`: who may come in. `waam audit`: what was commanded."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict
from typing import Any

from waam_process.cli_options import Verbs, add_verb, as_table

from .audit import Entry
from .cli_common import JSON, NAME, shop_and_cell, show, when
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


AUDIT = """\
Shows the newest entries, or verifies the whole chain of hashes. Keep the hash that --verify prints somewhere else: with
--expect it shows that nothing before it was rewritten."""


def register(commands: Verbs, places: Places) -> None:
    """Adds the verbs `token` and `audit`."""
    text = 'tokens with roles for the panels: create, list, revoke'
    p = add_verb(commands, 'token', text, description=None, epilog=EPILOG)
    verbs = p.add_subparsers(dest='verb', metavar='VERB', required=True)
    q = add_verb(
        verbs, 'create', 'a new token, shown this once', ('who', str, 'whose it is, or what device'),
        ('--role', str, 'what it may', None, {'choices': ROLES, 'required': True}),
        ('--days', 0.0, 'until it runs out (default 0: never)'), JSON,
    )  # fmt: skip
    q.set_defaults(run_command=lambda args: _create(args, places))
    q = add_verb(verbs, 'list', 'all tokens, without their secrets', JSON)
    q.set_defaults(run_command=lambda args: _list(args, places))
    q = add_verb(
        verbs, 'revoke', 'out within a second, open pages too', ('who', str, 'name or id'), JSON
    )
    q.set_defaults(run_command=lambda args: _revoke(args, places))
    q = add_verb(
        commands, 'audit', 'every command that was given to a cell, and by whom',
        ('--verify', False, 'exit status 1 when an entry was changed or is missing'),
        ('--expect', '', 'a hash that an earlier --verify has printed', 'HASH'),
        ('--last', 40, 'entries shown (default 40)', 'N'), JSON, NAME, description=AUDIT,
    )  # fmt: skip
    q.set_defaults(run_command=lambda args: _audit(args, places))


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
        print(as_table(('id', 'whose', 'role', 'created', 'until'), rows))
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
        print(as_table(heads, (_line(e) for e in entries)))
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
