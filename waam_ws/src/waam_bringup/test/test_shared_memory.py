"""Segments of killed processes go, those of living ones stay."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from waam_bringup.shared_memory import MAX_HELD, HeldPorts, clean, ports_of

HOLD = (
    'import fcntl, sys, time; f = open(sys.argv[1], "w"); fcntl.flock(f, fcntl.LOCK_EX); '
    'print("held", flush=True); time.sleep(600)'
)


def segment(place: Path, number: int, size: int = 1000, age: float = 100.0) -> Path:
    file = place / f'fastrtps_{number:016x}'
    file.write_bytes(bytes(size))
    file.with_name(f'{file.name}_el').touch()
    moment = file.stat().st_mtime - age
    os.utime(file, (moment, moment))
    return file


@pytest.fixture
def owner(tmp_path):
    """Keeps the lock of segment 1 as a living node does."""
    file = segment(tmp_path, 1)
    child = subprocess.Popen(
        [sys.executable, '-c', HOLD, f'{file}_el'], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout.readline() == 'held\n'
    yield child
    child.kill()
    child.wait()
    child.stdout.close()


def test_segment_goes_when_its_owner_was_killed(tmp_path, owner):
    left = segment(tmp_path, 2, 500)
    assert clean(tmp_path) == 500 and not left.exists()
    assert (tmp_path / f'fastrtps_{1:016x}').exists()
    owner.kill()
    owner.wait()
    assert clean(tmp_path) == 1000 and not list(tmp_path.iterdir())


def test_what_is_young_or_no_segment_stays(tmp_path):
    names = ('fastrtps_port7411', 'fastrtps_other', 'sem.other')
    kept = [segment(tmp_path, 3, age=0.0), *(tmp_path / n for n in names)]
    for file in kept[1:]:
        file.touch()
    assert clean(tmp_path) == 0 and all(f.exists() for f in kept)


def test_a_lock_held_here_counts_and_a_machine_without_the_place_is_fine(tmp_path):
    file = segment(tmp_path, 4)
    with open(f'{file}_el') as mark:
        fcntl.flock(mark, fcntl.LOCK_EX)
        assert clean(tmp_path) == 0
    assert clean(tmp_path / 'nowhere') == 0


def port(place: Path, number: int, *marks: str) -> list[Path]:
    """A port a hundred seconds old, its semaphore, and the files that its listeners lock."""
    name = f'fastrtps_port{number}'
    files = [place / n for n in (name, f'sem.{name}_mutex', *(name + m for m in marks))]
    for file in files:
        file.write_bytes(bytes(100))
        os.utime(file, (file.stat().st_mtime - 100,) * 2)
    return files


@pytest.mark.parametrize(('mark', 'kind'), [('_el', fcntl.LOCK_EX), ('_sl', fcntl.LOCK_SH)])
def test_port_stays_as_long_as_somebody_listens(tmp_path, mark, kind):
    files = port(tmp_path, 7411, mark)
    with open(files[-1]) as lock:
        fcntl.flock(lock, kind)
        assert clean(tmp_path) == 0 and all(f.exists() for f in files)
    assert clean(tmp_path) == 100 and not list(tmp_path.iterdir())


def test_port_that_nobody_ever_locked_goes_and_a_young_one_stays(tmp_path):
    files = port(tmp_path, 7413)
    os.utime(files[0])
    assert clean(tmp_path) == 0 and all(f.exists() for f in files)
    assert clean(tmp_path, young=0.0) == 100 and not list(tmp_path.iterdir())


def port_lock(place: Path, number: int) -> Path:
    file = place / f'fastrtps_port{number}_el'
    file.touch()
    return file


def taken(lock: Path) -> bool:
    with lock.open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def test_ports_of_a_process_are_those_that_it_has_open(tmp_path):
    lock = port_lock(tmp_path, 7002)
    command = [sys.executable, '-c', HOLD, str(lock)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == 'held\n'
        assert ports_of(child.pid) == [lock]
        child.kill()
    assert ports_of(child.pid) == []


def test_ports_of_the_dead_are_held_and_not_cleaned_away(tmp_path):
    (tmp_path / 'fastrtps_port7002').touch()
    lock, held = port_lock(tmp_path, 7002), HeldPorts()
    held.hold([lock, tmp_path / 'fastrtps_port7003_el'])
    assert taken(lock)
    assert clean(tmp_path, young=-1.0) == 0 and lock.exists()
    held.close()
    assert not taken(lock)


def test_only_the_newest_dead_are_held(tmp_path):
    locks, held = [port_lock(tmp_path, 7000 + i) for i in range(MAX_HELD + 2)], HeldPorts()
    for lock in locks:
        held.hold([lock])
    assert [taken(lock) for lock in locks] == [False] * 2 + [True] * MAX_HELD
    held.close()
