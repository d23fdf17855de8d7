"""Commands of the command line go into the audit log of the cell before they are carried out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

# verb -> sub-verbs that change something, () = all of them
COMMANDS: dict[str, tuple[str, ...]] = {
    'up': (), 'stop': (), 'demo': (), 'job': (), 'calibrate': (), 'jobs': ('delete', 'retain'),
    'queue': ('add', 'move', 'remove', 'release', 'hold'), 'token': ('create', 'revoke'), 'notify': ('test',),
}  # fmt: skip
SAFE = (
    ('stop', ''),
    ('job', 'abort'),
    ('job', 'pause'),
)  # carried out whether the log can be written or not
LEFT_OUT = ('command', 'verb', 'jobs_verb', 'run_command', 'foreground', 'cell', 'code')


def record(args: argparse.Namespace) -> None:
    """One entry; ValueError when it cannot be written, but for what makes the cell safe."""
    verb = str(getattr(args, 'verb', '') or getattr(args, 'jobs_verb', '') or '')
    wanted = COMMANDS.get(args.command)
    if wanted is None or (wanted and verb not in wanted) or getattr(args, 'foreground', False):
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


def _values(args: argparse.Namespace) -> dict[str, Any]:
    """What was given, without defaults that say nothing; whose token it is is no secret."""
    given = {
        k: v for k, v in vars(args).items() if k not in LEFT_OUT and v not in (None, '', [], False)
    }
    plain = {k: v for k, v in given.items() if not callable(v)}
    return {k.removeprefix('form_'): v.name if isinstance(v, Path) else v for k, v in plain.items()}
