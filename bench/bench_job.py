"""Jobs that are cut off, and one job that runs for hours.

job.resume_rms_ratio_worst: jobs are killed at random moments (kill -9 of everything, of one node, of everything with a
torn checkpoint file) and resumed; the worst final RMS over that of the undisturbed job (median of those measured).
job.cuts_failed: trials that did not end in a finished job (baseline: all trials). job.beads_wrong: beads missing or
doubled in the resumed jobs (baseline: all their beads).
  WAAM_BENCH_TRIALS=N   how many trials (default 6; 100 take about 45 minutes on an idle machine with two cores)
  WAAM_BENCH_CUTS=FILE  the trials are kept in this file, one JSON line each; a campaign can so be run in portions:
                        trials that are in the file are not run again. Failed ones leave their folder beside it.
                        One file per version of the software: the undisturbed jobs in it are the reference.
job.memory_growth_pct: resident memory of all processes together during one job, growth after the first hour (a shorter
run: the first third), baseline the MB then. job.loop_drift_pct: change of the loop's period (scan to scan, without
wait, deposition and the planned moves of the scan) over the same job, baseline its mean in s. job.simulated_per_wall:
simulated seconds per second.
  WAAM_BENCH_HOURS=H    simulated hours (default 0.2; 8 take as long as job.simulated_per_wall says, about an hour)
  WAAM_BENCH_INTERPASS=C  limit in degrees Celsius (default 60: waits so long that the block lasts for 8 hours)
  WAAM_BENCH_SAMPLES=FILE  memory of every process every ten simulated minutes, one JSON line each
resume.false_refusals: jobs of the laboratory that were cut off, whose part lies in its place, and that are refused
(baseline: all such trials); half of them are seen with three times the scatter of the simulated scanner.
resume.shift_missed: the same jobs with a part that was shifted by 0.5 to 5 mm that go on, without being told that such
a shift is not seen (baseline: all such trials).
  WAAM_BENCH_SHIFTS=N   how many trials (default 200)
Portions of it with other work on the machine: nice -n 10.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.job_cuts import run_campaign
from lib.job_endurance import loop_periods, run_long_job
from lib.resume_shifts import OVER, run_shifts


def cut_off() -> None:
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as folder:
        file = Path(os.environ.get('WAAM_BENCH_CUTS', Path(folder) / 'cuts.jsonl')).resolve()
        cuts(Path(folder) / 'cuts', file, int(os.environ.get('WAAM_BENCH_TRIALS', 6)))


def long_job() -> None:
    samples = os.environ.get('WAAM_BENCH_SAMPLES')
    hours = float(os.environ.get('WAAM_BENCH_HOURS', 0.2))
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as folder:
        endure(Path(folder) / 'long', hours, Path(samples).resolve() if samples else None)


def cuts(scratch: Path, file: Path, trials: int) -> None:
    """Runs what is missing of the campaign and sums up all of it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    campaign = run_campaign(scratch, file, trials)
    whole = [d['rms_mm'] for d in campaign.lines('undisturbed')]
    lines = campaign.lines('cut')
    done = [d for d in lines if 'error' not in d]
    reference = float(np.median(whole))
    print(
        f'undisturbed RMS {min(whole):.4f} .. {max(whole):.4f} mm in {len(whole)} jobs; '
        f'{sum(d["resumed"] for d in done)} of {len(lines)} jobs were cut off and resumed',
        file=sys.stderr,
    )
    versions = sorted({d.get('software', 'unknown') for d in lines + campaign.lines('undisturbed')})
    if len(versions) > 1:
        print(f'the trials are of several versions: {", ".join(versions)}', file=sys.stderr)
    for d in lines:
        if 'error' in d:
            print(f'trial {d["number"]} ({d["how"]}) failed: {d["error"]}', file=sys.stderr)
    if late := sum(d.get('failed_starts', 0) for d in lines):
        print(f'the graph came up only at a second attempt {late} times', file=sys.stderr)
    worst = max(d['rms_mm'] for d in done) / reference
    emit('job.resume_rms_ratio_worst', worst, '1', 'median undisturbed job, same campaign', 1.0)
    failed = sum('error' in d or d.get('failed_starts', 0) > 0 for d in lines)
    emit('job.cuts_failed', failed, 'trials', 'all trials', len(lines))
    wrong = sum(d['missing'] + d['doubled'] for d in done)
    beads = sum(d['beads'] for d in done)
    emit('job.beads_wrong', wrong, 'beads', 'beads of all resumed jobs', beads)


def endure(scratch: Path, hours: float, file: Path | None) -> None:
    """One long job."""
    watch, run = run_long_job(scratch, hours, file)
    growth, settled, by_process = watch.growth()
    for name, percent in sorted(by_process.items(), key=lambda kv: -kv[1]):
        print(f'{name:20s} {percent:+7.2f} %', file=sys.stderr)
    for name, (simulated, wall, cpu) in watch.phases.items():
        print(
            f'{name:12s} {simulated:8.1f} simulated s in {wall:7.1f} s, {cpu / max(simulated, 1e-9):.3f} s of CPU each'
            f'; {watch.drift(name):+.2f} simulated s a layer from the third to the last',
            file=sys.stderr,
        )
    layers, periods = loop_periods(watch, run)
    slope = np.polyfit(layers, periods, 1)[0] if len(layers) > 2 else 0.0
    drift = 100 * slope * (layers[-1] - layers[0]) / periods.mean() if len(layers) > 2 else 0.0
    emit('job.memory_growth_pct', growth, '%', 'resident memory after settling, MB', settled)
    emit('job.loop_drift_pct', float(drift), '%', 'mean period, s', float(periods.mean()))
    wall = watch.samples[-1][1]
    emit('job.simulated_per_wall', watch.samples[-1][0] / wall, '1', 'real time', 1.0)


def shifts() -> None:
    """Goes on with jobs whose part was moved meanwhile."""
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
    'job.resume_rms_ratio_worst': cut_off,
    'job.cuts_failed': cut_off,
    'job.beads_wrong': cut_off,
    'job.memory_growth_pct': long_job,
    'job.loop_drift_pct': long_job,
    'job.simulated_per_wall': long_job,
    'resume.shift_missed': shifts,
    'resume.false_refusals': shifts,
}
