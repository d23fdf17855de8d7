"""kill -9 of any one node in the middle of a bead: the arc is off in time and the job says what happened. Those that
only show may hang or die: the job goes on."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from waam_msgs.action import RunJob

CODES = RunJob.Result
LEASE_US = 500_000
NODES = {
    'cell': 'ALARM',
    'bridge': 'telemetry',
    'scan_fusion': 'scan_fusion',
    'correction_server': 'correction_server',
    'feed_forward': 'feed_forward',
    'thermal_compensator': 'thermal_compensator',
    'recorder': 'recorder',
    'job_sequencer': 'job_sequencer',
}


def arc_off_after(bench, since: int) -> tuple[int, int] | None:
    """(controller us at which the arc went off, tick up to which the lease had been renewed), first after `since`."""
    events = bench.events()
    for i, (t, event) in enumerate(events[:-1]):
        if t > since and event == 'arc off' and events[i + 1][1].startswith('lease '):
            return t, int(events[i + 1][1].split()[1])
    return None


@pytest.mark.parametrize('node', NODES)
def test_arc_is_off_in_time_and_the_job_says_why(make_graph, background, node):
    # slow enough to be in the middle of a bead
    with make_graph(rate=6.0, without=('dashboard', 'panel')) as bench:
        bench.load()
        job = background(bench)
        bench.wait(lambda: bench.count('arc on'), 60, 'arc on')
        bench.wait(lambda: bench.client.job and bench.client.job.bead >= 1, 30, 'first bead')
        on = max(t for t, e in bench.events() if e.startswith('arc on'))
        bench.kill(node)
        bench.wait(lambda: arc_off_after(bench, on), 20, 'arc off')
        off, lease = arc_off_after(bench, on)
        # no heartbeat that the dead node sent can be younger than its death, so this bounds the time since then
        assert off - lease <= LEASE_US
        bench.wait(lambda: bench.state().dead_nodes, 5, 'the supervisor noticing')
        assert bench.state().nodes[node].exit_code == -9
        job.join()
        if node == 'job_sequencer':
            assert 'job_sequencer' in str(job.error) and 'SIGKILL' in str(job.error)
            folder = Path((bench.run / 'job').read_text())
            status = json.loads((folder / 'status.json').read_text())
            assert status['state'] == 'INTERRUPTED' and 'SIGKILL' in status['message']
        else:
            assert job.result is not None, job.error
            assert job.result.error_code in (
                CODES.NODE_LOST,
                CODES.LINK_LOST,
                CODES.DEPOSITION_FAILED,
            )
            assert NODES[node] in job.result.message
            status = json.loads((Path(job.result.job_dir) / 'status.json').read_text())
            assert status['state'] == 'FAILED' and NODES[node] in status['message']
        assert not any(e.startswith('arc on') for t, e in bench.events() if t > off)


def test_viewers_that_hang_or_die_in_a_bead_change_nothing(make_graph, background):
    """Dashboard and panel stop answering (SIGSTOP), and die later: the job ends as if they were there."""
    with make_graph() as bench:
        bench.load()
        job = background(bench, layers=1)
        bench.wait(lambda: bench.count('arc on'), 60, 'arc on')
        viewers = {name: bench.state().nodes[name].pid for name in ('dashboard', 'panel')}
        for pid in viewers.values():
            os.kill(pid, signal.SIGSTOP)
        at = bench.client.job.bead
        bench.wait(lambda: bench.client.job.bead > at + 1, 60, 'the next beads')
        for name in viewers:
            bench.kill(name)
        result = job.join()
        assert result is not None and result.error_code == 0, (job.error, result)
        assert set(bench.state().dead_nodes) == set(viewers)
