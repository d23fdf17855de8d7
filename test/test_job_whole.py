"""A job ends whole, with real processes: wire that runs out, a late recorder, a sequencer that dies."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from waam_msgs.action import RunJob
from waam_msgs.msg import JobStatus
from waam_msgs.srv import InjectFault
from waam_process.operating import DEFAULT_PRESET
from waam_record.bag_reader import check

WIRE = 'the wire is slower than commanded'


def inject(bench, fault: str) -> None:
    request = InjectFault.Request(fault=fault)
    assert bench.client.call(InjectFault, 'cell/inject_fault', request).success


def report_of(result) -> dict:
    return json.loads((Path(result.job_dir) / 'report.json').read_text())['closed_loop']


def without_wire(bench, job) -> JobStatus:
    """The wire runs out in a bead; the status of the job that waits for a new spool."""
    seen: list[JobStatus] = []
    bench.client.node.create_subscription(JobStatus, 'job_status', seen.append, 10)

    def state(value: int) -> bool:
        return job.raise_error() or bool(seen) and seen[-1].state == value

    bench.wait(lambda: state(JobStatus.DEPOSITING), 120, 'a layer')
    bench.wait(lambda: state(JobStatus.DEPOSITING) and seen[-1].bead >= 2, 60, 'the second bead')
    inject(bench, 'wire_end')
    bench.wait(lambda: state(JobStatus.PAUSED) or not job.runs(), 60, 'a pause')
    assert job.runs(), job.result
    return seen[-1]


def size(folder: Path) -> int:
    return sum(f.stat().st_size for f in folder.rglob('*') if f.is_file())


def assert_closed(record: Path) -> None:
    """Whole, and nothing writes to it any more."""
    assert check(record).sound
    before = size(record)
    time.sleep(3.0)
    assert size(record) == before


def assert_another_job_starts(bench) -> None:
    result = bench.job(layers=1)
    assert result.error_code == 0, result.message
    assert_closed(Path(result.job_dir) / 'record')


def test_the_end_of_the_wire_pauses_the_job_and_a_new_spool_lets_it_go_on(bench, background):
    bench.load()
    job = background(bench)
    paused = without_wire(bench, job)
    assert WIRE in paused.message and not bench.client.machine.arc_on
    inject(bench, 'none')
    assert bench.client.resume()
    result = job.join(300)
    assert result.error_code == 0, result.message
    run = report_of(result)
    (fault,) = [a for a in run['anomalies'] if a['severity'] in ('FAULT', 'ALARM')]
    assert fault['class'] == 'wire' and 'job paused' in fault['reaction']
    assert run['rms_mm'] < 0.35
    planned, done = executed(Path(result.job_dir) / 'record')
    assert set(planned) == {1, 2, 3} and done >= max(i for layer in planned.values() for i in layer)
    assert gaps(Path(result.job_dir)) < 0.02, 'a bead is missing'


def executed(record: Path) -> tuple[dict[int, set[int]], int]:
    """Indices of the deposit segments by layer as planned, and the newest that the controller has executed."""
    planned: dict[int, set[int]] = {}
    newest = -1
    for message in read_messages(record, ('/layer_plan', '/segment_done')):
        if hasattr(message, 'segments'):
            laid = {s.index for s in message.segments if s.arc}
            planned.setdefault(message.layer, set()).update(laid)
        else:
            newest = max(newest, message.index)
    return planned, newest


def read_messages(record: Path, topics: tuple[str, ...]):
    from rosbags.highlevel import AnyReader

    with AnyReader([record]) as reader:
        wanted = [c for c in reader.connections if c.topic in topics]
        for connection, _, raw in reader.messages(connections=wanted):
            yield reader.deserialize(raw, connection.msgtype)


def gaps(folder: Path) -> float:
    """Share of the region that has not got half of its metal."""
    files = sorted((folder / 'layers').glob('scan_*.npz'))
    first, last = np.load(files[0]), np.load(files[-1])
    on = first['region']
    missing = (first['nominal'] - first['z'])[on]
    grown = (last['z'] - first['z'])[on]
    deep = missing > 1e-3
    return float(np.mean(grown[deep] < 0.5 * missing[deep]))


def test_a_job_on_the_cell_that_users_get_ends_without_a_fault(make_graph):
    with make_graph(preset=DEFAULT_PRESET) as bench:
        assert bench.state().preset == DEFAULT_PRESET
        result = bench.job()
    assert result.error_code == 0, result.message
    run = report_of(result)
    assert run['verdict'] in ('in tolerance', 'out of tolerance')
    assert run['rms_mm'] < 0.35 and run['faults'] == 0 and run['telemetry_lost'] == 0


def test_stop_instead_of_a_new_spool_ends_the_job_whole(bench, background):
    bench.load()
    job = background(bench)
    without_wire(bench, job)
    bench.client.trigger('job_sequencer/abort')
    result = job.join(120)
    assert result.error_code == RunJob.Result.ABORTED, result.message
    folder = Path(result.job_dir)
    assert json.loads((folder / 'status.json').read_text())['state'] == 'ABORTED'
    assert report_of(result)['verdict'] == 'aborted' or report_of(result)['anomalies']
    inject(bench, 'none')
    bench.wait(lambda: not bench.client.machine.armed_job, 10, 'DISARM')
    assert not bench.client.machine.arc_on
    assert_closed(folder / 'record')
    assert_another_job_starts(bench)


def test_a_start_of_the_record_that_is_answered_too_late_leaves_nothing_at_work(
    make_graph, tmp_path
):
    late = tmp_path / 'late.yaml'
    late.write_text('job_sequencer:\n  ros__parameters:\n    service_timeout: 1.0\n')
    with make_graph(params_files=(late,), hang_timeout=0.0) as bench:
        bench.load()
        recorder = bench.state().nodes['recorder'].pid
        os.kill(recorder, signal.SIGSTOP)
        try:
            result = bench.run_job(bench.goal(layers=1))
        finally:
            os.kill(recorder, signal.SIGCONT)
        assert result.error_code == RunJob.Result.NODE_LOST and 'recorder' in result.message
        folder = Path(result.job_dir)
        assert json.loads((folder / 'status.json').read_text())['state'] == 'FAILED'
        assert (folder / 'report.json').exists()
        record = folder / 'record'
        end = time.monotonic() + 60  # START and STOP wait in its queue: it begins, and ends
        while record.exists() and not check(record).sound and time.monotonic() < end:
            time.sleep(0.2)
        time.sleep(2.0)
        if record.exists():
            assert_closed(record)
        assert_another_job_starts(bench)


@pytest.mark.parametrize('how', [signal.SIGKILL])
def test_the_record_of_a_sequencer_that_was_killed_ends_by_itself(make_graph, background, how):
    with make_graph() as bench:
        bench.load()
        job = background(bench)
        seen: list[JobStatus] = []
        bench.client.node.create_subscription(JobStatus, 'job_status', seen.append, 10)
        bench.wait(lambda: seen and seen[-1].state == JobStatus.DEPOSITING, 120, 'a layer')
        folder = Path(seen[-1].job_dir)
        os.kill(bench.state().nodes['job_sequencer'].pid, how)
        bench.wait(lambda: not bench.client.machine.arc_on, 30, 'arc off')
        bench.wait(lambda: check(folder / 'record').sound, 60, 'the end of the record')
        assert_closed(folder / 'record')
        assert json.loads((folder / 'status.json').read_text())['state'] == 'INTERRUPTED'
        assert job.error
