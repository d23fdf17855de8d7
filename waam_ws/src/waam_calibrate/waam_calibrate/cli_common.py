"""What the verbs of `waam calibrate` share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
    from .graph import Graph
    from .results import Result

    Verbs: TypeAlias = argparse._SubParsersAction[argparse.ArgumentParser]


def verb(verbs: Verbs, name: str, text: str, graph: Graph) -> argparse.ArgumentParser:
    """A verb with the options of all."""
    p = verbs.add_parser(
        name, help=text, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument(
        '--calibrations',
        type=Path,
        metavar='DIR',
        help='where results lie (default: calibrations/ or $WAAM_CALIBRATIONS)',
    )
    return p


def folder(args: argparse.Namespace, graph: Graph) -> Path:
    """Where results lie."""
    found: Path = args.calibrations or graph.folder()
    return found.resolve()


def keep(where: Path, result: Result, notes: Sequence[str], pictures: Sequence[bytes] = ()) -> Path:
    """Stores a result with its report, prints both. Returns the path of the result."""
    from . import report, store

    path = store.save(where, result, report.page(result, pictures, notes))
    print('\n'.join([result.text, *notes]))
    if result.refuses:
        print(f'a job will refuse: {result.refuses}')
    print(f'kept: {path}, report: {path.with_suffix(".html")}')
    return path
