"""What the verbs of the waam command share."""

from __future__ import annotations

import argparse
import importlib
import os
import select
import sys
from collections.abc import Callable
from pathlib import Path

from waam_process.cli_options import add_options


class CellName(argparse.Action):
    """--name (or --cell): what follows is about this cell. ValueError for a name that is none."""

    def __call__(self, parser, namespace, value, option=None) -> None:  # type: ignore[no-untyped-def]
        """Puts the name where `paths` and every process that is started looks."""
        from waam_shop.cells import check_name

        from .paths import CELL

        try:
            os.environ[CELL] = check_name(value)
        except ValueError as e:
            parser.error(f'{option}: {e}')
        setattr(namespace, self.dest, value)


def add_cell(p: argparse.ArgumentParser, *options: str) -> None:
    """The option that names a cell: --cell, and whatever else it is called."""
    text = 'name of the cell (default: $WAAM_CELL, or cell)'
    p.add_argument('--cell', *options, dest='cell', action=CellName, metavar='CELL', help=text)


def reader_is_gone(error: Exception) -> bool:
    """Whether nobody reads any more what this command prints, such as after `| head`. That is no error to tell."""
    if not isinstance(error, BrokenPipeError):
        return False
    look = select.poll()
    look.register(sys.stdout.fileno(), 0)
    gone = any(event & (select.POLLERR | select.POLLHUP) for _, event in look.poll(0))
    if gone:  # Python flushes once more at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return gone


def add_run(p: argparse.ArgumentParser, *more: str) -> None:
    """Options --cell, --run and --domain, which name a graph. more: other names of --cell."""
    add_cell(p, *more)
    add_options(
        p, ('--run', Path, 'folder of the running graph (default: jobs/.run or $WAAM_RUN)'),
        ('--domain', int, 'ROS_DOMAIN_ID (default: from the environment or the folder)'),
    )  # fmt: skip


def late(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    """A verb's function, whose module is loaded when it runs: --help is quick."""
    package = __package__

    def run(args: argparse.Namespace) -> int:
        return getattr(importlib.import_module(f'{package}.{module}'), function)(args)

    return run


def run_and_domain(args: argparse.Namespace) -> tuple[Path, int]:
    """Folder and ROS domain of the graph that is meant: a running graph's domain counts, unless --domain is given."""
    from .operate import default_domain
    from .paths import run_dir
    from .run_state import load
    from .shop import domain_of

    run = (args.run or run_dir()).resolve()
    state = load(run)
    if args.domain is not None:
        return run, args.domain
    return run, state.domain if state and state.alive else domain_of(run, default_domain(run))
