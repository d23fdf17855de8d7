"""`waam record`: look at recordings, verify and save them; start and stop the recorder of a running
graph."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .bag_reader import Info

_EXAMPLES = """examples:
  waam record info jobs/latest/record        what is in it: topics, messages, losses, duration
  waam record check jobs/latest/record       reads every chunk again and compares with the index
  waam record recover jobs/latest/record     saves the intact part of a recording that was cut off
  waam record start /tmp/record --note wire=ER70S-6
  waam record stop

A recording is a folder with MCAP files and metadata.yaml: `ros2 bag play FOLDER`, rosbags, Foxglove,
PlotJuggler and rerun open it."""


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb `record` with its sub-verbs."""
    parser = commands.add_parser(
        'record',
        help='recordings: info, check, recover; start and stop the recorder',
        description=__doc__,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest='record_verb', required=True, metavar='VERB')
    for name, run, text in (
        ('info', _info, 'topics, messages, losses and duration'),
        ('check', _check, 'verify every chunk; exit status 1 when something is wrong'),
    ):
        verb = verbs.add_parser(name, help=text, description=text)
        verb.add_argument('path', metavar='PATH', help='recording folder or .mcap file')
        verb.set_defaults(run=run)
    _register_recover(verbs)
    _register_control(verbs)


def _register_recover(verbs: argparse._SubParsersAction) -> None:
    text = 'write the intact part of a damaged recording as a new one (the old one is not touched)'
    verb = verbs.add_parser('recover', help=text, description=text)
    verb.add_argument('path', metavar='PATH', help='recording folder or .mcap file')
    verb.add_argument('-o', '--output', help='new folder (default: PATH with _recovered added)')
    verb.set_defaults(run=_recover)


def _register_control(verbs: argparse._SubParsersAction) -> None:
    start = verbs.add_parser('start', help='let the running recorder record into a new folder')
    start.add_argument('directory', metavar='FOLDER', help='must not exist yet')
    start.add_argument('--note', action='append', default=[], metavar='KEY=VALUE')
    start.set_defaults(run=lambda args: _control('START', args.directory, args.note))
    for name, text in (
        ('stop', 'close and verify the recording'),
        ('split', 'start the next file'),
        ('pause', 'leave out what comes now'),
        ('resume', 'go on after a pause'),
    ):
        verb = verbs.add_parser(name, help=text)
        verb.set_defaults(run=lambda args, code=name.upper(): _control(code))


def _info(args: argparse.Namespace) -> int:
    from pathlib import Path

    from .bag_reader import info

    try:
        found = info(Path(args.path))
    except (ValueError, OSError) as e:
        return _error(e)
    print(_table(found))
    print(
        f'{found.messages} messages in {len(found.files)} file(s), {found.bytes / 1e6:.1f} MB, '
        f'{found.duration_s:.1f} s'
    )
    for key, value in sorted(found.custom_data.items()):
        print(f'  {key} = {value}')
    for text in found.broken:
        print(f'broken: {text}')
    return 1 if found.broken else 0


def _table(found: Info) -> str:
    head = ('topic', 'type', 'messages', 'Hz', 'lost', 'dropped')
    rows = [head]
    for name, t in sorted(found.topics.items()):
        rate = f'{t.messages / found.duration_s:.1f}' if found.duration_s > 0 else ''
        rows.append((name, t.type, str(t.messages), rate, str(t.lost), str(t.dropped)))
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = []
    for row in rows:
        cells = [
            c.ljust(w) if i < 2 else c.rjust(w)
            for i, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append('  '.join(cells))
    return '\n'.join(lines)


def _check(args: argparse.Namespace) -> int:
    from pathlib import Path

    from .bag_reader import check

    try:
        result = check(Path(args.path))
    except (ValueError, OSError) as e:
        return _error(e)
    for problem in result.problems:
        print(f'error: {problem}', file=sys.stderr)
    print(f'{result.messages} messages verified' + ('' if result.sound else '; see the errors'))
    return 0 if result.sound else 1


def _recover(args: argparse.Namespace) -> int:
    from pathlib import Path

    from .bag_reader import recover

    source = Path(args.path)
    target = Path(args.output) if args.output else source.with_name(source.stem + '_recovered')
    try:
        saved = recover(source, target)
    except (ValueError, OSError) as e:
        return _error(e)
    for text in saved.damage:
        print(f'note: {text}', file=sys.stderr)
    print(f'{saved.messages} messages saved in {saved.output}')
    return 0


def _control(code: str, directory: str = '', notes: list[str] | None = None) -> int:
    from pathlib import Path

    import rclpy

    from waam_msgs.srv import Record

    folder = str(Path(directory).resolve()) if directory else ''
    request = Record.Request(
        code=getattr(Record.Request, code), directory=folder, custom_data=notes or []
    )
    rclpy.init()
    try:
        node = rclpy.create_node('record_cli')
        client = node.create_client(Record, 'recorder/control')
        if not client.wait_for_service(timeout_sec=3.0):
            return _error('no recorder answers (is the graph up? `waam up`)')
        time.sleep(0.2)  # a server that has not yet found a new client's reader loses the answer
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
        if not future.done():
            return _error('the recorder did not answer within 30 s')
        answer = future.result()
    finally:
        rclpy.try_shutdown()
    if not answer.success:
        return _error(answer.message)
    print(answer.message)
    return 0


def _error(text: object) -> int:
    print(f'error: {text}', file=sys.stderr)
    return 1
