"""Work spread over workers: kept results, lost workers."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from waam_lab import LabResult, many, over_seeds, restore, run_many
from waam_lab.pieces import Pieces
from waam_node import spread as spreading

TOLD = {'verdict': 'in tolerance', 'error_code': 0, 'message': ''}


def killed_once(job) -> LabResult:
    """The worker that begins seed 3 first dies at once."""
    flag = Path(os.environ['WAAM_TEST_FLAG'])
    if job.seed == 3 and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return LabResult(job.seed, **TOLD, rms=job.seed * 1e-4)


def killed_late(job) -> LabResult:
    """Seed 1 kills its worker, once, when seed 2 is under way and has noted it; each beginning is noted."""
    folder = Path(os.environ['WAAM_TEST_FLAG']).parent
    with open(folder / 'begun', 'a') as begun:
        begun.write(f'{job.seed} ')
    flag = folder / 'flag'
    while job.seed == 1 and not flag.exists():
        if '2' in (folder / 'begun').read_text():
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.01)
    while job.seed == 2 and (folder / 'begun').read_text().count('1') < 2:
        time.sleep(0.01)  # until the other one has been begun again
    return LabResult(job.seed, **TOLD, rms=job.seed * 1e-4)


def poison(job) -> LabResult:
    """Seed 2 kills every worker that takes it."""
    if job.seed == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return LabResult(job.seed, **TOLD, rms=job.seed * 1e-4)


def killed_always(job) -> LabResult:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError('not reached')


def first(job) -> LabResult:
    return LabResult(job.seed, **TOLD, rms=0.1e-3)


def second(job) -> LabResult:
    return LabResult(job.seed, **TOLD, rms=0.2e-3)


@pytest.fixture
def light(monkeypatch, tmp_path):
    """Workers that load little; light(attempt) puts that function in the place of a job."""
    import multiprocessing

    monkeypatch.setenv('WAAM_TEST_FLAG', str(tmp_path / 'flag'))
    monkeypatch.setattr(spreading, 'context', lambda _: multiprocessing.get_context('fork'))
    return lambda attempt: monkeypatch.setattr(many, 'attempt', attempt)


def test_a_killed_worker_costs_its_job_only(parts, light):
    light(killed_once)
    told: list[int] = []
    jobs = over_seeds(restore(*parts), range(1, 7))
    found = run_many(jobs, 2, lambda r: told.append(r.seed))
    assert [r.seed for r in found] == [1, 2, 3, 4, 5, 6]
    assert sorted(told) == [1, 2, 3, 4, 5, 6]
    assert not any(r.failed for r in found)


def test_what_the_others_do_goes_on(parts, light, tmp_path):
    light(killed_late)
    found = run_many(over_seeds(restore(*parts), [1, 2]), 2)
    assert not any(r.failed for r in found)
    assert sorted((tmp_path / 'begun').read_text().split()) == ['1', '1', '2']


def test_a_job_that_kills_its_workers_costs_itself_only(parts, light):
    light(poison)
    found = run_many(over_seeds(restore(*parts), range(1, 6)), 2)
    assert [r.failed for r in found] == [False, True, False, False, False]


def test_workers_that_always_die_end_as_failed_jobs(parts, light):
    light(killed_always)
    found = run_many(over_seeds(restore(*parts), [1, 2]), 2)
    assert [r.failed for r in found] == [True, True]


def test_a_campaign_goes_on_where_it_was(parts, light, tmp_path):
    light(first)
    jobs = over_seeds(restore(*parts), [1, 2, 3])
    run_many(jobs[:2], 1, pieces=Pieces(tmp_path / 'pieces', 'a'))
    light(second)
    again = run_many(jobs, 1, pieces=Pieces(tmp_path / 'pieces', 'a'))
    assert [r.rms for r in again] == [0.1e-3, 0.1e-3, 0.2e-3]
    other = run_many(jobs, 1, pieces=Pieces(tmp_path / 'pieces', 'b'))
    assert [r.rms for r in other] == [0.2e-3] * 3  # of another software


def test_a_torn_piece_or_another_job_is_run_again(parts, tmp_path):
    pieces, job = Pieces(tmp_path / 'pieces', 'a'), restore(*parts)
    pieces.write(job, LabResult(1, **TOLD))
    (file,) = (tmp_path / 'pieces').iterdir()
    whole = file.read_bytes()
    assert pieces.read(job) is not None
    assert pieces.read(replace(job, overrides={'cell': {'metal_transfer': 0.88}})) is None
    for size in range(len(whole)):
        file.write_bytes(whole[:size])
        assert pieces.read(job) is None, size
    pieces.clear()
    assert pieces.read(job) is None
