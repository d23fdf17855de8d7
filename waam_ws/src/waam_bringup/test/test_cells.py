"""Cells side by side: folders, domains and names apart; commands of the command line are in the audit log."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from waam_bringup import audited, panel, paths, shop
from waam_bringup.cli import build_parser, main
from waam_bringup.run_state import RunState
from waam_node.locks import locked
from waam_shop.shop_folder import Shop


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    for name in ('WAAM_CELL', 'WAAM_RUN', 'WAAM_SHOP', 'WAAM_CALIBRATIONS', 'ROS_DOMAIN_ID'):
        monkeypatch.setenv(name, '')  # so that what a test sets is taken back, too
        monkeypatch.delenv(name)
    monkeypatch.setenv('WAAM_JOBS', str(tmp_path / 'jobs'))
    return tmp_path


def up(name: str, domain: int, alive: bool = True) -> None:
    """As the supervisor of this cell would have written it."""
    Shop(paths.shop_dir()).audit(name).write('up', 'test', 'cli')
    with shop.cell(name):
        paths.run_dir().mkdir(parents=True)
        phase = 'up' if alive else 'down'
        RunState(os.getpid(), phase, domain, True, '').save(paths.run_dir())


def test_a_named_cell_has_folders_of_its_own_and_shares_the_shop(here, monkeypatch):
    first = paths.jobs_dir(), paths.run_dir(), paths.calibrations_dir()
    monkeypatch.setenv('WAAM_CELL', 'cell2')
    second = paths.jobs_dir(), paths.run_dir(), paths.calibrations_dir()
    assert first[0] == here / 'jobs' and second[0] == here / 'jobs/cells/cell2'
    assert not set(first) & set(second)
    assert paths.shop_dir() == here / 'jobs/.shop'
    monkeypatch.setenv('WAAM_CELL', '../cell')
    with pytest.raises(ValueError, match='name of a cell'):
        paths.jobs_dir()


def test_the_cell_of_one_command_is_not_that_of_the_next(here):
    assert main(['queue', 'list', '--name', 'cell2']) == 0
    assert main(['status', '--name', 'cell3', '--run', str(here / 'nothing')]) != 0
    assert 'WAAM_CELL' not in os.environ


def test_the_option_names_the_cell_for_everything_that_follows(capsys):
    for line in (
        'up --name cell2',
        'stop --name cell2',
        'job pause --cell cell2',
        'panel --name cell2',
    ):
        os.environ.pop('WAAM_CELL', None)
        build_parser().parse_args(line.split())
        assert os.environ['WAAM_CELL'] == 'cell2', line
    with pytest.raises(SystemExit):
        build_parser().parse_args(['up', '--name', 'Cell 2'])
    assert 'is no name of a cell' in capsys.readouterr().err


def test_no_two_cells_that_are_up_have_one_domain(here):
    up('cell', 7)
    up('cell2', 8)
    up('cell3', 9, alive=False)
    with shop.cell('cell4'):
        mine = paths.run_dir()
    assert shop.domain_of(mine, 7) == 9
    assert shop.domain_of(mine, 50) == 50
    up('cell5', 99)
    assert shop.domain_of(mine, 99) == 1


def test_a_part_goes_where_the_panel_of_its_cell_looks(here):
    part = here / 'jaw.stl'
    part.write_bytes(b'solid')
    assert shop.store_part('cell2', part) == 'jaw.stl'
    assert (here / 'jobs/cells/cell2/parts/jaw.stl').read_bytes() == b'solid'
    checked = shop.check_setup({'part': 'jaw.stl', 'layers': 3})
    assert checked['material'] and checked['layers'] == 3
    with pytest.raises(ValueError, match='tolerance_mm'):
        shop.check_setup({'part': 'jaw.stl', 'tolerance_mm': 99.0})


def test_commands_are_in_the_log_before_they_fail_and_questions_are_not(here, capsys):
    assert main(['job', 'pause', '--cell', 'cell2']) == 2
    assert main(['queue', 'release', '3', '--name', 'cell2']) == 2
    assert main(['queue', 'list', '--name', 'cell2']) == 0
    entries = Shop(paths.shop_dir()).audit('cell2').last(9)
    assert [(e.what, e.data) for e in entries] == [('job pause', {}), ('queue release', {'id': 3})]
    assert all(e.who.startswith('cli:') for e in entries)


ONLY_LOOK = {  # or write files of their own, on no cell and in no shop
    'status', 'plan', 'scan', 'train', 'correct', 'lab', 'lab fit', 'view', 'report', 'robot', 'audit', 'cells', 'jobs',
    'queue list', 'token list', 'notify list', 'calibrate status', 'replay tune', 'replay check',
    'cell new', 'cell check', 'cell show', 'cell diff', 'ports', 'forecast', 'completion', 'job status',
    'record status', 'record info', 'record check', 'record recover',
    'record import',
}  # fmt: skip


def verbs_of(
    parser: argparse.ArgumentParser, so_far: tuple[str, ...] = ()
) -> Iterator[tuple[str, ...]]:
    """Words of every command, down to its last sub-verb."""
    below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not below:
        yield so_far
    for name, sub in (pair for a in below for pair in a.choices.items()):
        yield from verbs_of(sub, (*so_far, name))


def test_every_verb_is_in_the_log_or_known_to_command_nothing():
    """A new verb must be put into one of both."""
    for command, *verb in verbs_of(build_parser()):
        words = ' '.join((command, *verb))
        looks = words in ONLY_LOOK or (command in ONLY_LOOK and words != 'jobs delete')
        assert audited.is_command(command, ' '.join(verb)) != looks, words


def test_the_name_of_the_sub_verb_is_in_the_log_and_a_page_is_a_command_when_it_is_opened(here):
    parse = build_parser().parse_args
    for line in (
        'record stop', 'replay play x --force', 'calibrate status', 'calibrate apply', 'panel', 'panel --port 8700',
        'jobs list', 'jobs delete x --yes',
    ):  # fmt: skip
        audited.record(parse(line.split()))
    found = [(e.what, e.data) for e in Shop(paths.shop_dir()).audit('cell').last(9)]
    commands = ['record stop', 'replay play', 'calibrate apply', 'panel', 'jobs delete']
    assert [what for what, _ in found] == commands
    assert found[1][1]['force'] is True and found[3][1]['port'] == 8700
    assert found[4][1]['names'] == "['x']"


SAFE = [line.split() for line in ('stop', 'job abort', 'job pause')]


def carried_out(words: list[str], done: list) -> int:
    args = build_parser().parse_args(words)
    args.run_command = lambda _: done.append(words) or 0
    return audited.carry_out(args)


def test_without_the_log_only_what_makes_safe_is_done(monkeypatch, capsys):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('waam_shop.audit_file.AuditLog.write', full)
    done: list = []
    for words in SAFE:
        assert carried_out(words, done) == 0
        assert 'not in the audit log' in capsys.readouterr().err
    with pytest.raises(ValueError, match='No space left'):
        carried_out(['queue', 'release', '1'], done)
    assert done == SAFE


@pytest.mark.parametrize('words', SAFE, ids=' '.join)
def test_what_makes_safe_is_done_before_its_entry_and_says_who_holds_the_log(here, capsys, words):
    """A `waam audit` that was suspended has the lock."""
    log = Shop(paths.shop_dir()).audit('cell')
    done: list = []
    with locked(log.path.with_name('audit.jsonl.lock')):
        assert carried_out(words, done) == 0
    assert done == [words]
    said = capsys.readouterr().err
    assert f'held for more than 2 s by process {os.getpid()}' in said
    assert carried_out(words, done) == 0 and capsys.readouterr().err == ''
    assert [(e.what, e.outcome) for e in log.last(2)] == [(' '.join(words), 'ok')]


def test_what_was_refused_is_in_the_log_as_refused(here):
    args = build_parser().parse_args(['job', 'abort'])

    def refuse(_):
        raise ValueError('no job is running')

    args.run_command = refuse
    with pytest.raises(ValueError, match='no job'):
        audited.carry_out(args)
    entry = Shop(paths.shop_dir()).audit('cell').last(1)[0]
    assert (entry.what, entry.outcome, entry.note) == ('job abort', 'refused', 'no job is running')


def test_a_page_for_others_without_tokens_or_tls_is_refused_clearly(here):
    def panel(*options: str) -> str:
        command = [sys.executable, '-m', 'waam_bringup.cli', 'panel', '--bind', '0.0.0.0', *options]
        ran = subprocess.run(command, capture_output=True, text=True)
        assert ran.returncode == 2
        return ran.stderr

    assert "needs 'token_file' (waam token create) and 'tls_cert' with 'tls_key'" in panel()
    main(['token', 'create', 'tablet', '--role', 'view'])
    assert "needs 'tls_cert' and 'tls_key'" in panel()


def test_a_page_of_its_own_brings_a_second_way_for_stop_with_its_rules(monkeypatch, tmp_path):
    from waam_panel.stop_lane import arguments

    started: list[list[str]] = []
    monkeypatch.setattr('subprocess.Popen', lambda words, **_: started.append(words))
    words = [
        'panel',
        '--bind',
        '0.0.0.0',
        '--port',
        '8700',
        '--host',
        'a.local',
        '--host',
        'b.local',
    ]
    access = {'token_file': '/t', 'tls_cert': '/c', 'tls_key': '/k'}
    panel._start_lane(build_parser().parse_args(words), tmp_path / 'stop', 8700, 8701, access)
    ((program, *told),) = started
    lane = arguments().parse_args(told)
    assert program.endswith('/stop_lane') and lane.socket == str(tmp_path / 'stop')
    assert (lane.port, lane.page_port) == (8701, 8700)
    assert (lane.bind, lane.hosts) == ('0.0.0.0', 'a.local,b.local')
    assert (lane.token_file, lane.tls_cert, lane.tls_key) == ('/t', '/c', '/k')
    assert lane.ends_with == os.getpid()
