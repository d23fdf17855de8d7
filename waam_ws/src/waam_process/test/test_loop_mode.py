"""What was written before the loop mode had its name is read all the same, and the old option works and says so."""

from __future__ import annotations

import argparse

import pytest

from waam_process.cli_renamed import keep_old_name
from waam_process.loop_mode import LOOP_MODES, with_loop_mode


@pytest.mark.parametrize(
    'stored,read',
    [
        ({'profile': 'monitor', 'layer': 2}, {'loop_mode': 'monitor', 'layer': 2}),
        ({'loop_mode': 'monitor'}, {'loop_mode': 'monitor'}),
        ({'loop_mode': 'monitor', 'profile': 'a note of the user'}, {'loop_mode': 'monitor'}),
        ({}, {}),
    ],
)
def test_fields_of_before_are_read_by_their_new_name(stored, read):
    before = dict(stored)
    assert with_loop_mode(stored) == read
    assert stored == before


@pytest.fixture
def parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser()
    keep_old_name(p, '--profile', p.add_argument('--loop-mode', choices=LOOP_MODES))
    modes = p.add_argument('--loop-modes', nargs='+', default=['open_loop'], choices=LOOP_MODES)
    keep_old_name(p, '--profiles', modes)
    return p


def test_an_option_is_taken_by_its_old_name_and_says_so(parser, capsys):
    args = parser.parse_args(['--profile', 'monitor', '--profiles', 'monitor', 'closed_loop'])
    assert args.loop_mode == 'monitor' and args.loop_modes == ['monitor', 'closed_loop']
    said = capsys.readouterr().err.splitlines()
    assert said == ['--profile is now called --loop-mode', '--profiles is now called --loop-modes']


def test_the_old_name_is_not_shown_and_changes_nothing_when_it_is_not_used(parser, capsys):
    args = parser.parse_args(['--loop-mode', 'monitor'])
    assert (args.loop_mode, args.loop_modes) == ('monitor', ['open_loop'])
    assert 'profile' not in parser.format_help() and not capsys.readouterr().err


def test_the_old_name_takes_the_same_values_only(parser, capsys):
    with pytest.raises(SystemExit):
        parser.parse_args(['--profile', 'loop'])
    assert 'closed_loop' in capsys.readouterr().err
