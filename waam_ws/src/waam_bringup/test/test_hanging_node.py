"""A node that hangs between jobs is started again; during a job nothing is. Real processes, stopped with SIGSTOP."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from waam_bringup import run_state
from waam_bringup.client import GraphClient
from waam_bringup.graph import Settings, processes
from waam_bringup.shared_memory import ports_of
from waam_bringup.supervisor import HANGS_S, MAX_RESTARTS, Supervisor
from waam_bringup.watchdog import SLEPT_S, Watchdog
from waam_node import restart
from waam_node.alive import SignOfLife
from waam_node.testing import fresh_domain

HANG_S = 3.0
NODES = {'recorder': {'package': 'waam_record'}, 'feed_forward': {'package': 'waam_adapt'}}


@pytest.fixture
def supervisor(tmp_path) -> Iterator[Supervisor]:
    """Two real nodes under a supervisor, both heard."""
    made = Supervisor(Settings(run=tmp_path, hang_timeout=HANG_S), fresh_domain(), NODES)
    made.start()
    try:
        turn_until(made, lambda: all_heard(made), 60)
        yield made
    finally:
        for child in made.children.values():
            os.kill(child.pid, signal.SIGCONT)
        made.stop()


def test_nothing_is_left_running_when_the_folder_of_the_graph_is_gone(tmp_path, capfd):
    made = Supervisor(
        Settings(run=tmp_path / 'run'), fresh_domain(), {'feed_forward': NODES['feed_forward']}
    )
    made.start()
    shutil.rmtree(tmp_path / 'run')
    made.stop()
    assert all(child.poll() is not None for child in made.children.values())
    assert 'state.json: No such file' in capfd.readouterr().err


def all_heard(s: Supervisor) -> bool:
    return all(s.watchdog.last_heard(c.pid) is not None for c in s.children.values())


def turn_until(s: Supervisor, condition: Callable[[], bool], timeout: float) -> bool:
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        s.look()
        if condition():
            return True
        time.sleep(0.1)
    return False


def set_job(run: Path, state: str) -> None:
    (run / 'a_job').mkdir(exist_ok=True)
    (run / 'a_job' / 'status.json').write_text(json.dumps({'state': state}))
    (run / 'job').write_text(str(run / 'a_job'))


def test_a_node_that_hangs_between_jobs_is_started_again_and_says_why(supervisor, tmp_path):
    set_job(tmp_path, 'DONE')
    before = {n: c.pid for n, c in supervisor.children.items()}
    ports = set(ports_of(before['recorder']))
    assert ports
    os.kill(before['recorder'], signal.SIGSTOP)
    recorder = supervisor.state.nodes['recorder']
    assert turn_until(supervisor, lambda: recorder.restarts == 1, 5 * HANG_S)
    assert not run_state.process_exists(before['recorder'])
    assert turn_until(supervisor, lambda: all_heard(supervisor), 30)
    # others may go on writing into the memory of the dead one's
    assert not ports & set(ports_of(recorder.pid))
    assert supervisor.children['feed_forward'].pid == before['feed_forward']
    saved = run_state.load(tmp_path)
    assert saved.nodes['recorder'].pid == recorder.pid != before['recorder']
    assert 'recorder gave no sign of life' in saved.nodes['recorder'].reason == saved.message

    said: list[str] = []
    with GraphClient(supervisor.state.domain) as client:
        client.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda m: said.extend(reasons(m)), 10
        )
        assert turn_until(
            supervisor, lambda: client.executor.spin_once(timeout_sec=0.1) or said, 30
        )
    assert said[0] == recorder.reason and recorder.restarts == 1


def reasons(message: DiagnosticArray) -> list[str]:
    rows = [s for s in message.status if s.hardware_id == 'recorder']
    return [v.value for s in rows for v in s.values if v.key == 'restarted']


def test_the_second_way_for_stop_is_started_again_beside_a_job(tmp_path):
    """It holds no state; without it the page has one way less for STOP."""
    lane = {'package': 'waam_panel', 'executable': 'stop_lane', 'ros': False, 'restart': 'always'}
    lane['arguments'] = ['--socket', '${run}/stop', '--port', '${stop_port}', '--page-port', '1']
    with socket.create_server(('127.0.0.1', 0)) as s:
        port = s.getsockname()[1]
    settings = Settings(run=tmp_path, stop_port=port)
    made = Supervisor(settings, fresh_domain(), {'stop_lane': lane})
    made.start()
    try:
        set_job(tmp_path, 'DEPOSITING')
        state = made.state.nodes['stop_lane']
        for times in (1, 2):
            before = made.children['stop_lane'].pid
            os.kill(before, signal.SIGKILL)
            assert turn_until(made, lambda n=times: state.restarts == n, 20.0)
            assert run_state.process_exists(state.pid) and state.pid != before
        assert 'stop_lane killed by SIGKILL' in run_state.load(tmp_path).nodes['stop_lane'].reason
    finally:
        made.stop()


def test_during_a_job_nothing_is_started_again_but_after_it(supervisor, tmp_path):
    set_job(tmp_path, 'DEPOSITING')
    pid = supervisor.children['recorder'].pid
    os.kill(pid, signal.SIGSTOP)
    recorder = supervisor.state.nodes['recorder']
    assert not turn_until(supervisor, lambda: recorder.restarts > 0, 2.5 * HANG_S)
    assert supervisor.children['recorder'].pid == pid and run_state.process_exists(pid)
    set_job(tmp_path, 'FAILED')
    assert turn_until(supervisor, lambda: recorder.restarts == 1, 5.0)


def test_of_several_that_are_silent_one_is_started_again_and_the_others_get_their_time(
    supervisor, tmp_path
):
    """They may wait for what the first one holds."""
    before = {n: c.pid for n, c in supervisor.children.items()}
    for pid in before.values():
        os.kill(pid, signal.SIGSTOP)
    time.sleep(HANG_S + 1.0)
    supervisor.look()
    restarted = [n for n, state in supervisor.state.nodes.items() if state.restarts]
    assert len(restarted) == 1
    waiting = next(n for n in before if n not in restarted)
    os.kill(before[waiting], signal.SIGCONT)
    assert not turn_until(
        supervisor, lambda: supervisor.state.nodes[waiting].restarts > 0, 1.5 * HANG_S
    )
    # the stopped process went on for long enough to say where it stood
    assert 'most recent call first' in (tmp_path / 'logs' / f'{restarted[0]}.log').read_text()


def test_one_that_hangs_again_and_again_is_left_to_a_person(supervisor):
    recorder = supervisor.state.nodes['recorder']
    recorder.restarts = MAX_RESTARTS
    os.kill(recorder.pid, signal.SIGSTOP)
    assert not turn_until(supervisor, lambda: recorder.restarts > MAX_RESTARTS, 2 * HANG_S)


def test_where_a_hanging_node_stood_is_in_its_log(supervisor, tmp_path):
    """A process that still takes signals writes where its threads are before it is ended."""
    os.kill(supervisor.children['recorder'].pid, signal.SIGUSR1)
    log = tmp_path / 'logs' / 'recorder.log'
    assert turn_until(supervisor, lambda: 'Current thread' in log.read_text(), 10)
    assert supervisor.state.nodes['recorder'].exit_code is None


def test_a_person_has_what_died_or_hangs_started_again_in_a_job_too(supervisor, tmp_path):
    set_job(tmp_path, 'DEPOSITING')
    dead, hangs = supervisor.state.nodes['recorder'], supervisor.state.nodes['feed_forward']
    turn_until(supervisor, lambda: set(supervisor._ports) == {'recorder', 'feed_forward'}, 10)
    ports = set(supervisor._ports['recorder'])
    os.kill(dead.pid, signal.SIGKILL)
    os.kill(hangs.pid, signal.SIGSTOP)
    turn_until(supervisor, lambda: False, HANGS_S + 1.5)
    assert dead.exit_code == -signal.SIGKILL and not dead.restarts + hangs.restarts
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(restart.ask, tmp_path)
        assert turn_until(supervisor, asked.done, 30)
    started = asked.result()
    assert len(started) == 2 and 'recorder (killed by SIGKILL)' in started
    assert 'feed_forward (gave no sign of life for' in started[1]
    assert turn_until(supervisor, lambda: all_heard(supervisor), 30)
    assert dead.exit_code is None and (dead.restarts, hangs.restarts) == (1, 1)
    assert ports and not ports & set(ports_of(dead.pid))
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(restart.ask, tmp_path)
        assert turn_until(supervisor, asked.done, 30) and asked.result() == []


def test_without_a_supervisor_a_request_is_not_left_behind(tmp_path):
    with pytest.raises(restart.NoSupervisor, match='no supervisor takes the request'):
        restart.ask(tmp_path, taken_s=0.2)
    assert restart.take(tmp_path) is None
    with pytest.raises(restart.NoSupervisor, match='no graph'):
        restart.ask(tmp_path / 'gone')


def test_a_hanging_job_sequencer_that_is_started_again_leaves_its_job_interrupted(tmp_path):
    nodes = {'job_sequencer': {'package': 'waam_job'}}
    made = Supervisor(Settings(run=tmp_path, hang_timeout=HANG_S), fresh_domain(), nodes)
    made.start()
    try:
        assert turn_until(made, lambda: all_heard(made), 60)
        set_job(tmp_path, 'DEPOSITING')
        os.kill(made.children['job_sequencer'].pid, signal.SIGSTOP)
        turn_until(made, lambda: False, HANGS_S + 1.5)
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(restart.ask, tmp_path)
            assert turn_until(made, asked.done, 30) and len(asked.result()) == 1
        told = json.loads((tmp_path / 'a_job' / 'status.json').read_text())
        assert (
            told['state'] == 'INTERRUPTED'
            and 'job_sequencer gave no sign of life' in told['message']
        )
    finally:
        made.stop()


def test_the_simulated_cell_and_the_controller_are_never_started_again(tmp_path):
    restarted = {p.name for p in processes(Settings(run=tmp_path)) if p.restart}
    assert {'recorder', 'bridge', 'job_sequencer', 'panel'} <= restarted
    assert not restarted & {'cell', 'virtual_controller'}


def test_silence_counts_from_the_first_sign_and_not_over_a_pause_of_the_machine():
    watchdog, pid = Watchdog(timeout=2.0), os.getpid()
    sign = SignOfLife(watchdog.address)
    watchdog.watch(pid)
    now = time.monotonic()
    assert watchdog.silent(now + 4) == {}  # it still starts
    sign.give()
    assert watchdog.silent(now + 5) == {}
    assert watchdog.silent(now + 6) == {}
    assert watchdog.silent(now + 8) == {pid: 3.0}
    assert watchdog.silent(now + 9 + SLEPT_S) == {}  # nobody looked: nobody is judged
    watchdog.forget(pid)
    assert watchdog.silent(now + 12 + SLEPT_S) == {}
    sign.close()
    watchdog.close()


def test_a_sign_of_life_never_waits_and_never_fails():
    for address in ('', '@nobody-listens', '/nowhere/socket'):
        sign = SignOfLife(address)
        sign.give()
        sign.close()
    watchdog = Watchdog(1.0)
    sign = SignOfLife(watchdog.address)
    began = time.monotonic()
    for _ in range(5000):  # far more than the queue of the socket holds
        sign.give()
    assert time.monotonic() - began < 2.0
    sign.close()
    watchdog.close()
