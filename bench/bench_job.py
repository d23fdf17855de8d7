"""Jobs that are cut off and go on.

job.resume_rms_ratio_worst: jobs are killed at random moments (kill -9 of everything, of one node, of everything with a
torn checkpoint file) and resumed; the worst final RMS over that of the undisturbed job (median of three).
job.cuts_failed: trials that did not end in a finished job (baseline: all trials). job.beads_wrong: beads missing or
doubled in the resumed jobs (baseline: all their beads).
  WAAM_BENCH_TRIALS=N   how many trials (default 6; 100 take about an hour on an idle machine with two cores)
  WAAM_BENCH_CAMPAIGN=FILE  keeps the trials, one JSON line each; what is in it is not repeated. One file per version
                        of the software: the undisturbed jobs in it are the reference.
resume.false_refusals: jobs of the laboratory that were cut off, whose part lies in its place, and that are refused
(baseline: all such trials); half of them are seen with three times the scatter of the simulated scanner.
resume.shift_missed: the same jobs with a part that was shifted by 0.5 to 5 mm that go on, without being told that such
a shift is not seen (baseline: all such trials).
  WAAM_BENCH_SHIFTS=N   how many trials (default 200)
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from lib.campaign_graph import trials
from lib.emit import emit
from lib.job_cuts import WAYS, cut, undisturbed

WHOLE = 3  # undisturbed jobs: they differ, too


def cut_off() -> None:
    """Sums up all trials of the file."""
    with trials() as t:
        whole = [t.run('cut: none', n, undisturbed) for n in range(WHOLE)]
        length = float(np.median([row['length_s'] for row in whole]))
        for n in range(int(os.environ.get('WAAM_BENCH_TRIALS', 6))):
            t.run(f'cut: {WAYS[n % 3]}', n, cut(n, length))
        rows = [row for row in t.lines('cut') if row['what'] != 'cut: none']
    done = [row for row in rows if row['right']]
    reference = float(np.median([row['rms_mm'] for row in whole]))
    resumed = sum(row['resumed'] for row in done)
    print(f'{resumed} of {len(rows)} were cut off and resumed, {reference:.4f} mm', file=sys.stderr)
    worst = max(row['rms_mm'] for row in done) / reference
    emit('job.resume_rms_ratio_worst', worst, '1', 'median undisturbed job, same campaign', 1.0)
    emit('job.cuts_failed', len(rows) - len(done), 'trials', 'all trials', len(rows))
    wrong = sum(row['missing'] + row['doubled'] for row in done)
    beads = sum(row['beads'] for row in done)
    emit('job.beads_wrong', wrong, 'beads', 'beads of all resumed jobs', beads)


def shifts() -> None:
    """Goes on with jobs whose part was moved meanwhile."""
    from lib.resume_shifts import OVER, run_shifts

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as folder:
        found = run_shifts(Path(folder), int(os.environ.get('WAAM_BENCH_SHIFTS', 200)))
    still = [d for d in found if not d['shift_mm']]
    moved = [d for d in found if d['shift_mm'] > 1e3 * OVER]
    went_on = [d for d in moved if not d['code']]
    for d in found:
        if d in went_on or (d in still and d['code']):
            print(d, file=sys.stderr)
    told = sum(d['told_mm'] > 0.9 * d['shift_mm'] for d in went_on)
    print(f'{len(went_on)} of {len(moved)} shifted ones went on, {told} told so', file=sys.stderr)
    emit('resume.shift_missed', len(went_on) - told, 'jobs', 'jobs with a shifted part', len(moved))
    refused = sum(d['code'] != 0 for d in still)
    emit('resume.false_refusals', refused, 'jobs', 'jobs with the part in its place', len(still))


FIGURES = {
    **dict.fromkeys(('job.resume_rms_ratio_worst', 'job.cuts_failed', 'job.beads_wrong'), cut_off),
    **dict.fromkeys(('resume.shift_missed', 'resume.false_refusals'), shifts),
}
