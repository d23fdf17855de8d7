"""`waam record import`: logs of others, with a mapping that is proposed and must be given."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from .bag_writer import BagError, BagWriter

if TYPE_CHECKING:
    from .foreign.logs import Log
    from .foreign.mapping import FileMap
    from .log_column import Column

TEXT = 'logs of others as one recording: any text with columns'
EPILOG = """\
A file of text with columns needs a mapping (bags of ROS need none: rosbags-convert):
what each column is, its unit, how time is written. Without one this command reads the files, proposes one and writes
nothing:

  waam record import weld.csv > mapping.yaml         1. the proposal, with GUESSED beside what the file does not say
  nano mapping.yaml                                  2. put right what is wrong
  waam record import weld.csv --mapping mapping.yaml -o weld.mcap
  waam record import weld.csv --yes -o weld.mcap     the proposal as it is; on a terminal it asks

Understood by themselves: commas, semicolons, tabs or blanks between columns; decimal commas; line ends of all systems
in one file; blank lines; words above the header; a byte order mark. What cannot be read is counted with its lines.

The mapping file, one entry per file name (or pattern, as in "scan_*.csv"):
  waam_import: 1
  files:
    weld.csv:
      delimiter: ','              # , ; tab blank
      decimal: '.'                # or ,
      header_line: 1              # 0 = no names: columns are column_1 ...
      time:
        column: t                 # or, without such a column, rate_hz: 20
        format: minute_second     # s ms us ns | minute_second (36:51.1, wraps at the hour) | clock (16:48:38.5) |
                                  # year_first (2022/10/21/16:48:38.51) | day_first | month_first
        start: 2026-01-31T16:00:00Z      # what times without a date count from
        offset_s: 0               # is added: the clock of this file against the others
      travel: {direction: '-x', speed_mm_s: 33.3, start_mm: [440, 0, 40]}   # where no column says where the torch was
      columns:
        I: {is: arc_current, unit: A}
        note: {is: ignore}

is: position_x _y _z, travel_speed, wire_feed_speed, wire_feed_commanded, arc_current, arc_voltage, arc_on -> /telemetry
    temperature                                                              -> /temperature
    profile_x, profile_height | profile_distance, profile_intensity          -> /profiles (lists, or one point per line
                                                                                with point_profile)
    number -> /<file>/<column>; ignore
unit: m mm um in | m/s mm/s m/min mm/min cm/min in/min | A kA mA | V mV | C K F

`waam record info`, `ros2 bag play`, `waam view` and, with profiles and positions, `waam scan fuse` read the result.
docs/recordings.md walks through one log in ten minutes.

exit status: 0 written, 1 refused (the text says what and where), 3 a mapping is proposed and nothing was written
"""
PROPOSED = 3
BAGS = ('.bag', '.db3')
CONVERTED = '--dst NEW --dst-storage mcap --dst-typestore ros2_jazzy'


def register(verbs: argparse._SubParsersAction) -> None:
    """Adds `record import`."""
    verb = verbs.add_parser(
        'import',
        help=TEXT,
        description=TEXT,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.add_argument('paths', type=Path, nargs='+', metavar='FILE')
    verb.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='OUT',
        help='new folder, or a new file that ends in .mcap; without it only the mapping is proposed',
    )
    verb.add_argument('--mapping', type=Path, metavar='FILE', help='what the columns are')
    verb.add_argument('--yes', action='store_true', help='take the proposed mapping as it is')
    verb.set_defaults(run_command=run)


def run(args: argparse.Namespace) -> int:
    """Imports, or proposes a mapping."""
    try:
        return _run(args)
    except (ValueError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        return 1


def _run(args: argparse.Namespace) -> int:
    from .foreign import logs as foreign

    for path in args.paths:
        if not path.exists():
            raise BagError(f'{path}: no such file')
        if path.is_dir() or path.suffix.lower() in BAGS:
            raise BagError(
                f'{path}: a bag says itself what it holds: rosbags-convert --src {path} {CONVERTED}'
            )
    if args.output and args.output.exists():
        raise BagError(f'{args.output} exists already: a recording is never overwritten')
    if args.mapping and args.yes:
        raise BagError('--mapping and --yes contradict each other')
    names = [p.name for p in args.paths]
    if twice := [n for n in names if names.count(n) > 1]:
        raise BagError(f'two files are called {twice[0]}: a mapping cannot tell them apart')
    logs = foreign.read_logs(args.paths, _mapping(args.mapping), str(args.mapping))
    if not args.mapping and not _accepted(args, logs):
        return PROPOSED
    if args.output is None:
        raise BagError('say where the recording goes: -o OUT.mcap')
    columns, told = foreign.make(logs)
    for line in told:
        print(line)
    print(f'{_write(columns, args.output, names)} messages in {args.output}')
    return 0


def _mapping(path: Path | None) -> dict[str, FileMap] | None:
    from .foreign.mapping import read_mapping
    from .foreign.text import decoded

    if path is None:
        return None
    try:
        data = path.read_bytes()
    except OSError as e:
        raise BagError(f'{path}: {e.strerror or e}') from None
    return read_mapping(decoded(data, str(path)), str(path))


def _accepted(args: argparse.Namespace, logs: list[Log]) -> bool:
    """Shows the proposal; whether it may be used."""
    from .foreign.logs import open_points, proposal

    print(proposal(logs), end='')
    sys.stdout.flush()
    for line in open_points(logs):
        print(f'note: {line}', file=sys.stderr)
    if args.yes:
        return True
    if args.output and sys.stdin.isatty() and sys.stdout.isatty():
        answer = input('import with this mapping? [y/N] ')
        if answer.strip().lower() in ('y', 'yes'):
            return True
    print(
        'nothing was written: put the mapping above into a file, check it, and give it with --mapping FILE '
        '(or take it as it is with --yes)',
        file=sys.stderr,
    )
    return False


def _write(columns: list[Column], output: Path, sources: list[str]) -> int:
    """A folder, or a file that ends in .mcap. Returns the number of messages."""
    if output.suffix != '.mcap':
        return write(columns, output, sources)
    output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=output.parent, prefix='.import_') as folder:
        inside = Path(folder) / output.stem
        count = write(columns, inside, sources)
        shutil.move(next(inside.glob('*.mcap')), output)
    return count


def write(columns: list[Column], output: Path, sources: list[str]) -> int:
    """One recording of topics, by time; returns the number of messages."""
    rows = [(stamp, number, data) for number, c in enumerate(columns) for stamp, data in c.messages]
    rows.sort(key=lambda row: row[0])
    writer = BagWriter(output, {'imported_from': ', '.join(sources)})
    sequences = [0] * len(columns)
    numbers = [writer.add_topic(c.topic) for c in columns]
    for stamp, number, data in rows:
        sequences[number] += 1
        writer.write(numbers[number], stamp, stamp, sequences[number], data)
    writer.close()
    return writer.messages
