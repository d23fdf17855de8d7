"""What the verbs of `waam calibrate` share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
    from .graph import Graph
    from .results import Result

WANTED: dict[str, Any] = {'required': True}
SEVERAL: dict[str, Any] = {'required': True, 'nargs': '+'}


def folder(args: argparse.Namespace, graph: Graph) -> Path:
    """Where results lie."""
    found: Path = args.calibrations or graph.folder()
    return found.resolve()


def keep(where: Path, result: Result, notes: Sequence[str], pictures: Sequence[bytes] = ()) -> int:
    """Stores a result with its report, prints both. Exit status 0."""
    from . import report, store

    result = result.of(datetime.now(UTC))
    path = store.save(where, result, report.page(result, pictures, notes))
    print('\n'.join([result.text, *notes]))
    if result.refuses:
        print(f'a job will refuse: {result.refuses}')
    print(f'kept: {path}, report: {path.with_suffix(".html")}')
    return 0
