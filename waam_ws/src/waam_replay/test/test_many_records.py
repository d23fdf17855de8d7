"""Many records computed again: results that do not depend on the number of workers, kept, and resumed."""

import argparse
import json
import os
import shutil
import signal

import pytest

from waam_node import spread as spreading
from waam_node.spread import Workers
from waam_replay import cli, many
from waam_replay.many import jobs_in, replay_all, same

FAST = {'digest': 'a', 'maps': [1], 'identical': {'maps': [1, 1]}}


@pytest.fixture
def jobs(job, tmp_path):
    """A folder of three records (one of them cut off) and of something else."""
    folder = tmp_path / 'jobs'
    for name in ('a', 'b', 'cut'):
        shutil.copytree(job / 'record', folder / name / 'record')
    for file in (folder / 'cut' / 'record').glob('*.mcap'):
        file.write_bytes(b'')
    (folder / 'archive').mkdir()
    return folder


@pytest.fixture
def forked(monkeypatch):
    """Workers that have loaded what the test has."""
    import multiprocessing

    monkeypatch.setattr(spreading, 'context', lambda _: multiprocessing.get_context('fork'))


def test_workers_give_what_one_gives_and_a_damaged_record_costs_itself(jobs, tmp_path, forked):
    listed = jobs_in([jobs])
    assert [j.name for j in listed] == ['a', 'b', 'cut']
    settings = ['correction_server.gain=0.6']
    one, two = (
        replay_all(listed, settings, tmp_path / f'out{n}', 'v1', Workers(n)) for n in (1, 2)
    )
    digests = [[found.get('digest') for found in each.values()] for each in (one, two)]
    assert digests[0] == digests[1]
    assert digests[0][0] == digests[0][1] and digests[0][0]
    assert list(one) == listed and not same(one[listed[0]])
    assert 'error' in one[listed[2]]


def die_once(piece):
    flag = piece.kept.parent / 'flag'
    if piece.job.name == 'b' and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return FAST | {'record': piece.job.name}


def test_a_killed_worker_loses_nothing(jobs, tmp_path, forked, monkeypatch):
    monkeypatch.setattr(many, 'attempt', die_once)
    told = []
    found = replay_all(
        jobs_in([jobs]), [], tmp_path / 'out', 'v1', Workers(2), lambda job, f: told.append(job)
    )
    assert [f['record'] for f in found.values()] == ['a', 'b', 'cut']
    assert len(told) == 3
    assert (tmp_path / 'out' / 'flag').exists()


def count(piece):
    with open(piece.kept.parent.parent / 'counted', 'a') as f:
        f.write(piece.job.name + ' ')
    return FAST


def test_only_what_is_not_done_is_computed_again(jobs, tmp_path, forked, monkeypatch):
    listed, out = jobs_in([jobs]), tmp_path / 'out'
    counted = tmp_path / 'counted'

    def computed(*asked, version='v1', settings=()):
        counted.write_text('')
        replay_all(list(asked), list(settings), out, version, Workers(1))
        return counted.read_text().split()

    monkeypatch.setattr(many, 'attempt', count)
    assert computed(*listed[:2]) == ['a', 'b']
    assert computed(*listed) == ['cut']
    assert computed(*listed, settings=['correction_server.gain=0.6']) == ['a', 'b', 'cut']
    assert computed(*listed, version='v2') == ['a', 'b', 'cut']
    os.utime(next((listed[0] / 'record').glob('*.mcap')), ns=(1, 1))
    torn = next(out.glob('b-*.json'))
    torn.write_bytes(torn.read_bytes()[:30])
    assert computed(*listed, version='v2') == ['a', 'b']


def test_the_command_tells_what_differs(jobs, tmp_path, capsys, forked, monkeypatch):
    def run(argv):
        parser = argparse.ArgumentParser()
        cli.register(parser.add_subparsers())
        args = parser.parse_args(['replay', *argv])
        return args.run_command(args)

    monkeypatch.chdir(tmp_path)
    assert run(['check', str(jobs), '--workers', '1', '-o', 'out']) == 1
    out = capsys.readouterr().out
    assert '3 records: 2 identical, 0 different, 1 errors' in out
    assert 'error: cut' in out
    kept = json.loads((tmp_path / 'out' / 'check.json').read_text())
    assert sorted(len(f.get('maps', [])) for f in kept.values()) == [0, 3, 3]
    assert run(['check', str(jobs / 'a'), str(jobs / 'b'), '-o', 'out']) == 0
    assert run(['tune', str(jobs), '--set', 'nobody.x=1']) == 1
    assert "unknown node 'nobody'" in capsys.readouterr().err
    assert run(['check', str(jobs / 'archive')]) == 1
    assert 'no recorded job' in capsys.readouterr().err
