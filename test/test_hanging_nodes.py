"""The nodes without which no job runs, stopped with SIGSTOP between jobs: started again, and the next job is done."""

from __future__ import annotations

import os
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray

HANG_S = 4.0


@pytest.mark.parametrize('node', ['bridge', 'job_sequencer'])
def test_a_job_is_done_after_a_node_has_hung_and_was_started_again(make_graph, node):
    with make_graph(hang_timeout=HANG_S, without=('dashboard', 'panel')) as bench:
        heard: set[str] = set()
        bench.client.node.create_subscription(
            DiagnosticArray,
            '/diagnostics',
            lambda m: heard.update(s.hardware_id for s in m.status),
            10,
        )
        # a sign of life goes out beside each of them; before its first one a node counts as starting
        bench.wait(lambda: node in heard, 30.0, f'a sign of life of {node}')
        before = bench.state().nodes
        os.kill(before[node].pid, signal.SIGSTOP)
        bench.wait(lambda: bench.state().nodes[node].restarts == 1, 60.0, f'restart of {node}')
        # not before: the old one is woken for a moment, to write down where it hung, and speaks
        bench.client.machine = bench.client.job = None
        after = bench.state()
        assert f'{node} gave no sign of life' in after.nodes[node].reason == after.message
        assert {n for n in after.nodes if after.nodes[n].pid != before[n].pid} == {node}
        told = (lambda: bench.client.machine) if node == 'bridge' else (lambda: bench.client.job)
        bench.wait(told, 30.0, f'first word of the new {node}')
        bench.wait(lambda: bench.state().alive and not bench.state().dead_nodes, 1.0, 'all up')
        result = bench.job(layers=1)
        assert result.error_code == 0, result.message
        assert result.layers == 1
