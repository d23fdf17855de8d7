"""A job with the process control switched on, through real processes: held, frozen, multiplied, recorded, replayed."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import yaml

from waam_msgs.msg import ProcessControl, Telemetry
from waam_node.qos import TELEMETRY

WANDERS = {'arc_tip_wander': 2e-3, 'arc_feed_wander': 0.05}
CHANGED = {'process_control': {'value': 'current'}, 'cell': WANDERS}


class Listener:
    """What was heard on two topics, in order."""

    def __init__(self, client) -> None:
        self.client = client
        self.status: list[ProcessControl] = []
        self.telemetry: list[Telemetry] = []
        node = client.node
        node.create_subscription(ProcessControl, 'process_control', self.status.append, TELEMETRY)
        node.create_subscription(Telemetry, 'telemetry', self.telemetry.append, TELEMETRY)

    def acting(self) -> bool:
        return bool(self.status) and not self.status[-1].frozen


@pytest.fixture(scope='module')
def part(tmp_path_factory, make_part) -> tuple[Path, Path]:
    """A trough with a wide flat bottom, so that its first layer is long."""
    return make_part(tmp_path_factory.mktemp('flat'), depth=2.0, steep=6.0)


@pytest.fixture(scope='module')
def done(tmp_path_factory, part, graph_in):
    """One layer, with what happened to it on the way."""
    folder = tmp_path_factory.mktemp('graph')
    file = folder / 'process.yaml'
    file.write_text(yaml.safe_dump({n: {'ros__parameters': p} for n, p in CHANGED.items()}))
    settings = {'rate': 4.0, 'params_files': (file,), 'without': ('dashboard', 'panel')}
    with graph_in(folder, part, **settings) as bench:
        return _watched_job(bench)


def _watched_job(bench) -> dict:
    """What was heard of a job of one layer, and its folder."""
    from waam_bringup.client import GraphClient

    bench.load()
    seen = {}
    with GraphClient(bench.domain) as client:
        listener = Listener(client)
        results = []
        job = Thread(target=lambda: results.append(_run(bench)), daemon=True)
        job.start()
        assert client.until(listener.acting, 120.0), 'the control never acted'
        client.until(lambda: False, 1.0)
        seen['frozen'] = _stop_for_a_moment(bench, client, listener)
        assert client.until(listener.acting, 60.0), 'the control does not act again'
        begin = len(listener.status)
        client.override(1.0, 0.9, 'test')
        assert job.is_alive(), 'the layer was laid before the override came'
        client.until(lambda: not job.is_alive(), 180.0)
        job.join(60.0)
        seen['after'] = listener.status[begin:]
        seen['telemetry'], seen['status'] = listener.telemetry, listener.status
    assert results, 'the job did not end'
    seen['folder'] = Path(results[0].job_dir)
    assert results[0].error_code == 0, results[0].message
    return seen


def _run(bench):
    from waam_bringup.client import GraphClient
    from waam_bringup.operate import graph_watch

    with GraphClient(bench.domain) as client:
        return client.run_job(bench.goal(layers=1), lambda _: None, graph_watch(bench.run))


def _stop_for_a_moment(bench, client, listener) -> list[ProcessControl]:
    """No telemetry for 0.7 s of the wall's time; the cell's own time stands still. What the control said meanwhile."""
    pid = bench.state().nodes['virtual_controller'].pid
    os.kill(pid, signal.SIGSTOP)
    try:
        begin = len(listener.status)
        end = time.monotonic() + 0.7
        client.until(lambda: time.monotonic() > end, 2.0)
        return listener.status[begin:]
    finally:
        os.kill(pid, signal.SIGCONT)


def test_the_value_is_held(done):
    acting = [m for m in done['status'] if not m.frozen]
    assert len(acting) > 50
    off = np.array([m.measured / m.reference - 1 for m in acting])
    factor = np.array([m.wire_factor for m in acting])
    without = (1 + off) * factor**-0.65 - 1  # what it would have been
    assert factor.std() > 0.005, 'there is something to fight against'
    late = slice(len(acting) // 2, None)  # the first beads take away what the table is wrong by
    assert np.median(np.abs(off[late])) < np.median(np.abs(without[late]))
    us = np.array([m.controller_us for m in acting])
    free = ~np.array([m.limited for m in acting])
    step = (np.diff(us) < 60_000) & free[1:] & free[:-1]
    # a step of a PID in velocity form goes with the error and with its change
    terms = np.stack([off[1:], np.diff(off)], 1)[step]
    steps = np.diff(np.log(factor))[step]
    (by_error, by_change), *_ = np.linalg.lstsq(terms, steps, rcond=None)
    left = np.sum((steps - terms @ (by_error, by_change)) ** 2) / np.sum(steps**2)
    told = f'{step.sum()} steps, {by_error:.3f}, {by_change:.3f}, {left:.2f} of their square left'
    assert step.sum() > 20 and by_error < 0 and left < 0.3, f'it acts against the error: {told}'


def test_it_steps_at_least_20_times_a_second(done):
    at = np.array([m.controller_us for m in done['status'] if not m.frozen])
    assert np.median(np.diff(at)) <= 50_000


def test_frozen_on_stale_telemetry(done):
    stale = [m for m in done['frozen'] if m.reason == 'telemetry is stale']
    assert stale and all(m.frozen for m in stale)
    assert len({(m.wire_factor, m.speed_factor) for m in stale}) == 1


def test_the_operators_override_multiplies(done):
    """0.9 of the wire is asked for: the control does not take it back, and telemetry shows the product."""
    told = [m for m in done['after'] if abs(m.operator_wire_factor - 0.9) < 1e-9 and not m.frozen]
    assert len(told) > 20
    assert 0.8 < np.median([m.wire_factor for m in told]) < 1.25
    assert not all(m.limited for m in told)
    asked = [0.9 * m.wire_factor for m in done['after']]
    begin, end = told[0].controller_us, told[-1].controller_us
    shown = [t.wire_override for t in done['telemetry'] if begin < t.controller_us < end]
    of_both = [min(abs(v - a) for a in asked) < 2e-3 for v in shown]  # however late it is
    assert len(shown) > 50 and np.mean(of_both) > 0.9


def test_idle_moves_have_the_operators_speed(done):
    after = done['telemetry'][-20:]
    assert not any(t.arc_established for t in after)
    assert {round(t.speed_override, 3) for t in after} == {1.0}


def test_recorded_and_replayed(done):
    from rosbags.highlevel import AnyReader

    from waam_replay.tune import tune

    with AnyReader([done['folder'] / 'record']) as reader:
        found = {c.topic: c.msgcount for c in reader.connections}
    assert found['/process_control'] > 50 and found['/process_override'] > 50
    again = tune(done['folder'])
    assert all(same == total > 0 for same, total in again.identical.values())
