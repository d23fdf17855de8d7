"""Options of a command line as tables, one row an option. Light: every call of `waam` loads it."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import Any

Verbs = Any  # what `add_subparsers` gives
Options = tuple[tuple[Any, ...], ...]  # a table


def add_options(p: argparse._ActionsContainer, *rows: tuple[Any, ...]) -> None:
    """A row: names (blanks between them), default, help; then, if wanted, the word for the value, and a dict of further
    settings of argparse. The default says what it is: False = a switch; a type = nothing unless it is given; [] = may
    be repeated; a tuple = so many values; anything else = one value of its type."""
    for names, default, text, *more in rows:
        further = more.pop() if more and isinstance(more[-1], dict) else {}
        settings: dict[str, Any] = {'default': default, 'type': type(default)}
        if default is False:
            settings = {'action': 'store_true'}
        elif isinstance(default, type):
            settings = {'type': default}
        elif default == []:
            settings = {'action': 'append', 'default': []}
        elif isinstance(default, tuple):
            settings = {'nargs': len(default), 'type': type(default[0]), 'default': default}
        if more:
            settings['metavar'] = more[0]
        p.add_argument(*names.split(), help=text, **settings | further)


def add_verb(verbs: Verbs, name: str, text: str, *rows: tuple[Any, ...], **more: Any) -> Any:
    """A parser with these options; its description is its help unless `more` has another one."""
    raw = argparse.RawDescriptionHelpFormatter
    settings = {'description': text, 'formatter_class': raw} | more
    p = verbs.add_parser(name, help=text, **settings)
    add_options(p, *rows)
    return p


def as_table(heads: Sequence[str], rows: Iterable[Sequence[Any]], left: int = 99) -> str:
    """Columns as wide as they must be, for the screen. left: how many of them are flush left."""
    texts = [list(heads), *([str(c) for c in row] for row in rows)]
    wide = [max(map(len, column)) for column in zip(*texts, strict=True)]
    lines = [
        [f'{c:{"<" if i < left else ">"}{wide[i]}}' for i, c in enumerate(row)] for row in texts
    ]
    return '\n'.join('  '.join(line).rstrip() for line in lines)
