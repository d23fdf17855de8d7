"""Jobs that are cut off, and jobs that run for hours.

job.resume_rms_ratio_worst: a job is killed at a random moment (one node, or everything, or everything with a torn
checkpoint), resumed, and its final RMS compared with that of the undisturbed job (baseline 1, same part and seed);
worst of WAAM_BENCH_KILLS cuts (default 4; 100 takes about two hours).
job.beads_wrong: beads that the resumed jobs left out or laid twice, from their reports (baseline: beads of all jobs).
job.memory_growth_pct: resident memory of all nodes, growth after the first third (8 hours: the first hour) of
WAAM_BENCH_HOURS simulated hours of jobs in one graph (default 0.3; 8 takes about 45 minutes).
"""

from __future__ import annotations

import json
import os
import random
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from emit import emit

NAMES = ['job.resume_rms_ratio_worst', 'job.beads_wrong', 'job.memory_growth_pct']
DOMAIN = 216
SEED = 7
ACTIVE = range(2, 9)  # JobStatus states in which a job may be cut off


def main() -> None:
    """Both benchmarks, in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        resume(Path(scratch), int(os.environ.get('WAAM_BENCH_KILLS', 4)))
        memory(Path(scratch) / 'long', float(os.environ.get('WAAM_BENCH_HOURS', 0.3)))


def goal(jobs: Path):
    from waam_bringup.paths import share
    from waam_msgs.action import RunJob

    part = share('waam_bringup') / 'parts' / 'jaw_nominal.stl'
    return RunJob.Goal(
        name='bench', part=str(part), mode='restore', k_gain=float('nan'), jobs_dir=str(jobs), layers=2
    )  # fmt: skip


def load(client) -> None:
    from waam_bringup.paths import share

    worn = share('waam_bringup') / 'parts' / 'jaw_worn.stl'
    client.load_part(str(worn.resolve()), (0.0, 0.0, 0.0), SEED)


def run(client, request, folder: Path):
    from waam_bringup.operate import graph_trouble

    return client.run_job(request, lambda _: None, lambda: graph_trouble(folder))


def resume(scratch: Path, cuts: int) -> None:
    from waam_bringup.drill import power_on

    start = time.monotonic()
    with power_on(scratch / 'whole', DOMAIN, SEED) as (client, _):
        load(client)
        result = run(client, goal(scratch / 'jobs'), scratch / 'whole')
    if result.error_code:
        raise RuntimeError(f'the undisturbed job failed: {result.message}')
    length = time.monotonic() - start
    rng = random.Random(SEED)
    ratios, wrong, beads = [], 0, 0
    for number in range(cuts):
        how = ('everything', 'torn checkpoint', 'one node')[number % 3]
        folder = cut_and_resume(scratch / f'cut{number}', how, rng, length)
        report = json.loads((folder / 'report.json').read_text())['closed_loop']
        ratios.append(report['rms_mm'] * 1e-3 / result.rms)
        missing, doubled, all_beads = beads_of(folder)
        wrong, beads = wrong + missing + doubled, beads + all_beads
        print(f'cut {number + 1}/{cuts} ({how}): ratio {ratios[-1]:.3f}', file=sys.stderr)
    emit('job.resume_rms_ratio_worst', max(ratios), '1', 'undisturbed job, same seed', 1.0)
    emit('job.beads_wrong', wrong, 'beads', 'beads of all resumed jobs', beads)


def cut_and_resume(scratch: Path, how: str, rng: random.Random, length: float) -> Path:
    """A job that is cut off once, at a random moment after it has begun, and then resumed. Its folder."""
    from waam_bringup.client import GraphClient
    from waam_bringup.drill import power_cut, power_on
    from waam_msgs.action import RunJob

    home = scratch / 'run'
    with power_on(home, DOMAIN, SEED) as (client, pids):
        load(client)

        def background() -> None:
            with suppress(Exception), GraphClient(DOMAIN) as own:
                run(own, goal(scratch / 'jobs'), home)

        threading.Thread(target=background, daemon=True).start()
        client.until(lambda: client.job and client.job.state in ACTIVE, 60)
        client.until(lambda: False, rng.uniform(0.02, 0.6) * length)
        victims = pids if how != 'one node' else [rng.choice(pids[1:])]
        power_cut(victims)
        if how == 'one node':
            client.until(lambda: client.job.state not in ACTIVE, 60)
    folder = Path((home / 'job').read_text())
    if how == 'torn checkpoint' and (folder / 'checkpoint.json').exists():
        text = (folder / 'checkpoint.json').read_text()
        (folder / 'checkpoint.json').write_text(text[: rng.randrange(len(text))])
    status = json.loads((folder / 'status.json').read_text())
    if status['state'] == 'DONE':
        return folder
    with power_on(home, DOMAIN, SEED) as (client, _):
        result = run(client, RunJob.Goal(resume_dir=str(folder)), home)
    if result.error_code:
        raise RuntimeError(f'{how}: the job could not be resumed: {result.message}')
    return folder


def beads_of(folder: Path) -> tuple[int, int, int]:
    """(missing, doubled, all) beads: the metal found along each bead of the plan, over what was asked for."""
    from waam_job.resume import metal_shares
    from waam_plan.store import load_plan
    from waam_process.grid import HeightGrid

    plan = load_plan(folder / 'plan.npz')
    missing = doubled = count = 0
    for layer in plan.layers:
        surfaces = []
        for number in (layer.number - 1, layer.number):
            with np.load(folder / 'layers' / f'scan_{number:03d}.npz') as f:
                surfaces.append(HeightGrid(plan.spec, f['z'].astype(float)))
        shares = metal_shares(layer, *surfaces)
        for bead in {s.bead for s in layer.deposits}:
            mine = shares[[s.bead == bead for s in layer.deposits]]
            share = float(np.nanmean(mine)) if np.isfinite(mine).any() else 1.0
            missing, doubled, count = missing + (share < 0.5), doubled + (share > 1.6), count + 1
    return missing, doubled, count


def memory(scratch: Path, hours: float) -> None:
    """Jobs one after the other in one graph, memory looked at all the time."""
    from waam_bringup.drill import power_on

    with power_on(scratch / 'run', DOMAIN, SEED) as (client, pids):
        samples: list[tuple[float, float]] = []
        machine = 0.0
        while machine < hours * 3600:
            load(client)
            result = run(client, goal(scratch / 'jobs'), scratch / 'run')
            if result.error_code:
                raise RuntimeError(f'the job failed: {result.message}')
            report = json.loads((Path(result.job_dir) / 'report.json').read_text())
            machine += report['closed_loop']['duration_s']
            samples.append((machine / 3600, resident(pids)))
            print(f'{samples[-1][0]:.2f} h: {samples[-1][1]:.0f} MB', file=sys.stderr)
    settled = next(m for h, m in samples if h >= min(1.0, hours / 3))
    growth = 100 * (samples[-1][1] / settled - 1)
    emit('job.memory_growth_pct', growth, '%', 'resident memory after settling, MB', settled)


def resident(pids: list[int]) -> float:
    """MB of all processes together."""
    pages = 0
    for pid in pids:
        with suppress(OSError):
            pages += int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


if __name__ == '__main__':
    main()
