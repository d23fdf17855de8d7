"""Commands of the command line go into the audit log of the cell before they are carried out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from . import panel

# verb -> sub-verbs that command a cell or change what belongs to the shop, () = all of them
COMMANDS: dict[str, tuple[str, ...]] = {
    'up': (), 'stop': (), 'demo': (), 'job': (), 'calibrate': (), 'jobs': ('delete', 'retain', 'policy'),
    'panel': (), 'relay': (),
    'queue': ('add', 'move', 'remove', 'release', 'hold'), 'token': ('create', 'revoke'), 'notify': ('test', 'init'),
    'record': ('start', 'stop', 'split', 'pause', 'resume'), 'replay': ('play',),
}  # fmt: skip
# of verb: where the parser of a package puts its sub-verb
SUB_VERBS = ('verb', 'jobs_verb', 'record_verb', 'replay_verb', 'calibrate_command')
QUESTIONS = (
    ('calibrate', 'status'),
)  # sub-verbs that only look, of verbs of which all others command
SAFE = (
    ('stop', ''),
    ('job', 'abort'),
    ('job', 'pause'),
)  # carried out whether the log can be written or not
LEFT_OUT = ('command', *SUB_VERBS, 'run_command', 'foreground', 'cell', 'code')


def record(args: argparse.Namespace) -> None:
    """One entry; ValueError when it cannot be written, but for what makes the cell safe."""
    verb = sub_verb(args)
    if not is_command(args.command, verb) or getattr(args, 'foreground', False) or _only_asks(args):
        return
    from waam_shop.cli_common import user
    from waam_shop.shop_folder import Shop

    from .paths import cell_name, shop_dir

    try:
        log = Shop(shop_dir()).audit(getattr(args, 'cell', None) or cell_name())
        log.write(f'{args.command} {verb}'.strip(), f'cli:{user()}', 'cli', data=_values(args))
    except OSError as e:
        text = f'the audit log in {shop_dir()} cannot be written ({e.strerror})'
        if (args.command, verb) not in SAFE:
            raise ValueError(text) from None
        print(f'waam: {text}; going on', file=sys.stderr)


def sub_verb(args: argparse.Namespace) -> str:
    """The second word of a command, '' without one."""
    return next((str(v) for name in SUB_VERBS if (v := getattr(args, name, None))), '')


def is_command(command: str, verb: str) -> bool:
    """Whether such a command goes into the log."""
    wanted = COMMANDS.get(command)
    if wanted is None or (command, verb) in QUESTIONS:
        return False
    return not wanted or verb in wanted


def _only_asks(args: argparse.Namespace) -> bool:
    """`waam panel` without options tells the address of the page and opens nothing to anybody; `waam jobs policy`
    without options shows the policy."""
    if (args.command, sub_verb(args)) == ('jobs', 'policy'):
        return not (args.older_than or args.max_size or args.clear)
    return args.command == 'panel' and not panel.serves(args)


def _values(args: argparse.Namespace) -> dict[str, Any]:
    """What was given, without defaults that say nothing; whose token it is is no secret."""
    given = {
        k: v for k, v in vars(args).items() if k not in LEFT_OUT and v not in (None, '', [], False)
    }
    plain = {k: v for k, v in given.items() if not callable(v)}
    return {k.removeprefix('form_'): v.name if isinstance(v, Path) else v for k, v in plain.items()}
