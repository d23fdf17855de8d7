"""Locks that nobody waits for without an end."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time

import pytest

from waam_node.locks import locked

HOLD = (
    'import sys; from pathlib import Path; from waam_node.locks import locked\n'
    'with locked(Path(sys.argv[1])):\n'
    '    print("held", flush=True); sys.stdin.read()\n'
)


@pytest.fixture
def holder(tmp_path):
    """Another process that has the lock until it is told."""
    path = tmp_path / 'folder' / 'x.lock'
    process = subprocess.Popen(
        [sys.executable, '-c', HOLD, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == 'held\n'
    yield path, process
    process.stdin.close()
    process.wait(20)
    process.stdout.close()


def test_a_lock_that_stays_held_is_an_error_that_names_file_and_holder(holder):
    path, process = holder
    began = time.monotonic()
    with pytest.raises(OSError) as e, locked(path, 0.3):
        pass
    assert time.monotonic() - began >= 0.3
    assert e.value.errno == errno.EBUSY and e.value.filename == str(path)
    assert f'process {process.pid}' in e.value.strerror and '0.3 s' in e.value.strerror


def test_it_is_taken_as_soon_as_it_is_free_and_also_after_a_kill(holder):
    path, process = holder
    threading.Timer(0.3, process.kill).start()
    with locked(path, 20.0):
        pass


def test_threads_exclude_each_other_and_every_one_gets_its_turn(tmp_path):
    path, inside, most = tmp_path / 'x.lock', [], []

    def work() -> None:
        for _ in range(20):
            with locked(path, 60.0):
                inside.append(1)
                most.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=work) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(most) == 120 and max(most) == 1


def test_nothing_is_left_open(tmp_path):
    before = len(os.listdir('/proc/self/fd'))
    with locked(tmp_path / 'x.lock'):
        for _ in range(5):
            with pytest.raises(OSError), locked(tmp_path / 'x.lock', 0.0):
                pass
    assert len(os.listdir('/proc/self/fd')) == before
