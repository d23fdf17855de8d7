"""`waam replay check` and `tune` over many records: progress, a line per record, what differs, and a summary."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from pathlib import Path

from waam_node.advance import Advance
from waam_node.files import write_atomically
from waam_node.revision import software_revision
from waam_node.spread import Workers

from .many import PRELOAD, Found, is_job, jobs_in, replay_all, same
from .parameters import effective

SHOWN = 20  # records that differ, on the screen


def is_many(args: argparse.Namespace) -> bool:
    """Whether more than one record is meant, or the work is to be spread."""
    asked = args.workers is not None or bool(args.cluster)
    return asked or len(args.jobs) > 1 or (args.jobs[0].is_dir() and not is_job(args.jobs[0]))


def run_many(args: argparse.Namespace, verb: str) -> int:
    """verb: check or tune. 0; 1 when a record cannot be read or, for check, differs. ValueError."""
    if (args.workers or 0) < 0:
        raise ValueError(f'--workers is {args.workers}, must not be negative')
    settings = args.settings if verb == 'tune' else []
    effective({}, settings)
    jobs = jobs_in(args.jobs)
    out = args.output or Path(os.environ.get('WAAM_JOBS', 'jobs')) / f'replay_{verb}'
    workers = Workers(args.workers or 0, args.cluster, PRELOAD)
    with RecordAdvance(len(jobs), verb) as bar:
        try:
            found = replay_all(jobs, settings, out, software_revision(), workers, bar)
        except KeyboardInterrupt:
            again = shlex.join(['waam', *sys.argv[1:]])
            print(
                f'{bar.done} of {len(jobs)} records are done; go on with {again}', file=sys.stderr
            )
            raise
    summary = {str(job): {'seconds': None, **f} for job, f in found.items()}
    write_atomically(out / f'{verb}.json', json.dumps(summary, indent=1))
    failed = tell(found, verb)
    print(f'written: {out / f"{verb}.json"}')
    return 1 if failed else 0


def tell(found: dict[Path, Found], verb: str) -> bool:
    """Prints how many records are what they were, and which are not; whether one is wrong."""
    errors = [(job, f['error']) for job, f in found.items() if 'error' in f]
    other = [(job, f) for job, f in found.items() if 'error' not in f and not same(f)]
    equal = len(found) - len(errors) - len(other)
    print(f'{len(found)} records: {equal} identical, {len(other)} different, {len(errors)} errors')
    for job, f in other[:SHOWN]:
        counts = ', '.join(f'{n} of {of} {name}' for name, (n, of) in f['identical'].items())
        print(f'different: {job.name}; identical are {counts}')
    for job, text in errors[:SHOWN]:
        print(f'error: {job.name}: {text}')
    if max(len(other), len(errors)) > SHOWN:
        print('the file names all of them')
    return bool(errors) or (verb == 'check' and bool(other))


class RecordAdvance(Advance):
    """Records done, and whether the last one is what it was."""

    def __call__(self, job: Path, found: Found) -> None:
        """One record is done."""
        said = found.get('error') or ('identical' if same(found) else 'different')
        self.step(f'{job.name}: {said}')
