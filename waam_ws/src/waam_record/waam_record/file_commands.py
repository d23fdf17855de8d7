"""`waam record` on files: info, check, recover, import."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from waam_node import job_folder
from waam_process.cli_options import as_table

from . import import_command

if TYPE_CHECKING:
    from .bag_reader import Info

PATH = 'recording folder, job folder or .mcap file'


def recording(text: str) -> Path:
    """The path that was given; of a job's folder the recording inside it."""
    path = Path(text)
    inside = path / job_folder.record()
    return inside if not any(path.glob('*.mcap')) and any(inside.glob('*.mcap')) else path


def register(verbs: argparse._SubParsersAction) -> None:
    """Adds the verbs that work on files."""

    def verb(name: str, run: Callable, text: str) -> argparse.ArgumentParser:
        p = verbs.add_parser(name, help=text, description=text)
        p.add_argument('path', type=recording, metavar='PATH', help=PATH)
        p.set_defaults(run_command=run)
        return p

    info = verb('info', _info, 'topics, messages, losses and duration')
    text = 'also job.yaml and the parameters of all nodes'
    info.add_argument('-v', '--verbose', action='store_true', help=text)
    verb('check', _check, 'verify every chunk; exit status 1 when something is wrong')
    text = 'write everything that is whole in a damaged recording as a new one (the old one is not touched)'
    recover = verb('recover', _recover, text)
    text = 'new folder (default: PATH with _recovered added)'
    recover.add_argument('-o', '--output', type=Path, help=text)
    import_command.register(verbs)


def _info(args: argparse.Namespace) -> int:
    from .bag_reader import info

    try:
        found = info(args.path)
    except (ValueError, OSError) as e:
        return error(e)
    print(_table(found))
    print(
        f'{found.messages} messages in {len(found.files)} file(s), {found.bytes / 1e6:.1f} MB, '
        f'{found.duration_s:.1f} s'
    )
    for key, value in sorted(found.custom_data.items()):
        if args.verbose or not (key.startswith('parameters.') or '\n' in value):
            print(f'  {key} = {value}')
    for text in found.broken:
        print(f'broken: {text}')
    return 1 if found.broken else 0


def _table(found: Info) -> str:
    head = ('topic', 'type', 'messages', 'Hz', 'lost', 'dropped')
    rows = []
    for name, t in sorted(found.topics.items()):
        rate = f'{t.messages / found.duration_s:.1f}' if found.duration_s > 0 else ''
        rows.append((name, t.type, str(t.messages), rate, str(t.lost), str(t.dropped)))
    return as_table(head, rows, left=2)


def _check(args: argparse.Namespace) -> int:
    from .bag_reader import check

    try:
        result = check(args.path)
    except (ValueError, OSError) as e:
        return error(e)
    for problem in result.problems:
        print(f'error: {problem}', file=sys.stderr)
    print(f'{result.messages} messages verified' + ('' if result.sound else '; see the errors'))
    return 0 if result.sound else 1


def _recover(args: argparse.Namespace) -> int:
    from .bag_copy import recover

    target = args.output or args.path.with_name(args.path.stem + '_recovered')
    try:
        saved = recover(args.path, target)
    except (ValueError, OSError) as e:
        return error(e)
    if not saved.messages:
        shutil.rmtree(saved.output)  # made just now, and empty
        reason = '; '.join(saved.damage[:3]) or 'no message was ever written'
        return error(f'{args.path}: nothing can be recovered ({reason})')
    for text in saved.damage:
        print(f'note: {text}', file=sys.stderr)
    lost = f'; {len(saved.damage)} damages, see the notes' if saved.damage else ''
    print(f'{saved.messages} messages saved in {saved.output}{lost}')
    return 0


def error(text: object) -> int:
    """Prints the text to stderr. Returns 1, the exit status."""
    print(f'error: {text}', file=sys.stderr)
    return 1
