"""What is taken away from a cell while STOP is asked for: one resource each, as a context manager of a `StopCell`.

Disks: the folder of the jobs is a tmpfs of its own when this runs as root, so that it can be filled, and covered by a
read-only copy. A slow or hung disk is a pipe in place of a file: to open it takes until somebody opens its other end.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

HERE = Path(__file__).parent
SLOW_S = 2.0  # that the slow disk takes to open a file
BUSY = 40  # processes
QUIET = dict.fromkeys(('stdin', 'stdout', 'stderr'), subprocess.DEVNULL)


@contextmanager
def nothing(cell) -> Iterator[None]:
    yield


@contextmanager
def programs(*commands: list[str]) -> Iterator[None]:
    """Processes, each in a session of its own, that are killed at the end."""
    running = [subprocess.Popen(c, start_new_session=True, **QUIET) for c in commands]
    try:
        time.sleep(0.5)
        yield
    finally:
        for process in running:
            process.kill()
        for process in running:
            process.wait()


def pour(kind: str):
    def load(cell):
        words = [sys.executable, str(HERE / 'stop_pour.py'), kind, str(cell.page), cell.csrf]
        return programs([*words, str(cell.second)] if kind == 'half_open' else words)

    return load


@contextmanager
def lock(path: Path) -> Iterator[None]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, 'a') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def held(name: str):
    return lambda cell: lock(cell.shop / name)


@contextmanager
def threads(cell) -> Iterator[None]:
    """Everything that reads files is asked for at once, while both locks are held."""
    with (
        lock(cell.shop / 'audit.jsonl.lock'),
        lock(cell.shop / 'queue.json.lock'),
        pour('lists')(cell),
    ):
        yield


@contextmanager
def instead(path: Path) -> Iterator[Path]:
    """Something else may lie there; in the end what was there before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = path.with_name(path.name + '.kept')
    if path.exists():
        path.rename(kept)
    try:
        yield path
    finally:
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        if kept.exists():
            kept.rename(path)


@contextmanager
def hung_disk(cell, slow: float = 0.0) -> Iterator[None]:
    over = threading.Event()

    def serve(file: Path) -> None:
        while not over.wait(slow or 0.2):
            if slow:
                with suppress(OSError):
                    os.close(os.open(file, os.O_RDWR | os.O_NONBLOCK))

    with ExitStack() as stack:
        for name in ('audit.jsonl', 'audit.head.new', 'queue.json'):
            file = stack.enter_context(instead(cell.shop / name))
            os.mkfifo(file)
            threading.Thread(target=serve, args=(file,), daemon=True).start()
        try:
            yield
        finally:
            over.set()
            for name in ('audit.jsonl', 'audit.head.new', 'queue.json'):
                # those that wait go on
                os.close(os.open(cell.shop / name, os.O_RDWR | os.O_NONBLOCK))


def slow_disk(cell):
    return hung_disk(cell, SLOW_S)


@contextmanager
def full_disk(cell) -> Iterator[None]:
    filler = cell.jobs / 'filler'
    try:
        with open(filler, 'wb') as f, suppress(OSError):
            while True:
                f.write(bytes(1 << 20))
                f.flush()
        yield
    finally:
        filler.unlink(missing_ok=True)


@contextmanager
def read_only_disk(cell) -> Iterator[None]:
    copy, shop = cell.folder / 'read_only', cell.jobs / '.shop'
    shutil.copytree(shop, copy, dirs_exist_ok=True)
    subprocess.run(['mount', '--bind', str(copy), str(shop)], check=True)
    try:
        subprocess.run(['mount', '-o', 'remount,bind,ro', str(shop)], check=True)
        yield
    finally:
        subprocess.run(['umount', '-l', str(shop)], check=True)


def hung(name: str):
    @contextmanager
    def load(cell) -> Iterator[None]:
        pid = cell.pid(name)
        os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(pid, signal.SIGCONT)

    return load


@contextmanager
def audit_broken(cell) -> Iterator[None]:
    with instead(cell.shop / 'audit.jsonl') as log, instead(cell.shop / 'audit.head') as head:
        log.mkdir()
        head.write_text('[' * 100_000)
        yield


@contextmanager
def queue_broken(cell) -> Iterator[None]:
    with instead(cell.shop / 'queue.json') as file:
        file.write_text('[' * 100_000)
        yield


def busy(cell):
    return programs(*[[sys.executable, '-c', 'while True: pass']] * BUSY)


LOADS = {
    'idle': nothing, 'bodies_of_strangers': pour('strangers'), 'bodies_of_operators': pour('operators'),
    'threads': threads, 'descriptors': pour('half_open'), 'panel_hung': hung('panel'),
    'audit_lock': held('audit.jsonl.lock'), 'queue_lock': held('queue.json.lock'), 'slow_disk': slow_disk,
    'hung_disk': hung_disk, 'full_disk': full_disk, 'read_only_disk': read_only_disk,
    'recorder_hung': hung('recorder'), 'audit_broken': audit_broken, 'queue_broken': queue_broken, 'busy': busy,
}  # fmt: skip
MOUNTS = ('full_disk', 'read_only_disk')  # only as root
