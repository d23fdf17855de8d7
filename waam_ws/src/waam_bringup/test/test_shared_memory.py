"""Segments of killed processes go, those of living ones stay."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from waam_bringup.shared_memory import clean

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
