"""Objects of files as dataclasses, and tables of options as parsers."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import pytest

from waam_process.cli_options import add_options, add_verb
from waam_process.rows import RowError, row_of


@dataclass(frozen=True)
class Row:
    id: int
    at: float
    left: float | None
    counts: dict[str, int]


def test_a_row_has_its_fields_and_their_types_or_is_refused():
    good = {'id': 1, 'at': 2, 'left': None, 'counts': {'a': 3}}
    assert row_of(Row, good) == Row(1, 2, None, {'a': 3})
    wrong = (
        {'id': True},
        {'at': float('inf')},
        {'at': None},
        {'left': 'x'},
        {'counts': {'a': 1.5}},
        {'more': 1},
    )
    for change in wrong:  # fmt: skip
        with pytest.raises(RowError, match=next(iter(change))):
            row_of(Row, good | change)
    with pytest.raises(RowError, match='object'):
        row_of(Row, [])


def test_the_default_of_an_option_says_what_it_is():
    parser = argparse.ArgumentParser()
    p = add_verb(parser.add_subparsers(), 'go', 'goes', ('--fast', False, 'a switch'))
    add_options(
        p, ('--file', Path, 'a file'), ('--note', [], 'more'), ('--at', (0.0, 1.0), 'two', ('X', 'Y')),
        ('--count --n', 3, 'times', None, {'choices': (3, 4)}),
    )  # fmt: skip
    args = parser.parse_args(['go'])
    assert (args.fast, args.file, args.note, args.at, args.count) == (
        False,
        None,
        [],
        (0.0, 1.0),
        3,
    )
    words = 'go --fast --file x --note a --note b --at 2 3 --n 4'
    args = parser.parse_args(words.split())
    assert (args.fast, args.file, args.note) == (True, Path('x'), ['a', 'b'])
    assert (args.at, args.count) == ([2.0, 3.0], 4)
