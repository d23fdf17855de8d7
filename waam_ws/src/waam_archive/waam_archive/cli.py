"""`waam jobs`: the archive of all jobs."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from .commands import ask, keep, look

EPILOG = """\
examples:
  waam jobs list --part 'jaw*' --since 30d               jobs of the last thirty days (new ones are taken in first)
  waam jobs show jaw_7                                   one job: what was asked, what came out, layer by layer
  waam jobs compare jaw_7 jaw_8                          two or more jobs side by side
  waam jobs find "arc lost"                              in names, messages, anomalies and reports
  waam jobs trend rms --subgroup 5 --upper 0.2 --picture rms.png       control chart, Cpk, drift by name
  waam jobs figures --by material --prices prices.yaml   kg/h, wire and energy per area, defects, cost
  waam jobs trace jaw_nominal.stl -o jaw.html            traceability record of a part over all its jobs
  waam jobs ingest /mnt/usb/jobs                         take in job folders from anywhere
  waam jobs sql "SELECT part, avg(rms_mm) FROM jobs GROUP BY part"
  waam jobs export --part 'jaw*' -o jaw --format csv     tables of some jobs, for other programs
  waam jobs verify                                       every file against its hash

Every verb prints JSON with --json. The archive is a folder of Parquet files (docs/archive.md): pandas, polars and
any SQL client read it, too.
"""


def register(commands: argparse._SubParsersAction, jobs_dir: Callable[[], Path]) -> None:
    """Adds the verb `jobs` with its sub-verbs. jobs_dir: folder of the jobs of this cell."""
    p = commands.add_parser(
        'jobs',
        help='the archive of all jobs: list, compare, trends, key figures, traceability, SQL',
        description='Asks thousands of jobs together. New jobs of the folder of jobs are taken in first.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = p.add_subparsers(dest='jobs_verb', metavar='VERB', required=True)
    common = _common(jobs_dir)
    look.register(verbs, common)
    ask.register(verbs, common)
    keep.register(verbs, common)


def _common(jobs_dir: Callable[[], Path]) -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(add_help=False)
    p.add_argument(
        '--archive',
        type=Path,
        metavar='FOLDER',
        help='folder of the archive (default: archive/ in the folder of jobs)',
    )
    p.add_argument('--json', action='store_true', help='JSON instead of tables, for scripts')
    p.add_argument(
        '--no-ingest', action='store_true', help='do not look for new jobs before answering'
    )
    p.set_defaults(jobs_dir=jobs_dir)
    return p
