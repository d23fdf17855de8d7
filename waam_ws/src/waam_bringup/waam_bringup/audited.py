"""Commands of the command line go into the audit log of the cell before they are carried out; those that make the cell
safe are carried out first."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import panel

# verb -> sub-verbs that command a cell or change what belongs to the shop, () = all of them
COMMANDS: dict[str, tuple[str, ...]] = {
    'up': (), 'stop': (), 'demo': (), 'job': (), 'calibrate': (), 'commission': (),
    'jobs': ('delete',), 'panel': (),
    'queue': ('add', 'move', 'remove', 'release', 'hold'), 'token': ('create', 'revoke'), 'notify': ('test', 'init'),
    'record': ('start', 'stop', 'split', 'pause', 'resume'), 'replay': ('play',),
}  # fmt: skip
# of verb: where the parser of a package puts its sub-verb
SUB_VERBS = ('verb', 'jobs_verb', 'record_verb', 'replay_verb', 'calibrate_command')
QUESTIONS = (
    ('calibrate', 'status'),
    ('job', 'status'),
)  # sub-verbs that only look, of verbs of which all others command
SAFE = (
    ('stop', ''),
    ('job', 'abort'),
    ('job', 'pause'),
)  # carried out first, whether the log can be written or not
PATIENCE_S = 3.0  # that such a command waits for its entry, at its end
LEFT_OUT = ('command', *SUB_VERBS, 'run_command', 'foreground', 'cell', 'code')


def carry_out(args: argparse.Namespace) -> int:
    """Runs a command, with its entry; its exit status. ValueError when an entry cannot be written that must come
    first: then nothing has been done."""
    run: Callable[[argparse.Namespace], int] = args.run_command
    if (args.command, sub_verb(args)) not in SAFE:
        record(args)
        return run(args)
    outcome, note = 'refused', ''
    try:
        status = run(args)
        outcome = 'refused' if status else 'ok'
        return status
    except Exception as e:
        note = str(e)
        raise
    finally:
        _record_soon(args, outcome, note)


def _record_soon(args: argparse.Namespace, outcome: str, note: str) -> None:
    """The entry of what has been done. It holds nobody up for longer than a moment; one that is missing is told."""
    said = ['the disk does not answer']

    def write() -> None:
        try:
            record(args, outcome, note, PATIENCE_S - 1.0)
            said.clear()
        except Exception as e:
            said[:] = [str(e)]

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    if said:
        print(f'waam: this is not in the audit log: {said[0]}', file=sys.stderr)


def record(
    args: argparse.Namespace, outcome: str = 'asked', note: str = '', patience: float = PATIENCE_S
) -> None:
    """One entry; ValueError when it cannot be written. patience: s that its lock is waited for."""
    verb = sub_verb(args)
    if not is_command(args.command, verb) or getattr(args, 'foreground', False) or _only_asks(args):
        return
    from waam_shop.cli_common import user
    from waam_shop.shop_folder import Shop

    from .paths import cell_name, shop_dir

    what, who = f'{args.command} {verb}'.strip(), f'cli:{user()}'
    try:
        log = Shop(shop_dir()).audit(getattr(args, 'cell', None) or cell_name())
        log.write(what, who, 'cli', outcome, data=_values(args), note=note, patience=patience)
    except OSError as e:
        text = f'the audit log in {shop_dir()} cannot be written ({e.strerror})'
        raise ValueError(text) from None


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
    """`waam panel` without options tells the address of the page and opens nothing to anybody;
    `waam commission --list` and `--page` only look."""
    if args.command == 'commission':
        return args.list or args.page
    return args.command == 'panel' and not panel.serves(args)


def _values(args: argparse.Namespace) -> dict[str, Any]:
    """What was given, without defaults that say nothing; whose token it is is no secret."""
    given = {
        k: v for k, v in vars(args).items() if k not in LEFT_OUT and v not in (None, '', [], False)
    }
    plain = {k: v for k, v in given.items() if not callable(v)}
    return {k.removeprefix('form_'): v.name if isinstance(v, Path) else v for k, v in plain.items()}
