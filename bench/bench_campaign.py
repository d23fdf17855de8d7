"""Disturbances of whole jobs, and what became of them. A trial is right when the arc was off within its lease where the
lease ended, the job ended by itself, and nothing went wrong without being named.

campaign.wrong_in_silence: jobs of the laboratory with wrong maps, corrections and temperatures that were neither told
nor harmless (baseline: all of them).
campaign.strokes_wrong: kills and suspensions of every node of a running graph at random moments (baseline: all).
campaign.lease_worst_ms: longest time from the lease's last renewal to the arc being off in them (baseline: the lease).
  WAAM_BENCH_STROKES=N  how many (default 22: each node each way once)
campaign.strangers_wrong: foreign publishers on every topic, heartbeats of dead nodes, 50 more participants, wall clocks
that jump by hours, a second `waam up` on the folder, a full /dev/shm (baseline: all of them).
campaign.jobs_wrong: 20 jobs in one graph that did not end well (baseline: all of them).
campaign.grown_mb_most, campaign.grown_descriptors_most, campaign.grown_threads_most: growth of the process of that
graph that grew most, from the sixth job to the last (baseline: the number of jobs).
  WAAM_BENCH_CAMPAIGN=FILE  keeps the trials, one JSON line each; what is in it is not repeated
campaign.table (a table): what is in that file, as docs/campaigns.md has it.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections import defaultdict
from functools import partial
from pathlib import Path

from lib.campaign_graph import stroke, trials, twenty_jobs
from lib.emit import emit

NODES = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'recorder', 'job_sequencer',
    'process_control', 'dashboard', 'panel', 'bridge', 'cell',
)  # fmt: skip
BEATING = ('scan_fusion', 'correction_server', 'recorder', 'job_sequencer')
JUMPS = (3 * 3600.0, -3 * 3600.0, 400 * 86400.0)
SEEDS = (1, 2)


def in_the_laboratory() -> None:
    """Every case of lib/campaign_lab.py on two seeds."""
    from lib.campaign_lab import CASES, run_case

    with trials() as t, tempfile.TemporaryDirectory() as folder:
        rows = []
        for seed in SEEDS:
            whole = run_case(Path(folder), '', seed)['rms_mm'] * 1e-3
            for name in CASES:
                case = partial(run_case, Path(folder), name, seed, whole)
                rows.append(t.run(f'job: {name}', seed, lambda graph, rng, case=case: case()))
        emit('campaign.wrong_in_silence', *_wrong(rows), len(rows))


def strokes() -> None:
    """Nodes in turn, ways in turn."""
    from waam_bringup.graph import Settings, processes

    with trials() as t:
        present = {p.name for p in processes(Settings(run=Path('/nowhere')))}
        nodes = [n for n in NODES if n in present]
        for number in range(int(os.environ.get('WAAM_BENCH_STROKES', 2 * len(nodes)))):
            way = ('kill', 'suspend')[number // len(nodes) % 2]
            node = nodes[number % len(nodes)]
            t.run(f'stroke: {way} {node}', number, stroke(node, way))
        rows = t.lines('stroke')
        emit('campaign.strokes_wrong', *_wrong(rows), len(rows))
        off = [r['off_ms'] for r in rows if r.get('off_ms')]
        emit('campaign.lease_worst_ms', max(off, default=0.0), 'ms', 'the lease', 500.0)


def strangers() -> None:
    """What others on the bus, clocks and a second start can do."""
    from lib import campaign_strangers as s
    from lib.campaign_clock import jumps
    from lib.campaign_folder import full_shared_memory, second_up

    wanted = {f'stranger: {n}': s.says(n) for n in s.SAYS}
    wanted |= {f'stranger: beats as {n}, which is killed': s.beats_of_the_dead(n) for n in BEATING}
    wanted[f'stranger: {s.PARTICIPANTS} participants'] = s.crowd
    wanted |= {f'clock: jumps by {jump / 3600:+.0f} h and back': jumps(jump) for jump in JUMPS}
    wanted['start: a second waam up on the folder'] = second_up
    wanted['start: /dev/shm full in the arc'] = full_shared_memory
    with trials() as t:
        for what, trial in wanted.items():
            t.run(what, 0, trial)
        rows = t.lines('stranger', 'clock', 'start')
        emit('campaign.strangers_wrong', *_wrong(rows), len(rows))


def many_jobs() -> None:
    """20 jobs in one graph."""
    with trials() as t:
        row = t.run('jobs: 20 in one graph', 0, lambda graph, _: twenty_jobs(graph))
    jobs = row.get('jobs', 20)
    emit('campaign.jobs_wrong', jobs - row.get('done', 0), 'jobs', 'all jobs', jobs)
    for name in ('mb', 'descriptors', 'threads'):
        grown = row.get(f'grown_{name}_most', float('nan'))
        emit(f'campaign.grown_{name}_most', grown, name, 'jobs behind it', jobs)


def table() -> None:
    """Of the file of WAAM_BENCH_CAMPAIGN: what was done, how often, how often right, what happened."""
    rows = [
        json.loads(line)
        for line in Path(os.environ['WAAM_BENCH_CAMPAIGN']).read_text().splitlines()
    ]
    groups: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        groups[row['what']].append(row)
    print('| what | times | right | ended | worst time to arc off, ms |\n|---|---|---|---|---|')
    for what, of in sorted(groups.items()):
        ends: dict[str, int] = defaultdict(int)
        for row in of:
            ends[row.get('error') or row.get('ended') or '–'] += 1
        ended = ', '.join(f'{n} x {e}' for e, n in ends.items())
        off = max((r['off_ms'] for r in of if r.get('off_ms')), default=None)
        right = sum(bool(r['right']) for r in of)
        print(
            f'| {what} | {len(of)} | {right} | {ended} | {"–" if off is None else f"{off:.0f}"} |'
        )


def _wrong(rows: list[dict]) -> tuple[int, str, str]:
    """Value, unit and baseline of `emit`."""
    for row in rows:
        if not row['right']:
            print(f'wrong: {row}', file=sys.stderr)
    return sum(not r['right'] for r in rows), 'trials', 'all trials'


FIGURES = {
    'campaign.wrong_in_silence': in_the_laboratory,
    **dict.fromkeys(('campaign.strokes_wrong', 'campaign.lease_worst_ms'), strokes),
    'campaign.strangers_wrong': strangers, 'campaign.jobs_wrong': many_jobs,
    **{f'campaign.grown_{what}_most': many_jobs for what in ('mb', 'descriptors', 'threads')},
}  # fmt: skip
TABLES = {'campaign.table': table}
